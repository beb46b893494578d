"""MJCF text: takes a model's files, gives its text with little changed."""
