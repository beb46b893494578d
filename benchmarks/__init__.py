"""Measurements of selfheal: each command writes JSON and a part of docs/results."""
