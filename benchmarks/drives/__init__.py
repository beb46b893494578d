"""Drives that a model lacks: cases by seed, two reference fits, and their scores."""
