"""Quartics: takes readings, gives value, slope and curvature at any time.

Each reading's neighbors have a local polynomial of degree four (Savitzky and Golay
1964). Its half width is the largest one that the readings do not refute.
"""

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...recording.data import Floats
from ..data.local_polynomial import find_nearest

MAX_CONDITION = 1e12  # of normal equations; beyond it readings lie on one side
POLYNOMIAL_DEGREE = 4  # of the polynomials: the lowest whose second derivative may bend
# half widths that are tried [samples]; each about 1.3 times the one before
HALF_WIDTHS = (4, 5, 7, 9, 12, 16, 21, 28, 37, 48, 64, 85, 112, 150)
# of a window, the widest half width: what a polynomial smooths is then little beside
# what the window does
MAX_WINDOW_SHARE = 0.25


@dataclass(frozen=True, eq=False)
class Quartics:
    """Polynomials through the neighbors of each of T readings; NaN where too few.

    Attributes:
        time: (T) of the samples [s].
        coefficients: (T, 5) of powers of the time since the sample [unit, per s^k].
        variance: (T, 3) of value, slope and curvature, of noise of unit variance.
    """

    time: Floats
    coefficients: Floats
    variance: Floats

    def differentiate(self, at: Floats, delay: float = 0.0) -> tuple[Floats, Floats]:
        """Value, slope and curvature (3, W) at times, and their variances (3, W).

        All times go over to the next samples' polynomials at the same delay, so that
        errors are smooth in it but there. What is unknown without a delay stays so.

        Args:
            at: (W) [s].
            delay: by which the times are later [s].
        """
        near = find_nearest(self.time, at)
        known = np.flatnonzero(np.isfinite(self.coefficients[:, 0]))
        if delay and len(known):
            gap = float(np.median(np.diff(self.time)))
            wanted = near + float(round(delay / gap))
            near = known[find_nearest(known.astype(float), wanted)]
        dt, a = at + delay - self.time[near], self.coefficients[near].T
        value = a[0] + dt * (a[1] + dt * (a[2] + dt * (a[3] + dt * a[4])))
        slope = a[1] + dt * (2 * a[2] + dt * (3 * a[3] + dt * 4 * a[4]))
        curvature = 2 * a[2] + dt * (6 * a[3] + dt * 12 * a[4])
        return np.stack([value, slope, curvature]), self.variance[near].T


def fit_quartics(time: Floats, y: Floats, m: int) -> Quartics:
    """Fit polynomials; nearer than m samples to an end there is none.

    Args:
        time: (T) of the samples [s].
        y: (T) readings [unit]; NaN where missing.
        m: neighbors on each side.
    """
    count = len(time)
    coefficients = np.full((count, POLYNOMIAL_DEGREE + 1), np.nan)
    variance = np.full((count, 3), np.nan)
    if count < 2 * m + 1:
        return Quartics(time, coefficients, variance)
    times = sliding_window_view(time, 2 * m + 1) - time[m : count - m, None]
    values = sliding_window_view(y, 2 * m + 1)
    half = np.abs(times).max(axis=1)
    known = np.isfinite(values)
    basis = (times / half[:, None])[..., None] ** np.arange(POLYNOMIAL_DEGREE + 1)
    basis = basis * known[..., None]
    normal = np.einsum("wki,wkj->wij", basis, basis)
    enough = (known.sum(axis=1) > POLYNOMIAL_DEGREE + 1) & (
        np.linalg.cond(normal) < MAX_CONDITION
    )
    half = half[enough]
    inverse = np.linalg.inv(normal[enough])
    right = np.einsum("wki,wk->wi", basis[enough], np.nan_to_num(values[enough]))
    scale = half[:, None] ** -np.arange(POLYNOMIAL_DEGREE + 1.0)
    rows = np.flatnonzero(enough) + m
    coefficients[rows] = np.einsum("wij,wj->wi", inverse, right) * scale
    diagonal = np.einsum("wii->wi", inverse)[:, :3]
    variance[rows] = diagonal * (scale[:, :3] * [1, 1, 2]) ** 2
    return Quartics(time, coefficients, variance)


def choose_half_width(
    time: Floats, readings: Floats, noise: float, order: int, window: float
) -> int:
    """The largest half width of which the readings do not refute a derivative.

    Of two nested least-squares estimates k'y, averaged over a window, the difference
    has the variance |k1 - k2|^2 sigma^2, if noise alone makes it (Hausman 1978). The
    width grows while the mean square of that difference is at most twice that, so that
    its bias is no larger than its noise (Lepski 1990).

    Args:
        time: (T) of the samples [s].
        readings: (T) [unit]; NaN where missing.
        noise: their standard deviation [unit].
        window: over which it is averaged [s].
    """
    gap = float(np.median(np.diff(time)))
    known = np.isfinite(readings)
    if not known.any():
        return HALF_WIDTHS[0]
    even = np.arange(time[0], time[-1], gap)
    y = np.interp(even, time[known], readings[known])
    hann = np.hanning(max(round(window / gap), 1) + 2)[1:-1]
    best, before = HALF_WIDTHS[0], None
    for m in HALF_WIDTHS:
        kernel = np.convolve(_derivative_kernel(m, order, gap), hann / hann.sum())
        if len(kernel) > len(y) or (
            before is not None and m * gap > MAX_WINDOW_SHARE * window
        ):
            break
        if before is not None:
            change = kernel.copy()
            pad = (len(kernel) - len(before)) // 2
            change[pad : len(kernel) - pad] -= before
            apart = np.convolve(y, change[::-1], "valid")
            if (apart**2).mean() > 2 * noise**2 * (change @ change):
                break
        best, before = m, kernel
    return best


def _derivative_kernel(m: int, order: int, gap: float) -> Floats:
    """(2 m + 1) weights of even samples in a derivative of their polynomial."""
    basis = np.vander(
        np.arange(-m, m + 1) * gap, POLYNOMIAL_DEGREE + 1, increasing=True
    )
    return np.linalg.pinv(basis)[order] * factorial(order)
