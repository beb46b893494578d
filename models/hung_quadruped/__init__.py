"""A quadruped that hangs in the air, for `selfheal example`."""
