"""Engines: bodies and joint targets in, readings at rest out, at three fidelities."""
