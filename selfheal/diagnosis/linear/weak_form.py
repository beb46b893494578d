"""Weak form: takes readings, gives means of their derivatives over windows.

With a window w that is 0 at its ends, the mean of a derivative is an integral over the
readings themselves (Messenger and Bortz 2021),

    int w y'' = int w'' y,   int w y' = -int w' y,

which no smoothing biases, whatever a command makes of the motion.
"""

from functools import cache

import numpy as np

from ...recording.data import Floats

# of a polynomial that is integrated exactly, so that sums see what is left
SUBTRACTED_DEGREE = 5
WEAK_RIDGE = 1e-9  # of normal equations; a window without readings has a mean, too
QUADRATURE = np.linspace(-1, 1, 201)  # of a window's own integrals


def average_derivatives(
    time: Floats, readings: Floats, centers: Floats, half: float
) -> tuple[Floats, Floats]:
    """Means of derivatives in windows w = (1 + cos(pi s)) / (2 half), |s| <= 1.

    Args:
        time: (T) of the samples [s].
        readings: (T) [unit]; NaN where missing.
        centers: (R) of the windows [s].
        half: their half width [s].

    Returns:
        (3, R) means of orders 0 to 2 [unit per s^order], and their variances (3, R) by
        noise of unit variance.
    """
    first = np.searchsorted(time, centers - half)
    count = int((np.searchsorted(time, centers + half, "right") - first).max(initial=1))
    near = np.minimum(first[:, None] + np.arange(count), len(time) - 1)
    s = (time[near] - centers[:, None]) / half
    y = readings[near]
    used = (np.abs(s) <= 1) & np.isfinite(y)
    used[:, 1:] &= near[:, 1:] > near[:, :-1]
    gaps = np.gradient(time)[near] * used
    basis = np.repeat(used[..., None].astype(float), SUBTRACTED_DEGREE + 1, axis=-1)
    basis[..., 1:] *= s[..., None]
    np.cumprod(basis, axis=-1, out=basis)  # powers
    normal = basis.swapaxes(1, 2) @ basis + WEAK_RIDGE * np.eye(SUBTRACTED_DEGREE + 1)
    sine, cosine = np.sin(np.pi * s), np.cos(np.pi * s)
    window = np.stack([1 + cosine, np.pi * sine, -(np.pi**2) * cosine])  # derivatives
    scale = half ** -np.arange(3.0)
    weights = 0.5 / half * scale[:, None, None] * window * gaps
    # of the polynomial the mean is exact, of what is left about it a sum
    summed = np.moveaxis(weights, 0, 1) @ basis
    exact = scale[:, None] * _average_powers() - summed  # (R, 3, k)
    x = np.linalg.solve(normal, exact.swapaxes(1, 2))
    weights += np.moveaxis(basis @ x, -1, 0)
    return (weights * np.where(used, y, 0.0)).sum(axis=-1), (weights**2).sum(axis=-1)


@cache
def _average_powers() -> Floats:
    """Means (3, k) of derivatives of s^k over a window, k up to the degree."""
    window = (1 + np.cos(np.pi * QUADRATURE)) / 2
    powers = np.polynomial.polynomial.polyvander(QUADRATURE, SUBTRACTED_DEGREE)
    each_power = np.eye(SUBTRACTED_DEGREE + 1)
    out = []
    for order in range(3):
        derived = np.polynomial.polynomial.polyder(each_power, order)
        each = powers[:, : len(derived)] @ derived
        out.append(np.trapezoid(window[:, None] * each, QUADRATURE, axis=0))
    return np.array(out)
