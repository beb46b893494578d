"""Data of a diagnosis: episodes, segments and initial states of recordings."""
