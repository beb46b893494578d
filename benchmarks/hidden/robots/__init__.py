"""Robots as their users have them: drawn by number, drawn as chains, written down."""
