"""Dynamics of hidden robots, told from their moves."""
