"""Robots: an action in, a recording of what the robot felt out."""
