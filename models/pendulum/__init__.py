"""A pendulum on a position servo, for `selfheal example`."""
