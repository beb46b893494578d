"""Files that were damaged, for tests."""
