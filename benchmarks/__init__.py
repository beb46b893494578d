"""Measurements of selfheal: each command writes JSON and a part of a page of docs/results."""
