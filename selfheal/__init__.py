"""A robot finds out what its body is; importing this takes and loads nothing."""

__version__ = "0.1.0"
