"""Proposed maps: takes a log and a model, gives lines of a map with their reasons."""
