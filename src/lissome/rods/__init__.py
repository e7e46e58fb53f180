"""Discrete elastic rods (chapter 4)."""
