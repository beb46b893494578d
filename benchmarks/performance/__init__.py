"""Accuracy, speed and memory of the engines, and of a diagnosis."""
