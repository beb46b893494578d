"""Recordings made ready to be compared: takes episodes, gives arrays on a grid."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import RecordingError
from ...recording import Episode, Recording
from ...recording.data import Floats, Place
from .local_polynomial import (
    LocalPolynomials,
    find_nearest,
    fit_polynomials,
    fit_rotations,
)
from .robot_summary import NOT_PREDICTED, Channel

LARGEST = 1e10  # of any number, in SI units: beyond it MuJoCo calls a state lost
LONGEST = 2e7  # steps of an episode; chosen: 0.2 GB an actuator


@dataclass(frozen=True, eq=False)
class SampledEpisode:
    """One episode.

    Attributes:
        id: of the episode; `file:id` where several files were given.
        start: time of its first sample [s].
        at: (T) sample times since then, in steps of the simulation.
        readings: (T, C) of all channels; NaN where missing.
        sent: (T, nu) commands, each held to the next sample.
        ctrl: (G, nu) mean command of each step of the grid.
        centered: (G, nu) mean command from half a step before to half a step after.
        near: through the neighbors of each sample.
        qpos0, qvel0: given state at the first sample, or None.
        number: of the episode, among all that were recorded.
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

    def interpolate(self, at: Floats, step: float) -> tuple[Floats, Floats]:
        """Value and slope (..., C) of all channels at times `at` [steps]."""
        rows = find_nearest(self.sample_steps, at)
        return self.polynomials.evaluate(rows, (at - self.sample_steps[rows]) * step)

    @property
    def with_half_step(self) -> "SampledEpisode":
        """The same, counted in steps of half the size."""
        at = 2 * self.sample_steps
        return replace(self, sample_steps=at, **_grid_commands(at, self.sent_ctrl))

    def with_late_commands(self, steps: float) -> "SampledEpisode":
        """The same with all commands but the first sent so many steps later."""
        at = np.append(self.sample_steps[0], self.sample_steps[1:] + steps)
        return replace(self, **_grid_commands(at, self.sent_ctrl))

    def truncate(self, step: int) -> "SampledEpisode":
        """The same with the commands of no more than so many steps."""
        return replace(
            self, ctrl=self.ctrl[:step], ctrl_centered=self.ctrl_centered[:step]
        )


def build_channels(
    recordings: Sequence[Recording], *, empty: bool = False
) -> tuple[Channel, ...]:
    """The signals that a model predicts; those without a reading only if `empty`."""
    episodes = [e for r in recordings for e in r.episodes.values()]
    found = collect_signal_meanings(recordings)
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
        scatter = np.sqrt(_pool_scatter(episodes, name))
        out.append(
            Channel(
                name, kind, target, unit, width, first,
                spread=float(np.sqrt(np.nanvar(stack, axis=0).sum())) or 1e-9,
                max_abs=float(np.nanmax(np.abs(stack))) or 1e-9,
                quantum=_find_quantum(stack) if width == 1 else 0.0,
                scatter=scatter, noise=scatter, ar1=np.zeros(width),
            )
        )  # fmt: skip
        first += width
    return tuple(out)


def collect_signal_meanings(
    recordings: Sequence[Recording],
) -> dict[str, tuple[str, str, str, int]]:
    """Kind, target, unit and width of each signal that a model predicts, by name.

    Raises:
        RecordingError: two episodes mean different things by one name, or a number is
            none that a robot has.
    """
    found: dict[str, tuple[str, str, str, int]] = {}
    for recording in recordings:
        for key, episode in recording.episodes.items():
            _check_magnitude(episode, Place(recording.file, key))
            for name, signal in episode.signals.items():
                if signal.kind in NOT_PREDICTED:
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


def _check_magnitude(episode: Episode, place: Place) -> None:
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


def _find_quantum(values: Floats) -> float:
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


def _pool_scatter(episodes: Sequence[Episode], name: str) -> Floats:
    """Variance (width) of a reading about its neighbors' parabola, robustly."""
    scatter = []
    for episode in episodes:
        if name in episode.signals:
            values = episode.signals[name].values.reshape(episode.time.size, -1)
            found = fit_polynomials(episode.time, values)
            scatter.append(np.where(found.is_borrowed, np.nan, found.scatter**2))
    both = np.concatenate(scatter)
    if not np.isfinite(both).any():
        return np.full(both.shape[1], np.nan)
    # a median would call the noise of a robot at rest the robot's
    return np.nanmean(np.clip(both, 0, 20 * np.nanmedian(both, axis=0)), axis=0)


def sample_episode(
    name: str, episode: Episode, signals: Sequence[Channel], step: float
) -> SampledEpisode:
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
                readings[:, c.columns] = _remove_sign_jumps(values)
    at = (time - time[0]) / step
    parts = [fit_polynomials(time, readings[:, :0])]  # of no signal, if there is none
    for c in signals:
        own = readings[:, c.columns]
        if c.kind == "body_orientation":
            parts.append(fit_rotations(time, own))
        else:
            parts.append(
                fit_polynomials(time, own).refit_first_samples(time, own, c.scatter)
            )
    return SampledEpisode(
        id=name,
        start=float(time[0]),
        sample_steps=at,
        readings=readings,
        sent_ctrl=episode.ctrl,
        **_grid_commands(at, episode.ctrl),
        polynomials=LocalPolynomials.concatenate(parts),
        qpos0=episode.qpos0,
        qvel0=episode.qvel0,
    )


def _remove_sign_jumps(quaternion: Floats) -> Floats:
    """The same orientations (T, 4) without jumps of sign."""
    out = quaternion.copy()
    known = np.flatnonzero(np.isfinite(out).all(axis=1))
    dots = np.sum(out[known[1:]] * out[known[:-1]], axis=1)
    out[known[1:]] *= np.cumprod(np.where(dots < 0, -1.0, 1.0))[:, None]
    return out


def _grid_commands(at: Floats, ctrl: Floats) -> dict[str, Any]:
    """The two grids of `Log` that hold what is sent at times `at`."""
    return {
        "ctrl": _average_over_steps(at, ctrl),
        "ctrl_centered": _average_centered(at, ctrl),
    }


def _average_over_steps(at: Floats, ctrl: Floats) -> Floats:
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


def _average_centered(at: Floats, ctrl: Floats) -> Floats:
    """As `_means`, half a step earlier; before the first sample its command holds."""
    return _average_over_steps(np.append(-0.5, at[1:]) + 0.5, ctrl)
