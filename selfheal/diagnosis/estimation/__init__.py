"""Estimation: nonlinear least squares over segments with marginalized initial states."""
