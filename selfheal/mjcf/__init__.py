"""The text of an MJCF model: read, changed in place, written."""
