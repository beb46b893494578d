"""Local polynomials: takes readings, gives a parabola through each one's neighbors."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...recording.data import Floats

# [s] on each side of a sample, in which its neighbors lie; chosen: about 50 ms in all,
# as the contract's score has it
HALF_WIDTH_SECONDS = 0.022
MIN_HALF_WIDTH = 2  # samples on each side; chosen: five points, two more than unknowns
MAX_HALF_WIDTH = 300  # samples on each side; chosen: those of 14 kHz, memory grows
MIN_FITTED_SAMPLES = 4  # at least, for a parabola; chosen: one more than unknowns
# half widths to the farthest neighbor; chosen: what lies beyond a pause tells nothing
MAX_NEIGHBOR_DISTANCE = 3.0
# half widths to the nearest whole parabola that one may borrow; chosen: an episode's
# end and a few missing readings
MAX_BORROWING_DISTANCE = 1.5
RIDGE = 1e-9  # added to the normal equations [1]; chosen: far below any curvature
# [s] over which a rotation's rate is differenced; chosen: far below any sampling time,
# far above rounding
ROTATION_RATE_STEP = 1e-4
# share of the half width that a jolt allows, that is used; chosen: the curve that it
# seems to fit is bent, too
SAFE_HALF_WIDTH_SHARE = 0.6
# standard deviations of a scatter, above which no parabola fits; chosen: never by noise
MAX_SCATTER_DEVIATION = 4.0


@dataclass(frozen=True, eq=False)
class LocalPolynomials:
    """A parabola through the neighbors of each of T samples, in C columns.

    A local polynomial regression of degree two with a uniform kernel (Savitzky, Golay
    1964): y(t) = a0 + a1 (t - t0) + a2 (t - t0)^2 about a sample at t0.

    Attributes:
        coefficients: (T, C, 3) a0 [unit], a1 [unit/s], a2 [unit/s^2]; NaN where too few
            readings are near.
        scatter: (T, C) standard deviation of the neighbors about it [unit].
        half_width: (T, C) how many neighbors it is fitted to on each side.
        is_borrowed: (T, C) whether it is the parabola of another sample, near an
            episode's ends and around missing readings.
    """

    coefficients: Floats
    scatter: Floats
    half_width: np.ndarray
    is_borrowed: np.ndarray

    def evaluate(self, rows: np.ndarray, dt: Floats) -> tuple[Floats, Floats]:
        """Value (W, C) and slope (W, C), at `dt` (W) [s] from samples `rows` (W)."""
        return _evaluate(self.coefficients[rows], dt[:, None])

    @classmethod
    def concatenate(cls, parts: Sequence["LocalPolynomials"]) -> "LocalPolynomials":
        """Put the polynomials of several signals side by side."""
        names = [f.name for f in fields(cls)]
        each = ([getattr(p, name) for p in parts] for name in names)
        return cls(*(np.concatenate(x, axis=1) for x in each))

    def refit_first_samples(
        self, time: Floats, readings: Floats, usual_scatter: Floats
    ) -> "LocalPolynomials":
        """Refit the first samples to fewer neighbors where an episode begins in a jolt.

        A robot that is let go, or sent far away, changes its motion within 50 ms. A
        parabola through these, extrapolated to the first sample, has a wrong slope.

        Args:
            time: (T) sample times [s].
            readings: (T, C) [each channel's unit].
            usual_scatter: (C) of the whole recording [each channel's unit].
        """
        refitted = ("coefficients", "scatter", "half_width")
        out = replace(self, **{name: getattr(self, name).copy() for name in refitted})
        limit = _scatter_limit(self.half_width[0]) * usual_scatter
        for c in np.flatnonzero(self.scatter[0] > limit):
            values, m, scatter = readings[:, [c]], int(self.half_width[0, c]), np.inf
            while (
                m > MIN_HALF_WIDTH
                and not scatter <= _scatter_limit(m) * usual_scatter[c]
            ):
                m -= 1
                scatter = _fit_first_samples(time, values, m).scatter[0, 0]
            m = max(MIN_HALF_WIDTH, round(SAFE_HALF_WIDTH_SHARE * m))
            fit = _fit_first_samples(time, values, m)
            rows = np.flatnonzero(np.isfinite(fit.scatter[:, 0]))
            for name in refitted:
                getattr(out, name)[rows, c] = getattr(fit, name)[rows, 0]
        return out


def _scatter_limit(half_width: float) -> float:
    """Largest scatter about a parabola that fits, over the usual scatter [1].

    The mean of f = 2 m - 2 squares of a unit normal has the variance 2 / f.
    """
    return np.sqrt(1 + MAX_SCATTER_DEVIATION * np.sqrt(2 / (2 * half_width - 2)))


def _evaluate(a: Floats, dt: Floats) -> tuple[Floats, Floats]:
    """Value (...) and slope (...) of parabolas (..., 3), `dt` [s] from their origin."""
    return a[..., 0] + dt * (a[..., 1] + dt * a[..., 2]), a[..., 1] + 2 * dt * a[..., 2]


def find_nearest(times: Floats, at: Floats) -> np.ndarray:
    """Numbers (W) of the samples of `times` (T) nearest to times `at` (W)."""
    right = np.clip(np.searchsorted(times, at), 1, max(len(times) - 1, 1))
    right = np.minimum(right, len(times) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(at - times[left] <= times[right] - at, left, right)


def choose_half_width(time: Floats) -> tuple[float, int]:
    """Usual distance of samples at `time` (T) [s], and half width of a parabola."""
    gaps = np.diff(time) if time.size > 1 else np.ones(1)
    gap = float(np.median(gaps))
    if HALF_WIDTH_SECONDS / gap > MAX_HALF_WIDTH:  # perhaps samples in bursts
        gap = float(gaps.mean())
    m = round(HALF_WIDTH_SECONDS / gap)
    return gap, int(np.clip(m, MIN_HALF_WIDTH, MAX_HALF_WIDTH))


@cache
def ar1_error_factors(ar1: float, m: int) -> tuple[float, float, float]:
    """Errors that first-order autoregressive noise causes in a local parabola.

    With covariance S[i, j] = ar1^|i - j| of the noise, and P the pseudoinverse of the
    parabola's basis B, the estimate's covariance is P S P'. The residuals' variance is
    that of tr(S - P S B') over the degrees of freedom.

    Args:
        ar1: correlation of the noise with that of the sample before [1].
        m: half width [samples].

    Returns:
        Standard errors of the value and of the slope, each over that of white noise of
        the same variance [1]. Then the share of the noise's variance that is left about
        the parabola [1].
    """
    t = np.arange(-m, m + 1.0)
    basis = np.stack([t**0, t, t**2], axis=1)
    rows = np.linalg.pinv(basis)
    cov = ar1 ** np.abs(t[:, None] - t)
    value, slope, _ = np.sqrt(np.diag(rows @ cov @ rows.T) / np.diag(rows @ rows.T))
    share = (len(t) - np.trace(rows @ cov @ basis)) / (len(t) - 3)
    return float(value), float(slope), float(share)


def fit_polynomials(time: Floats, readings: Floats) -> LocalPolynomials:
    """Fit readings (T, C) at `time` (T) [s] through the neighbors of each sample."""
    return _fit_half_width(time, readings, choose_half_width(time)[1])


def _fit_half_width(time: Floats, readings: Floats, m: int) -> LocalPolynomials:
    """Fit readings (T, C) at `time` (T) [s] through m neighbors on each side."""
    fit = _make_empty(readings, m)
    if len(time) < 2 * m + 1:
        return fit
    for c in range(readings.shape[1]):
        y = sliding_window_view(readings[:, c], 2 * m + 1)
        coefficients, variance = _fit_quadratics(time, y)
        rows, source, dt = _find_borrowers(time, coefficients, m)
        a = coefficients[source]
        coefficients[rows] = np.stack([*_evaluate(a, dt), a[:, 2]], axis=1)
        variance[rows] = variance[source]
        fit.coefficients[:, c], fit.scatter[:, c] = coefficients, np.sqrt(variance)
        fit.is_borrowed[rows, c] = True
    return fit


def _fit_first_samples(time: Floats, readings: Floats, m: int) -> LocalPolynomials:
    """Fit an episode's first 2 m + 1 readings; polynomials of the first m + 1."""
    fit = _fit_half_width(time[: 2 * m + 1], readings[: 2 * m + 1], m)
    return LocalPolynomials(*(getattr(fit, f.name)[: m + 1] for f in fields(fit)))


def _make_empty(readings: Floats, m: int) -> LocalPolynomials:
    """Polynomials of readings (T, C), all of them unknown."""
    shape = readings.shape
    unknown, half_width = np.full(shape, np.nan), np.full(shape, m)
    coefficients = np.full((*shape, 3), np.nan)
    return LocalPolynomials(coefficients, unknown, half_width, np.zeros(shape, bool))


def fit_rotations(time: Floats, quaternion: Floats) -> LocalPolynomials:
    """Fit an orientation by rotation vectors from each sample to its neighbors.

    Rotation vectors of a body that turns evenly lie on a line, however fast it turns;
    quaternions do not.

    Args:
        time: (T) sample times [s].
        quaternion: (T, 4), w first; NaN where missing.

    Returns:
        Polynomials (T, 4) of the quaternion's components.
    """
    _, m = choose_half_width(time)
    fit = _make_empty(quaternion, m)
    is_known = np.asarray(np.isfinite(quaternion).all(axis=1))
    if len(time) < 2 * m + 1:
        return fit
    whole = np.where(is_known[:, None], quaternion, [1.0, 0, 0, 0])
    vectors = _rotation_vectors(whole, is_known, m)
    parts = [_fit_quadratics(time, vectors[..., k]) for k in range(3)]
    coefficients = np.stack([a for a, _ in parts], axis=1)  # (T, 3, 3)
    # a quaternion's vector part is half a small rotation vector
    square = np.stack([v for _, v in parts], axis=1) / 4
    variance = np.column_stack([square.mean(axis=1), square])
    borrowers, source, dt = _find_borrowers(time, coefficients[:, 0], m)
    variance[borrowers], fit.is_borrowed[borrowers] = variance[source], True
    fit.scatter[:] = np.sqrt(variance)
    fitted = np.flatnonzero(np.isfinite(coefficients[:, 0, 0]))
    rows, source = np.append(fitted, borrowers), np.append(fitted, source)
    dt = np.append(np.zeros(len(fitted)), dt)
    h = ROTATION_RATE_STEP
    before, middle, after = (
        _rotate(
            whole[source],
            _evaluate(coefficients[source], (dt + k * h)[:, None])[0],
        )
        for k in (-1, 0, 1)
    )
    slope = (after - before) / (2 * h)
    half_curvature = (after - 2 * middle + before) / (2 * h**2)
    fit.coefficients[rows] = np.stack([middle, slope, half_curvature], axis=-1)
    return fit


def _rotation_vectors(quaternion: Floats, is_known: np.ndarray, m: int) -> Floats:
    """Rotation vectors from each sample to its neighbors, in the sample's frame [rad].

    Args:
        quaternion: (T, 4), w first.
        is_known: (T) whether each was read.
        m: half width [samples].

    Returns:
        (T - 2 m, 2 m + 1, 3), of each sample but the first and last m; NaN unknown.
    """
    from scipy.spatial.transform import Rotation

    near = sliding_window_view(np.arange(len(quaternion)), 2 * m + 1)
    width = near.shape[1]
    origin = np.repeat(near[:, m], width)
    rotation = Rotation.from_quat(quaternion, scalar_first=True)
    vectors = (rotation[origin].inv() * rotation[near.ravel()]).as_rotvec()
    both = is_known[near] & is_known[near[:, m]][:, None]
    return np.where(both[..., None], vectors.reshape(len(near), width, 3), np.nan)


def _rotate(quaternion: Floats, by: Floats) -> Floats:
    """Turn orientations (n, 4) by rotation vectors (n, 3) in their own frames [rad]."""
    from scipy.spatial.transform import Rotation

    if not len(by):
        return quaternion
    start = Rotation.from_quat(quaternion, scalar_first=True)
    turned = (start * Rotation.from_rotvec(by)).as_quat(scalar_first=True)
    return turned * np.where((turned * quaternion).sum(axis=1) < 0, -1, 1)[:, None]


def _fit_quadratics(time: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Fit parabolas through neighbors by least squares.

    By the normal equations (B'B + ridge) x = B'y, with times in half widths.

    Args:
        time: (T) sample times [s].
        y: (T - 2 m, 2 m + 1) neighbors of each sample but the first and last m; NaN
            where missing.

    Returns:
        Coefficients (T, 3), and variance (T) about the parabola; NaN where too few
        neighbors are known, and of the first and last m.
    """
    m = y.shape[1] // 2
    gap, _ = choose_half_width(time)
    coefficients, variance = np.full((len(time), 3), np.nan), np.full(len(time), np.nan)
    t = sliding_window_view(time, 2 * m + 1) - time[m : len(time) - m, None]
    is_near = np.abs(t) <= MAX_NEIGHBOR_DISTANCE * gap * m
    scale = np.array([1, gap * m, (gap * m) ** 2])
    is_known = np.isfinite(y) & is_near
    is_fitted = is_known.sum(axis=1) >= max(MIN_FITTED_SAMPLES, m)
    if not is_fitted.any():
        return coefficients, variance
    basis = np.stack([np.ones_like(t), t, t**2], axis=-1) / scale
    a = basis[is_fitted] * is_known[is_fitted][..., None]
    y = np.where(is_known[is_fitted], y[is_fitted], 0.0)
    normal = np.einsum("tki,tkj->tij", a, a) + RIDGE * np.eye(3)
    x = np.linalg.solve(normal, np.einsum("tki,tk->ti", a, y)[..., None])[..., 0]
    residuals = y - np.einsum("tki,ti->tk", a, x)
    freedom = is_known[is_fitted].sum(axis=1) - 3
    rows = np.flatnonzero(is_fitted) + m
    variance[rows] = (residuals**2).sum(axis=1) / np.maximum(freedom, 1)
    coefficients[rows] = x / scale
    return coefficients, variance


def _find_borrowers(
    time: Floats, coefficients: Floats, m: int
) -> tuple[np.ndarray, np.ndarray, Floats]:
    """Find samples without a parabola that may borrow that of another sample.

    They lie near an episode's ends, or readings around them are missing.

    Args:
        time: (T) sample times [s].
        coefficients: (T, 3); NaN where there is no parabola.
        m: half width [samples].

    Returns:
        Numbers of the borrowers (n), of the nearest samples with a parabola (n), and
        the times from these to the borrowers (n) [s].
    """
    gap, _ = choose_half_width(time)
    is_fitted = np.isfinite(coefficients[:, 0])
    fitted, rows = np.flatnonzero(is_fitted), np.flatnonzero(~is_fitted)
    if not fitted.size:
        return rows[:0], rows[:0], np.zeros(0)
    source = fitted[find_nearest(time[fitted], time[rows])]
    dt = time[rows] - time[source]
    is_close = np.abs(dt) <= MAX_BORROWING_DISTANCE * gap * m
    return rows[is_close], source[is_close], dt[is_close]
