"""Placeholder."""


def write(*a): ...
