"""The quadruped of 2004 as MJCF; sources in README.md."""
