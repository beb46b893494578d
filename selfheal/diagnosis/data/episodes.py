"""Sampled episodes: takes recordings, gives channels, and arrays on a grid of steps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np

from ...errors import RecordingError
from ...recording import Episode, Recording
from ...recording.data import Floats, Location
from .base_motion import BaseMotion
from .local_polynomial import (
    LocalPolynomials,
    find_nearest,
    fit_polynomials,
    fit_rotations,
)
from .robot_summary import NOT_PREDICTED, Channel

MAX_EPISODE_STEPS = 2e7  # of an episode; chosen: 0.2 GB for each actuator
MIN_SPREAD = 1e-9  # [unit] of a signal that does not move; chosen: not zero
# of rounded readings: least count of different values, quantile of the gaps between
# them that is the quantum, how far a gap may be off a multiple of it [quanta], share of
# the gaps that must not be, and how many times a value must occur; chosen
MIN_QUANTIZED_VALUES, QUANTUM_QUANTILE = 5, 0.1
MAX_OFF_QUANTUM, MIN_QUANTIZED_SHARE, MIN_VALUE_REPEATS = 0.05, 0.98, 3
MIN_RELATIVE_QUANTUM = 1e-12  # of the largest reading; chosen: the rounding of a float
# times the median of squared scatters, above which one does not count more; chosen: a
# jolt is no noise
MAX_SQUARED_SCATTER_RATIO = 20


@dataclass(frozen=True, eq=False)
class SampledEpisode:
    """An episode with T samples, on a grid of G simulation steps.

    Attributes:
        id: of the episode; `file:id` where several files were given.
        start: time of its first sample [s].
        sample_steps: (T) sample times since the first one [steps].
        readings: (T, C) of all channels [each channel's unit]; NaN where missing.
        sent_ctrl: (T, nu) commands [each control's unit], each held to the
            next sample.
        ctrl: (G, nu) mean command of each step.
        ctrl_centered: (G, nu) mean command from half a step before to half a step
            after each step's begin.
        polynomials: through the neighbors of each sample.
        qpos0: (nq) given position at the first sample, or None.
        qvel0: (nv) given velocity at the first sample, or None.
        number: of the episode among all that were recorded.
        base: how a floating base moved that no sensor of poses reads, or None.
    """

    id: str
    start: float
    sample_steps: Floats
    readings: Floats
    sent_ctrl: Floats
    ctrl: Floats
    ctrl_centered: Floats
    polynomials: LocalPolynomials
    qpos0: Floats | None
    qvel0: Floats | None
    number: int = 0
    base: BaseMotion | None = None

    def interpolate(self, at: Floats, step: float) -> tuple[Floats, Floats]:
        """Value and slope of all channels, by the polynomial of the nearest sample.

        Args:
            at: (W) times [steps].
            step: of the simulation [s].

        Returns:
            (W, C) [unit] and (W, C) [unit/s].
        """
        rows = find_nearest(self.sample_steps, at)
        return self.polynomials.evaluate(rows, (at - self.sample_steps[rows]) * step)

    def with_finer_steps(self, factor: float) -> "SampledEpisode":
        """This episode on a grid of so many times as many steps."""
        at = factor * self.sample_steps
        return replace(self, sample_steps=at, **_grid_commands(at, self.sent_ctrl))

    def with_late_commands(self, steps: float) -> "SampledEpisode":
        """This episode with all commands but the first sent so many steps later."""
        at = np.append(self.sample_steps[0], self.sample_steps[1:] + steps)
        return replace(self, **_grid_commands(at, self.sent_ctrl))

    def truncate(self, step: int) -> "SampledEpisode":
        """This episode with the commands of its first steps only."""
        return replace(
            self, ctrl=self.ctrl[:step], ctrl_centered=self.ctrl_centered[:step]
        )


def build_channels(
    recordings: Sequence[Recording], *, empty: bool = False
) -> tuple[Channel, ...]:
    """Make a channel of each signal that a model predicts, in the order of names.

    Args:
        recordings: with one meaning of each signal's name.
        empty: whether signals without a reading count.
    """
    episodes = [e for r in recordings for e in r.episodes.values()]
    meanings = collect_signal_meanings(recordings)
    channels, first = [], 0
    for name, (kind, target, unit, width) in sorted(meanings.items()):
        values = [
            e.signals[name].values.reshape(e.time.size, -1)
            for e in episodes
            if name in e.signals
        ]
        readings = np.concatenate(values)
        is_read = np.isfinite(readings).any(axis=0)
        if not (is_read.any() or empty):
            continue
        readings[:, ~is_read] = 1.0
        scatter = np.sqrt(_pool_scatter(episodes, name))
        channel = Channel(
            name,
            kind,
            target,
            unit,
            width,
            first,
            spread=max(float(np.sqrt(np.nanvar(readings, axis=0).sum())), MIN_SPREAD),
            max_abs=float(np.nanmax(np.abs(readings))) or MIN_SPREAD,
            quantum=_find_quantum(readings) if width == 1 else 0.0,
            scatter=scatter,
            noise=scatter,
            ar1=np.zeros(width),
        )
        noise = np.maximum(scatter, channel.rounding_noise)
        channels.append(replace(channel, noise=noise))
        first += width
    return tuple(channels)


def collect_signal_meanings(
    recordings: Sequence[Recording],
) -> dict[str, tuple[str, str, str, int]]:
    """Collect kind, target, unit and width of each signal that a model predicts.

    Returns:
        By the signals' names.

    Raises:
        RecordingError: two episodes mean different things by one name.
    """
    meanings: dict[str, tuple[str, str, str, int]] = {}
    for recording in recordings:
        for key, episode in recording.episodes.items():
            for name, signal in episode.signals.items():
                if signal.kind in NOT_PREDICTED:
                    continue
                width = 1 if signal.values.ndim == 1 else signal.values.shape[1]
                meaning = signal.kind, signal.target, signal.unit, width
                known = meanings.setdefault(name, meaning)
                if known != meaning:
                    words = [
                        f"{k} of {t!r} in {u!r}" for k, t, u, _ in (meaning, known)
                    ]
                    raise Location(recording.file, key, name).make_error(
                        f"{words[0]} here and {words[1]} in another episode; would "
                        "fit: a name for each"
                    )
    return meanings


def _find_quantum(values: Floats) -> float:
    """Find the quantum of rounded values, 0 where they are not rounded."""
    different = np.unique(values[np.isfinite(values)])
    if different.size < MIN_QUANTIZED_VALUES:
        return 0.0
    gaps = np.diff(different)
    quantum = float(np.quantile(gaps, QUANTUM_QUANTILE))
    if quantum <= MIN_RELATIVE_QUANTUM * max(np.abs(different).max(), 1e-300):
        return 0.0
    ratio = gaps / quantum
    is_multiple = np.abs(ratio - np.round(ratio)) < MAX_OFF_QUANTUM
    is_quantized = is_multiple.mean() > MIN_QUANTIZED_SHARE
    repeats = different.size < values.size / MIN_VALUE_REPEATS
    return quantum if is_quantized and repeats else 0.0


def _pool_scatter(episodes: Sequence[Episode], name: str) -> Floats:
    """Variance (width) of a signal about its local parabolas [unit^2], robustly.

    It is a mean, of which outliers are clipped: a median would take the noise of a
    robot at rest for the noise of the robot. A column that is never read has the mean
    of the others, as nothing depends on it.
    """
    squares = []
    for episode in episodes:
        if name in episode.signals:
            values = episode.signals[name].values.reshape(episode.time.size, -1)
            fit = fit_polynomials(episode.time, values)
            squares.append(np.where(fit.is_borrowed, np.nan, fit.scatter**2))
    square = np.concatenate(squares)
    is_known = np.isfinite(square).any(axis=0)
    pooled = np.full(square.shape[1], np.nan)
    if is_known.any():
        square = square[:, is_known]
        limit = MAX_SQUARED_SCATTER_RATIO * np.nanmedian(square, axis=0)
        pooled[is_known] = np.nanmean(np.clip(square, 0, limit), axis=0)
        pooled[~is_known] = pooled[is_known].mean()
    return pooled


def sample_episode(
    name: str, episode: Episode, channels: Sequence[Channel], step: float
) -> SampledEpisode:
    """Put an episode on a grid of simulation steps.

    Args:
        episode: with T samples, and commands in the model's order.
        channels: of which its readings are taken.
        step: of the simulation [s].

    Raises:
        RecordingError: it lasts longer than can be simulated.
    """
    time = episode.time
    if (time[-1] - time[0]) / step > MAX_EPISODE_STEPS:
        raise RecordingError(
            f"episode {name!r} lasts {time[-1] - time[0]:.4g} s, which are "
            f"{(time[-1] - time[0]) / step:.2g} steps of the model's {step:g} s; would "
            f"fit: at most {MAX_EPISODE_STEPS:.0e} steps: times in s, several "
            "episodes, or a larger timestep"
        )
    readings = np.full((time.size, sum(c.width for c in channels)), np.nan)
    for c in channels:
        if c.name in episode.signals:
            values = episode.signals[c.name].values.reshape(time.size, -1)
            readings[:, c.columns] = values
            if c.kind == "body_orientation":
                readings[:, c.columns] = _remove_sign_jumps(values)
    sample_steps = (time - time[0]) / step
    parts = [fit_polynomials(time, readings[:, :0])]  # of no channel, if there is none
    for c in channels:
        values = readings[:, c.columns]
        if c.kind == "body_orientation":
            parts.append(fit_rotations(time, values))
            continue
        fit = fit_polynomials(time, values)
        parts.append(fit.refit_first_samples(time, values, c.scatter))
    return SampledEpisode(
        id=name,
        start=float(time[0]),
        sample_steps=sample_steps,
        readings=readings,
        sent_ctrl=episode.ctrl,
        **_grid_commands(sample_steps, episode.ctrl),
        polynomials=LocalPolynomials.concatenate(parts),
        qpos0=episode.qpos0,
        qvel0=episode.qvel0,
    )


def _remove_sign_jumps(quaternion: Floats) -> Floats:
    """Choose signs of quaternions (T, 4) so that none jumps: q and -q turn alike."""
    out = quaternion.copy()
    known = np.flatnonzero(np.isfinite(out).all(axis=1))
    dots = np.sum(out[known[1:]] * out[known[:-1]], axis=1)
    out[known[1:]] *= np.cumprod(np.where(dots < 0, -1.0, 1.0))[:, None]
    return out


class _Grids(TypedDict):
    """Both grids of commands of a `SampledEpisode`."""

    ctrl: Floats
    ctrl_centered: Floats


def _grid_commands(at: Floats, ctrl: Floats) -> _Grids:
    """Both grids of `SampledEpisode` of commands (T, nu) sent at times `at` [steps].

    Centered ones are over steps that begin half a step earlier; the first command holds
    before 0.
    """
    centered = np.append(-0.5, at[1:]) + 0.5
    return {
        "ctrl": _average_over_steps(at, ctrl),
        "ctrl_centered": _average_over_steps(centered, ctrl),
    }


def _average_over_steps(at: Floats, ctrl: Floats) -> Floats:
    """Average commands, each held from its sample to the next, over each step.

    Means are differences of the commands' integral at the steps' edges, divided by
    their distance of 1 step.

    Args:
        at: (T) sample times, from 0 [steps].
        ctrl: (T, nu) commands sent then.

    Returns:
        (G, nu); G is two more than the steps to the last sample.
    """
    steps = int(np.ceil(at[-1])) + 2
    ends = np.append(at[1:], max(at[-1] + 1, steps + 1.0))
    sums = np.cumsum(ctrl * (ends - at)[:, None], 0)
    total, knots = np.vstack([np.zeros(ctrl.shape[1]), sums]), np.append(at, ends[-1])
    edges = np.arange(steps + 1.0)
    at_edges = [np.interp(edges, knots, total[:, i]) for i in range(ctrl.shape[1])]
    return np.diff(np.array(at_edges).reshape(ctrl.shape[1], steps + 1), axis=1).T
