"""Evolutionary searches: scores of points in, better points out."""
