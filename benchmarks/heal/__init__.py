"""Gaits, alarms and healing of walking robots over many seeds."""
