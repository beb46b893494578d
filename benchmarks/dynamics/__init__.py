"""Dynamics of hidden robots, measured from their moves."""
