"""Recordings for other programs: a recording, perhaps with predictions; a file out."""
