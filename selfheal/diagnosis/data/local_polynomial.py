"""What was read around a sample: takes readings, gives parabolas through neighbors."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ...recording.data import Floats

# half width [s] of the parabola that says where the robot was and how fast, and the
# least of samples on each side; chosen: 50 ms in all, as the contract's score has it
HALF_WIDTH, LEAST = 0.022, 2
MOST = 300  # samples on each side, as of 14 kHz: memory grows with them; chosen
REACH = 3.0  # times that, the farthest that irregular samples may lie; chosen
INSTANT = 1e-4  # [s] over which a turn's rate is told
SAFE = 0.6  # of the neighbors that one seems to fit: what is not seen is bent too
JOLTED = 4.0  # standard deviations of a scatter, with which no parabola fits; chosen


@dataclass(frozen=True, eq=False)
class LocalPolynomials:
    """One through the neighbors of each of T samples, in C columns.

    Attributes:
        coefficients: (T, C, 3) value, slope [1/s], half the curvature; NaN where too
            few readings are near.
        scatter: (T, C) standard deviation of the neighbors about it.
        sides: (T, C) how many neighbors it looks at on each side.
        borrowed: (T, C) whether that of a sample beside it speaks for it: near an
            episode's ends, and around missing readings.
    """

    coefficients: Floats
    scatter: Floats
    half_width: np.ndarray
    is_borrowed: np.ndarray

    def evaluate(self, rows: np.ndarray, dt: Floats) -> tuple[Floats, Floats]:
        """Value and slope (W, C), `dt` (W) [s] from the samples `rows` (W)."""
        return _evaluate(self.coefficients[rows], dt[:, None])

    @classmethod
    def concatenate(cls, parts: Sequence["LocalPolynomials"]) -> "LocalPolynomials":
        """Those of several signals, side by side."""
        return cls(*(
            np.concatenate([getattr(p, f.name) for p in parts], axis=1)
            for f in fields(cls)
        ))  # fmt: skip

    def refit_first_samples(
        self, time: Floats, readings: Floats, usual: Floats
    ) -> "LocalPolynomials":
        """The same, whose first ones look at fewer neighbors where a jolt begins.

        A robot that is let go, or sent far away, moves otherwise before 50 ms are over:
        a parabola through them, extrapolated to where they began, tells a wrong speed.

        Args:
            time: (T) [s].
            readings: (T, C).
            usual: (C) scatter.
        """
        anew = ("coefficients", "scatter", "half_width")
        found = replace(self, **{name: getattr(self, name).copy() for name in anew})
        for c in np.flatnonzero(
            self.scatter[0] > _scatter_limit(self.half_width[0]) * usual
        ):
            own, m, scatter = readings[:, [c]], int(self.half_width[0, c]), np.inf
            while m > LEAST and not scatter <= _scatter_limit(m) * usual[c]:
                m -= 1
                scatter = _fit_first_samples(time, own, m).scatter[0, 0]
            few = _fit_first_samples(time, own, max(LEAST, round(SAFE * m)))
            rows = np.flatnonzero(np.isfinite(few.scatter[:, 0]))
            for name in anew:
                getattr(found, name)[rows, c] = getattr(few, name)[rows, 0]
        return found


def _scatter_limit(sides):
    """Times the usual scatter, that of neighbors on each side that a parabola fits."""
    return np.sqrt(1 + JOLTED * np.sqrt(2 / (2 * sides - 2)))  # of a mean of squares


def _evaluate(a: Floats, dt: Floats) -> tuple[Floats, Floats]:
    """Value and slope (...) of parabolas (..., 3), `dt` [s] from where they stand."""
    return a[..., 0] + dt * (a[..., 1] + dt * a[..., 2]), a[..., 1] + 2 * dt * a[..., 2]


def find_nearest(times: Floats, at: Floats) -> np.ndarray:
    """Number of the sample nearest in time."""
    right = np.clip(np.searchsorted(times, at), 1, max(len(times) - 1, 1))
    right = np.minimum(right, len(times) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(at - times[left] <= times[right] - at, left, right)


def choose_half_width(time: Floats) -> tuple[float, int]:
    """Usual distance [s] of samples, and how many on each side a parabola looks at."""
    gaps = np.diff(time) if time.size > 1 else np.ones(1)
    gap = float(np.median(gaps))
    if HALF_WIDTH / gap > MOST:  # perhaps of samples that come in bursts
        gap = float(gaps.mean())
    return gap, int(np.clip(round(HALF_WIDTH / gap), LEAST, MOST))


@cache
def ar1_error_factors(memory: float, m: int) -> tuple[float, float, float]:
    """What noise of first order does to a parabola through m neighbors on each side.

    Args:
        memory: correlation with the sample before.
        m: on each side.

    Returns:
        The error of the parabola's value and of its slope, over that of white noise as
        large; and the share of the noise's variance that is left about it.
    """
    t = np.arange(-m, m + 1.0)
    basis = np.stack([t**0, t, t**2], axis=1)
    rows = np.linalg.pinv(basis)
    cov = memory ** np.abs(t[:, None] - t)
    value, slope, _ = np.sqrt(np.diag(rows @ cov @ rows.T) / np.diag(rows @ rows.T))
    left = (len(t) - np.trace(rows @ cov @ basis)) / (len(t) - 3)
    return float(value), float(slope), float(left)


def fit_polynomials(time: Floats, readings: Floats) -> LocalPolynomials:
    """Through the neighbors of each sample (T) of readings (T, C)."""
    return _fit_half_width(time, readings, choose_half_width(time)[1])


def _fit_half_width(time: Floats, readings: Floats, m: int) -> LocalPolynomials:
    """The same, through m neighbors on each side."""
    found = _make_empty(readings, m)
    if len(time) < 2 * m + 1:
        return found
    for c in range(readings.shape[1]):
        y = sliding_window_view(readings[:, c], 2 * m + 1)
        own, variance = _fit_quadratics(time, y)
        lost, source, dt = _find_borrowers(time, own, m)
        a = own[source]
        own[lost] = np.stack([*_evaluate(a, dt), a[:, 2]], axis=1)
        variance[lost] = variance[source]
        found.coefficients[:, c], found.scatter[:, c] = own, np.sqrt(variance)
        found.is_borrowed[lost, c] = True
    return found


def _fit_first_samples(time: Floats, readings: Floats, m: int) -> LocalPolynomials:
    """The same of an episode's first readings alone, up to the one in the middle."""
    found = _fit_half_width(time[: 2 * m + 1], readings[: 2 * m + 1], m)
    return LocalPolynomials(*(getattr(found, f.name)[: m + 1] for f in fields(found)))


