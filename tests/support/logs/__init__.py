"""Readers of logs, for tests."""
