"""Robots that a TOML describes, for identify --robot FILE.toml."""
