"""What may happen to a robot: every kind in one table, its words, what it changes."""
