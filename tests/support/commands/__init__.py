"""The command line, for tests."""
