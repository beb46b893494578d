"""Equation errors of all candidates in one linear model."""