def _make_empty(readings: Floats, m: int) -> LocalPolynomials:
    """None for any reading (T, C) yet."""
    shape = readings.shape
    return LocalPolynomials(
        np.full((*shape, 3), np.nan), np.full(shape, np.nan), np.full(shape, m),
        np.zeros(shape, bool),
    )  # fmt: skip


def fit_rotations(time: Floats, quaternion: Floats) -> LocalPolynomials:
    """As `parabolas` of an orientation (T, 4), through rotations from each sample.

    Those of a body that turns evenly lie on a line, however fast it turns; quaternions
    do not.
    """
    from scipy.spatial.transform import Rotation

    _, m = choose_half_width(time)
    found = _make_empty(quaternion, m)
    known = np.asarray(np.isfinite(quaternion).all(axis=1))
    if len(time) < 2 * m + 1:
        return found
    whole = np.where(known[:, None], quaternion, [1.0, 0, 0, 0])
    near = sliding_window_view(np.arange(len(time)), 2 * m + 1)
    width = near.shape[1]
    origin = np.repeat(near[:, m], width)
    turn = Rotation.from_quat(whole, scalar_first=True)
    away = (turn[origin].inv() * turn[near.ravel()]).as_rotvec()
    predicted = known[near] & known[near[:, m]][:, None]
    away = np.where(predicted[..., None], away.reshape(len(near), width, 3), np.nan)
    parts = [_fit_quadratics(time, away[..., k]) for k in range(3)]
    own = np.stack([a for a, _ in parts], axis=1)  # (T, 3, 3)
    each = np.stack([v for _, v in parts], axis=1) / 4  # of a quaternion's vector part
    variance = np.column_stack([each.mean(axis=1), each])
    lost, source, dt = _find_borrowers(time, own[:, 0], m)
    variance[lost], found.is_borrowed[lost] = variance[source], True
    found.scatter[:] = np.sqrt(variance)
    good = np.flatnonzero(np.isfinite(own[:, 0, 0]))
    rows, source = np.append(good, lost), np.append(good, source)
    dt = np.append(np.zeros(len(good)), dt)
    before, now, after = (
        _rotate(whole[source], _evaluate(own[source], (dt + k * INSTANT)[:, None])[0])
        for k in (-1, 0, 1)
    )
    slope = (after - before) / (2 * INSTANT)
    bend = (after - 2 * now + before) / (2 * INSTANT**2)
    found.coefficients[rows] = np.stack([now, slope, bend], axis=-1)
    return found


