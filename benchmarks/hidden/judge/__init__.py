"""Diagnoses judged by keys: names, intervals, and predictions of held-out motion."""
