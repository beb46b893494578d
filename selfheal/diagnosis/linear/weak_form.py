"""Weak form: takes readings, gives means of their derivatives over windows.

With a window w that is 0 at its ends, the mean of a derivative is an integral over the
readings themselves (Messenger and Bortz 2021),

    int w y'' = int w'' y,   int w y' = -int w' y,

which no smoothing biases, whatever a command makes of the motion.
"""

import numpy as np

from ...recording.data import Floats

# of a polynomial that is integrated exactly, so that sums see what is left
SUBTRACTED_DEGREE = 5
WEAK_RIDGE = 1e-9  # of normal equations; a window without readings has a mean, too
QUADRATURE = np.linspace(-1, 1, 201)  # of a window's own integrals


def average_derivative(
    time: Floats, readings: Floats, centers: Floats, half: float, order: int
) -> tuple[Floats, Floats]:
    """Means of a derivative in windows w = (1 + cos(pi s)) / (2 half), |s| <= 1.

    Args:
        time: (T) of the samples [s].
        readings: (T) [unit]; NaN where missing.
        centers: (R) of the windows [s].
        half: their half width [s].
        order: of the derivative, 0 to 2.

    Returns:
        (R) means [unit per s^order], and their variances (R) by noise of unit variance.
    """
    first = np.searchsorted(time, centers - half)
    count = int((np.searchsorted(time, centers + half, "right") - first).max(initial=1))
    near = np.minimum(first[:, None] + np.arange(count), len(time) - 1)
    s = (time[near] - centers[:, None]) / half
    y = readings[near]
    used = (np.abs(s) <= 1) & np.isfinite(y)
    used[:, 1:] &= near[:, 1:] > near[:, :-1]
    gaps = np.gradient(time)[near] * used
    basis = s[..., None] ** np.arange(SUBTRACTED_DEGREE + 1) * used[..., None]
    y = np.where(used, y, 0.0)
    normal = np.einsum("rki,rkj->rij", basis, basis)
    normal += WEAK_RIDGE * np.eye(SUBTRACTED_DEGREE + 1)
    if order == 0:
        weights = (1 + np.cos(np.pi * s)) / (2 * half)
    elif order == 1:
        weights = np.pi * np.sin(np.pi * s) / (2 * half**2)
    else:
        weights = -(np.pi**2) * np.cos(np.pi * s) / (2 * half**3)
    weights = weights * gaps
    # of the polynomial the mean is exact, of what is left about it a sum
    exact = _average_powers(order) / half**order - np.einsum(
        "rki,rk->ri", basis, weights
    )
    x = np.linalg.solve(normal, exact[..., None])[..., 0]
    weights = weights + np.einsum("rki,ri->rk", basis, x)
    return (weights * y).sum(axis=1), (weights**2).sum(axis=1)


def _average_powers(order: int) -> Floats:
    """Means of derivatives of s^k over a window, k up to the degree."""
    window = (1 + np.cos(np.pi * QUADRATURE)) / 2
    powers = np.polynomial.polynomial.polyvander(QUADRATURE, SUBTRACTED_DEGREE)
    each_power = np.eye(SUBTRACTED_DEGREE + 1)
    derived = np.polynomial.polynomial.polyder(each_power, order)
    each = powers[:, : len(derived)] @ derived
    return np.asarray(np.trapezoid(window[:, None] * each, QUADRATURE, axis=0))
