"""A small arm on hobby servos, for `selfheal example`."""
