"""Recordings made ready to be compared: takes episodes, gives arrays on a grid."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..errors import RecordingError
from ..recording import Episode, Recording
from ..recording.data import Floats, Place
from .scene import IGNORED, Channel

# half width [s] of the parabola that says where the robot was and how fast, and the
# least of samples on each side; chosen: 50 ms in all, as the contract's score has it
HALF_WIDTH, LEAST = 0.022, 2
REACH = 3.0  # times that, the farthest that irregular samples may lie; chosen
INSTANT = 1e-4  # [s] over which a turn's rate is told
LARGEST = 1e10  # of any number, in SI units: beyond it MuJoCo calls a state lost
LONGEST = 2e7  # steps of an episode; chosen: 0.2 GB an actuator


@dataclass(frozen=True, eq=False)
class Log:
    """One episode.

    Attributes:
        id: of the episode; `file:id` where several files were given.
        start: time of its first sample [s].
        at: (T) sample times since then, in steps of the simulation.
        readings: (T, C) of all channels; NaN where missing.
        sent: (T, nu) commands, each held to the next sample.
        ctrl: (G, nu) mean command of each step of the grid.
        centered: (G, nu) mean command from half a step before to half a step after.
        parabola: (T, C, 3) through the neighbors of each sample: value, slope [1/s],
            half the curvature; NaN where too few.
        scatter: (T, C) standard deviation of those neighbors about it.
        qpos0, qvel0: given state at the first sample, or None.
    """

    id: str
    start: float
    at: Floats
    readings: Floats
    sent: Floats
    ctrl: Floats
    centered: Floats
    parabola: Floats
    scatter: Floats
    qpos0: Floats | None
    qvel0: Floats | None

    def smooth(self, at: Floats, step: float) -> tuple[Floats, Floats]:
        """Value and slope (..., C) of all channels at times `at` [steps]."""
        near = nearest(self.at, at)
        return _along(self.parabola[near], ((at - self.at[near]) * step)[..., None])

    @property
    def halved(self) -> "Log":
        """The same, counted in steps of half the size."""
        at = 2 * self.at
        return replace(self, at=at, **_grids(at, self.sent))

    def later(self, steps: float) -> "Log":
        """The same with all commands but the first sent so many steps later."""
        at = np.append(self.at[0], self.at[1:] + steps)
        return replace(self, **_grids(at, self.sent))

    def until(self, step: int) -> "Log":
        """The same with the commands of no more than so many steps."""
        return replace(self, ctrl=self.ctrl[:step], centered=self.centered[:step])


def _along(a: Floats, dt: Floats) -> tuple[Floats, Floats]:
    """Value and slope (...) of parabolas (..., 3), `dt` [s] from where they stand."""
    return a[..., 0] + dt * (a[..., 1] + dt * a[..., 2]), a[..., 1] + 2 * dt * a[..., 2]


def nearest(times: Floats, at: Floats) -> np.ndarray:
    """Number of the sample nearest in time."""
    right = np.clip(np.searchsorted(times, at), 1, max(len(times) - 1, 1))
    right = np.minimum(right, len(times) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(at - times[left] <= times[right] - at, left, right)


def channels(
    recordings: Sequence[Recording], *, empty: bool = False
) -> tuple[Channel, ...]:
    """The signals that a model predicts; those without a reading only if `empty`."""
    episodes = [e for r in recordings for e in r.episodes.values()]
    found = meanings(recordings)
    out, first = [], 0
    for name, (kind, target, unit, width) in sorted(found.items()):
        values = [
            e.signals[name].values.reshape(e.time.size, -1)
            for e in episodes
            if name in e.signals
        ]
        stack = np.concatenate(values)
        if not np.isfinite(stack).any():
            if not empty:
                continue
            stack = np.ones_like(stack)
        scatter = np.sqrt(_pooled(episodes, name))
        out.append(
            Channel(
                name, kind, target, unit, width, first,
                spread=float(np.sqrt(np.nanvar(stack, axis=0).sum())) or 1e-9,
                reach=float(np.nanmax(np.abs(stack))) or 1e-9,
                lattice=_lattice(stack) if width == 1 else 0.0,
                scatter=scatter, noise=scatter, memory=np.zeros(width),
            )
        )  # fmt: skip
        first += width
    return tuple(out)


def meanings(recordings: Sequence[Recording]) -> dict[str, tuple[str, str, str, int]]:
    """Kind, target, unit and width of each signal that a model predicts, by name.

    Raises:
        RecordingError: two episodes mean different things by one name, or a number is
            none that a robot has.
    """
    found: dict[str, tuple[str, str, str, int]] = {}
    for recording in recordings:
        for key, episode in recording.episodes.items():
            _check_size(episode, Place(recording.file, key))
            for name, signal in episode.signals.items():
                if signal.kind in IGNORED:
                    continue
                width = 1 if signal.values.ndim == 1 else signal.values.shape[1]
                its = signal.kind, signal.target, signal.unit, width
                if found.setdefault(name, its) != its:
                    words = [
                        f"{k} of {t!r} in {u!r}" for k, t, u, _ in (its, found[name])
                    ]
                    raise Place(recording.file, key, name).error(
                        f"{words[0]} here and {words[1]} in another episode; would "
                        "fit: a name for each"
                    )
    return found


def _check_size(episode: Episode, place: Place) -> None:
    held = {"time": episode.time, "ctrl": episode.ctrl, "qpos0": episode.qpos0,
            "qvel0": episode.qvel0}  # fmt: skip
    held |= {f"signal {name!r}": s.values for name, s in episode.signals.items()}
    for name, values in held.items():
        if values is not None and (np.abs(values) > LARGEST).any():
            value = values[np.abs(values) > LARGEST][0]
            raise place.error(
                f"{name} holds {value:.4g}; would fit: SI units, and no number beyond "
                f"{LARGEST:g}"
            )


def _lattice(values: Floats) -> float:
    """The step of values that lie on a lattice, 0 where they do not."""
    seen = np.unique(values[np.isfinite(values)])
    if seen.size < 5:
        return 0.0
    gaps = np.diff(seen)
    step = float(np.quantile(gaps, 0.1))
    if step <= 1e-12 * max(np.abs(seen).max(), 1e-300):
        return 0.0
    ratio = gaps / step
    on = np.abs(ratio - np.round(ratio)) < 0.05
    return step if on.mean() > 0.98 and seen.size < values.size / 3 else 0.0


def _pooled(episodes: Sequence[Episode], name: str) -> Floats:
    """Variance (width) of a reading about its neighbors' parabola, robustly."""
    scatter = []
    for episode in episodes:
        if name in episode.signals:
            values = episode.signals[name].values.reshape(episode.time.size, -1)
            scatter.append(_parabola(episode.time, values)[1])
    both = np.concatenate(scatter)
    if not np.isfinite(both).any():
        return np.full(both.shape[1], np.nan)
    # a median would call the noise of a robot at rest the robot's
    return np.nanmean(np.clip(both, 0, 20 * np.nanmedian(both, axis=0)), axis=0)


