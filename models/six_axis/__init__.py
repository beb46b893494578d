"""An industrial arm of six axes, for `selfheal example`."""
