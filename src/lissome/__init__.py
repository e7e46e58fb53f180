"""Lissome: active rods, ribbons and plates."""
