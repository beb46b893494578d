"""Diagnosis: takes a model and recordings, says which physics the model leaves out."""
