"""Output: diagnosis.json, patched models, drives for others, and the replay."""
