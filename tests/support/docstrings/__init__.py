"""Coverage of docstrings, and what it is measured of."""
