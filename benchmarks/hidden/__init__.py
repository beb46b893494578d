"""Robots that are not as their models say: one kit, and the suites that draw on it."""
