"""Measurements of selfheal: each command writes JSON and a page of docs/results."""
