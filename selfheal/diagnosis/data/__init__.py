"""Data of a diagnosis: recordings as episodes, segments and states on a grid of time."""
