"""Robots: an action in, a recording of its readings out."""
