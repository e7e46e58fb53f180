"""The version of the library, in one place; the build back end reads it from here."""

__version__ = "0.1.0"