def _rotate(quaternion: Floats, by: Floats) -> Floats:
    """Orientations (n, 4) turned by rotation vectors (n, 3) of their own frames."""
    from scipy.spatial.transform import Rotation

    if not len(by):
        return quaternion
    start = Rotation.from_quat(quaternion, scalar_first=True)
    turned = (start * Rotation.from_rotvec(by)).as_quat(scalar_first=True)
    return turned * np.where((turned * quaternion).sum(axis=1) < 0, -1, 1)[:, None]


def _fit_quadratics(time: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Parabolas through neighbors: coefficients (T, 3), variance (T); NaN at the ends.

    Args:
        time: (T) [s].
        y: (T - 2 m, 2 m + 1), the neighbors of each sample but the first and last m.
    """
    m = y.shape[1] // 2
    gap, _ = choose_half_width(time)
    coefficients, variance = np.full((len(time), 3), np.nan), np.full(len(time), np.nan)
    t = sliding_window_view(time, 2 * m + 1) - time[m : len(time) - m, None]
    near = np.abs(t) <= REACH * gap * m  # what lies beyond a pause tells nothing here
    scale = np.array([1, gap * m, (gap * m) ** 2])
    known = np.isfinite(y) & near
    good = known.sum(axis=1) >= max(4, m)
    if not good.any():
        return coefficients, variance
    basis = np.stack([np.ones_like(t), t, t**2], axis=-1) / scale
    a = basis[good] * known[good][..., None]
    y = np.where(known[good], y[good], 0.0)
    normal = np.einsum("tki,tkj->tij", a, a) + 1e-9 * np.eye(3)
    x = np.linalg.solve(normal, np.einsum("tki,tk->ti", a, y)[..., None])[..., 0]
    left = y - np.einsum("tki,ti->tk", a, x)
    free = known[good].sum(axis=1) - 3
    rows = np.flatnonzero(good) + m
    variance[rows] = (left**2).sum(axis=1) / np.maximum(free, 1)
    coefficients[rows] = x / scale
    return coefficients, variance


def _find_borrowers(
    time: Floats, own: Floats, m: int
) -> tuple[np.ndarray, np.ndarray, Floats]:
    """Samples without a parabola (T, 3) for which the nearest whole one may speak.

    Those near an episode's ends, and those around which readings are missing.

    Returns:
        Which (n), the nearest one with a parabola (n), and how far it is (n) [s].
    """
    gap, _ = choose_half_width(time)
    whole = np.isfinite(own[:, 0])
    good, lost = np.flatnonzero(whole), np.flatnonzero(~whole)
    if not good.size:
        return lost[:0], lost[:0], np.zeros(0)
    source = good[find_nearest(time[good], time[lost])]
    dt = time[lost] - time[source]
    close = np.abs(dt) <= 1.5 * gap * m
    return lost[close], source[close], dt[close]