def log(name: str, episode: Episode, signals: Sequence[Channel], step: float) -> Log:
    """An episode on a grid of `step` s.

    Raises:
        RecordingError: it lasts longer than can be simulated.
    """
    time = episode.time
    if (time[-1] - time[0]) / step > LONGEST:
        raise RecordingError(
            f"episode {name!r} lasts {time[-1] - time[0]:.4g} s, which are "
            f"{(time[-1] - time[0]) / step:.2g} steps of the model's {step:g} s; would "
            f"fit: at most {LONGEST:.0e} steps: times in s, several episodes, or a "
            "larger timestep"
        )
    readings = np.full((time.size, sum(c.width for c in signals)), np.nan)
    for c in signals:
        if c.name in episode.signals:
            values = episode.signals[c.name].values.reshape(time.size, -1)
            readings[:, c.columns] = values
            if c.kind == "body_orientation":
                readings[:, c.columns] = _continuous(values)
    at = (time - time[0]) / step
    parabola, variance = np.empty((*readings.shape, 3)), np.empty(readings.shape)
    for c in signals:
        through = _turning if c.kind == "body_orientation" else _parabola
        parabola[:, c.columns], variance[:, c.columns] = through(
            time, readings[:, c.columns]
        )
    return Log(
        id=name, start=float(time[0]), at=at, readings=readings, sent=episode.ctrl,
        **_grids(at, episode.ctrl), parabola=parabola, scatter=np.sqrt(variance),
        qpos0=episode.qpos0, qvel0=episode.qvel0,
    )  # fmt: skip


def _continuous(quaternion: Floats) -> Floats:
    """The same orientations (T, 4) without jumps of sign."""
    out = quaternion.copy()
    known = np.flatnonzero(np.isfinite(out).all(axis=1))
    dots = np.sum(out[known[1:]] * out[known[:-1]], axis=1)
    out[known[1:]] *= np.cumprod(np.where(dots < 0, -1.0, 1.0))[:, None]
    return out


def _grids(at: Floats, ctrl: Floats) -> dict[str, Any]:
    """The two grids of `Log` that hold what is sent at times `at`."""
    return {"ctrl": _means(at, ctrl), "centered": _centered(at, ctrl)}


def _means(at: Floats, ctrl: Floats) -> Floats:
    """Mean (G, nu) over each step of commands held from their sample to the next."""
    steps = int(np.ceil(at[-1])) + 2
    ends = np.append(at[1:], max(at[-1] + 1, steps + 1.0))
    total = np.vstack(
        [np.zeros(ctrl.shape[1]), np.cumsum(ctrl * (ends - at)[:, None], 0)]
    )
    knots = np.append(at, ends[-1])
    edges = np.arange(steps + 1.0)
    at_edges = [np.interp(edges, knots, total[:, i]) for i in range(ctrl.shape[1])]
    return np.diff(np.array(at_edges).reshape(ctrl.shape[1], steps + 1), axis=1).T


