"""Text that files and users may bring along, for tests."""
