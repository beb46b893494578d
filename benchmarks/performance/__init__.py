"""Accuracy, speed, memory and scaling of the parts of selfheal."""
