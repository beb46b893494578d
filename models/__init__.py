"""Robots as data: one folder each, an MJCF and a README with its sources."""
