"""Estimation: least squares over segments with marginalized initial states."""
