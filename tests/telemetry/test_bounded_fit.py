"""The bounded fit of a torque's terms is the best one, where BVLS ends early."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from selfheal.telemetry.terms import solve_bounded


@pytest.mark.parametrize("seed", [229, 449, 592, 7])
def test_no_other_coefficients_within_bounds_are_nearer(seed):
    """SciPy's BVLS ends far from the best ones in the first three."""
    rng = np.random.default_rng(seed)
    k = rng.integers(3, 9)
    x = rng.normal(size=(50, k)) @ (np.eye(k) + rng.normal(size=(k, k)))
    x = np.linalg.qr(x, mode="r")
    y = 2 * rng.normal(size=k)
    low, high = -rng.uniform(0, 1, k) * (rng.random(k) < 0.7), rng.uniform(0, 1, k)
    # one row more than columns, or nothing would be fitted
    x, y = np.vstack([x, np.zeros(k)]), np.append(y, 0.0)
    found = solve_bounded(x, y, np.array([low, high]))
    best = lsq_linear(x, y, (low, high + 1e-15), tol=1e-12).x
    errors = [float(np.sum((y - x @ c) ** 2)) for c in (found, best)]
    assert errors[0] < errors[1] * (1 + 1e-5)
    assert (found >= low - 1e-9).all() and (found <= high + 1e-9).all()