def _centered(at: Floats, ctrl: Floats) -> Floats:
    """As `_means`, half a step earlier; before the first sample its command holds."""
    return _means(np.append(-0.5, at[1:]) + 0.5, ctrl)


def neighbors(time: Floats) -> tuple[float, int]:
    """Usual distance [s] of samples, and how many on each side a parabola looks at."""
    gap = float(np.median(np.diff(time))) if time.size > 1 else 1.0
    return gap, max(LEAST, int(round(HALF_WIDTH / gap)))


@cache
def of_slow_noise(memory: float, m: int) -> tuple[float, float, float]:
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


def _parabola(time: Floats, readings: Floats) -> tuple[Floats, Floats]:
    """Through the neighbors of each sample: coefficients (T, C, 3), variance (T, C)."""
    coefficients = np.full((*readings.shape, 3), np.nan)
    variance = np.full(readings.shape, np.nan)
    _, m = neighbors(time)
    if len(time) < 2 * m + 1:
        return coefficients, variance
    for c in range(readings.shape[1]):
        y = sliding_window_view(readings[:, c], 2 * m + 1)
        own, variance[:, c] = _through(time, y)
        coefficients[:, c] = own
        lost, source, dt = _reached(time, own)
        a = own[source]
        coefficients[lost, c] = np.stack([*_along(a, dt), a[:, 2]], axis=1)
    return coefficients, variance


def _turning(time: Floats, quaternion: Floats) -> tuple[Floats, Floats]:
    """As `_parabola` of an orientation (T, 4), through rotations from each sample.

    Those of a body that turns evenly lie on a line, however fast it turns; quaternions
    do not.
    """
    from scipy.spatial.transform import Rotation

    coefficients = np.full((*quaternion.shape, 3), np.nan)
    variance = np.full(quaternion.shape, np.nan)
    _, m = neighbors(time)
    known = np.asarray(np.isfinite(quaternion).all(axis=1))
    if len(time) < 2 * m + 1:
        return coefficients, variance
    whole = np.where(known[:, None], quaternion, [1.0, 0, 0, 0])
    near = sliding_window_view(np.arange(len(time)), 2 * m + 1)
    width = near.shape[1]
    origin = np.repeat(near[:, m], width)
    turn = Rotation.from_quat(whole, scalar_first=True)
    away = (turn[origin].inv() * turn[near.ravel()]).as_rotvec()
    told = known[near] & known[near[:, m]][:, None]
    away = np.where(told[..., None], away.reshape(len(near), width, 3), np.nan)
    found = [_through(time, away[..., k]) for k in range(3)]
    own = np.stack([a for a, _ in found], axis=1)  # (T, 3, 3)
    each = np.stack([v for _, v in found], axis=1) / 4  # of a quaternion's vector part
    variance[:] = np.column_stack([each.mean(axis=1), each])
    lost, source, dt = _reached(time, own[:, 0])
    good = np.flatnonzero(np.isfinite(own[:, 0, 0]))
    rows, source = np.append(good, lost), np.append(good, source)
    dt = np.append(np.zeros(len(good)), dt)
    before, now, after = (
        _turned(whole[source], _along(own[source], (dt + k * INSTANT)[:, None])[0])
        for k in (-1, 0, 1)
    )
    slope = (after - before) / (2 * INSTANT)
    bend = (after - 2 * now + before) / (2 * INSTANT**2)
    coefficients[rows] = np.stack([now, slope, bend], axis=-1)
    return coefficients, variance


def _turned(quaternion: Floats, by: Floats) -> Floats:
    """Orientations (n, 4) turned by rotation vectors (n, 3) of their own frames."""
    from scipy.spatial.transform import Rotation

    if not len(by):
        return quaternion
    start = Rotation.from_quat(quaternion, scalar_first=True)
    turned = (start * Rotation.from_rotvec(by)).as_quat(scalar_first=True)
    return turned * np.where((turned * quaternion).sum(axis=1) < 0, -1, 1)[:, None]


def _through(time: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Parabolas through neighbors: coefficients (T, 3), variance (T); NaN at the ends.

    Args:
        time: (T) [s].
        y: (T - 2 m, 2 m + 1), the neighbors of each sample but the first and last m.
    """
    gap, m = neighbors(time)
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


def _reached(time: Floats, own: Floats) -> tuple[np.ndarray, np.ndarray, Floats]:
    """Samples without a parabola (T, 3) for which the nearest whole one may speak.

    Those near an episode's ends, and those around which readings are missing.

    Returns:
        Which (n), the nearest one with a parabola (n), and how far it is (n) [s].
    """
    gap, m = neighbors(time)
    whole = np.isfinite(own[:, 0])
    good, lost = np.flatnonzero(whole), np.flatnonzero(~whole)
    if not good.size:
        return lost[:0], lost[:0], np.zeros(0)
    source = good[nearest(time[good], time[lost])]
    dt = time[lost] - time[source]
    close = np.abs(dt) <= 1.5 * gap * m
    return lost[close], source[close], dt[close]
