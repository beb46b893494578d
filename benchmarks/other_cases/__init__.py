"""Diagnosis cases of another style than the sealed ones, always the same."""
