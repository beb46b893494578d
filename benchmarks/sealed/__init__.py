"""Diagnosis cases whose missing physics only the scorer knows."""
