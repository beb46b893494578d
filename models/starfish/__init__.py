"""The starfish of 2006 as MJCF, one file a variant; sources in README.md."""
