"""Faults put into clean recordings: takes a recording, gives it with one fault."""

import copy
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np

from benchmarks.recordings import (
    edit_episodes,
    edit_values,
    join_readings,
    select_rows,
)
from selfheal.recording import Episode, Recording
from selfheal.telemetry import Fault
from selfheal.telemetry.joints import JointColumns, list_joints

Values = np.ndarray
Change = Callable[[Values, Values], Values]
DEGREES = 180 / np.pi
DRIFT = 0.25  # [s] by which a clock is late when the longest episode ends
ODD_AMONG = 4  # episodes of which one is made odd
ODD_ZERO = 1.0  # of a position's standard deviation, by which a zero is off
SHORT = 15.0  # [s] in all, of a log whose clocks are not made to drift
HOLDS = (2, 9)  # samples that a repeated reading lasts, from and below
LATE_VELOCITY, LATE_COMMAND = 0.25, 0.45  # [s] that a column is late
# of the readings' span: a narrowed range, and one of which they are written as percent
RANGE_SHARE, PERCENT_SHARE = 0.6, 1.3


@dataclass(frozen=True)
class Injection:
    """One fault in one recording.

    Attributes:
        kinds: of faults that name it rightly.
        columns: that are at fault, or the episode; empty where it is the time.
        model: the given one, or with a narrowed range.
    """

    name: str
    kinds: tuple[str, ...]
    columns: frozenset[str]
    recording: Recording
    model: mujoco.MjModel


def judge(
    kinds: Collection[str], columns: frozenset[str], faults: list[Fault]
) -> tuple[bool, list[Fault], list[Fault]]:
    """Whether a known fault was found, what locates it, and what else was reported.

    Args:
        kinds: of faults that name it rightly.
        columns: that are at fault, or the episode; empty where there is none.
    """
    right = [f for f in faults if f.kind in kinds]
    located = [
        f
        for f in right
        if not columns or columns & {*f.columns, *f.episodes, *f.alternatives}
    ]
    return bool(right), located, [f for f in faults if f not in located]


@dataclass(frozen=True)
class _Log:
    """A clean recording and its model."""

    recording: Recording
    model: mujoco.MjModel

    @property
    def first(self) -> Episode:
        """The first episode."""
        return next(iter(self.recording.episodes.values()))

    @property
    def seconds(self) -> list[float]:
        """How long each episode is [s]."""
        return [float(np.ptp(e.time)) for e in self.recording.episodes.values()]

    def inject(
        self, name: str, kind: str, columns: Iterable[str], change: Change
    ) -> Injection:
        """The recording with changed columns, all of them at fault."""
        changed = change_columns(self.recording, frozenset(columns), change)
        return Injection(name, (kind,), frozenset(columns), changed, self.model)

    def inject_episodes(
        self, name: str, kind: str, change: Callable[[Episode], Episode]
    ) -> Injection:
        """The recording with changed episodes."""
        changed = edit_episodes(self.recording, change)
        return Injection(name, (kind,), frozenset(), changed, self.model)


def inject_faults(
    recording: Recording, model: mujoco.MjModel, rng: np.random.Generator
) -> Iterator[Injection]:
    """Every sort of fault that a recording can have, one after the other.

    A late column is only made where another one shows it: its velocity, or the command
    of a servo. Joints that are exchanged move differently.
    """
    log, every = _Log(recording, model), list_joints(recording, model).values()
    joints = [j for j in every if j.position and _moves(recording, j.position)]
    if joints:
        joint = joints[rng.integers(len(joints))]
        yield from _inject_joint(log, joint)
        samples = int(rng.integers(*HOLDS))
        if len(recording.episodes) >= ODD_AMONG:
            odd = str(rng.choice(list(recording.episodes)))
            yield from _inject_episode(log, joint, odd)
        hold = partial(_hold, samples)
        yield log.inject("repeated", "stale", joint.columns, hold)
        yield from _inject_range(log, joint)
    exchanges = dict[str, dict[str, str]]()
    if len(joints) > 1:
        one, other = (joints[i] for i in rng.permutation(len(joints))[:2])
        exchanges["exchange"] = dict(zip(one.columns, other.columns, strict=True))
    kinds = {n: s.kind for n, s in log.first.signals.items()}
    torques = [n for n, kind in kinds.items() if kind == "joint_torque"]
    if len(torques) > 1:
        exchanges["exchanged torques"] = {torques[0]: torques[1]}
    for name, columns in exchanges.items():
        both = columns | {b: a for a, b in columns.items()}
        exchanged = exchange_columns(recording, both)
        yield Injection(name, ("exchange",), frozenset(both), exchanged, model)
    for name in (n for n, kind in kinds.items() if kind == "body_orientation"):
        yield log.inject("order", "quaternion_order", [name], _roll)
    if min(log.seconds) > 2:
        yield log.inject_episodes("gap", "gap", _tear)
        yield log.inject_episodes("duplicates", "duplicate", _repeat)
    if sum(log.seconds) > SHORT:
        yield from _inject_drift(log, list(every))


def _inject_joint(log: _Log, joint: JointColumns) -> Iterator[Injection]:
    """Faults of one joint's columns in all episodes."""
    both, speed = joint.columns, [joint.velocity]
    yield log.inject("sign", "sign", both, _negate)
    yield log.inject("degrees", "unit", both, _write_degrees)
    if joint.velocity:
        yield log.inject("sign of a velocity", "sign", speed, _negate)
        yield log.inject("velocity in degrees", "unit", speed, _write_degrees)
    position = [joint.position]
    yield log.inject("frozen", "frozen", position, lambda t, x: 0 * x + x[0])
    if joint.velocity or joint.servo:
        late = LATE_VELOCITY if joint.velocity else LATE_COMMAND
        delayed = log.inject(
            "late", "delay", position, lambda t, x: _resample(t, t - late, x)
        )
        yield replace(delayed, columns=frozenset(both))


def _inject_episode(log: _Log, joint: JointColumns, odd: str) -> Iterator[Injection]:
    """One episode in which a joint's columns have another sign, unit or zero."""
    episode, position = log.recording.episodes[odd], [joint.position]
    zero = ODD_ZERO * float(np.nanstd(episode.signals[joint.position].values))
    changes: dict[str, tuple[Collection[str], Change]] = {
        "sign": (joint.columns, _negate),
        "degrees": (joint.columns, _write_degrees),
    }
    if joint.servo:  # nothing shows the zero of a cart or a wheel
        changes["zero"] = position, lambda t, x: x + zero
    for name, (columns, change) in changes.items():
        changed = _change(episode, columns, change)
        episodes = {**log.recording.episodes, odd: changed}
        wrong = replace(log.recording, episodes=episodes)
        names = f"{name} in one episode", ("odd_episode",), frozenset([odd])
        yield Injection(*names, wrong, log.model)


def _inject_range(log: _Log, joint: JointColumns) -> Iterator[Injection]:
    """Columns in percent of the joint's range, and a range that is too narrow."""
    both, position = frozenset(joint.columns), frozenset([joint.position])
    limited = _narrow(log, joint, PERCENT_SHARE)
    low, high = limited.jnt_range[joint.number]
    factor, zero = 100 / (high - low), -100 * low / (high - low)
    percent = change_columns(log.recording, both - position, lambda t, x: factor * x)
    percent = change_columns(percent, position, lambda t, x: factor * x + zero)
    yield Injection("percent of the range", ("unit",), both, percent, limited)
    narrow = _narrow(log, joint, RANGE_SHARE)
    yield Injection("range", ("joint_range",), position, log.recording, narrow)


def _inject_drift(log: _Log, joints: list[JointColumns]) -> Iterator[Injection]:
    """A clock that runs slow: of all velocities, or of all readings of servos."""
    slope = DRIFT / max(log.seconds)
    speeds = [j.velocity for j in joints if j.velocity and j.position]
    led = [j.position for j in joints if j.position and j.servo]

    def stretch(t: Values, x: Values) -> Values:
        return _resample(t, t - slope * (t - t[0]), x)

    if speeds:
        yield log.inject("drifting velocities", "clock_drift", speeds, stretch)
    if led:
        every = log.first.signals
        drifting = log.inject("drifting readings", "clock_drift", every, stretch)
        yield replace(drifting, columns=frozenset(led))


def _tear(e: Episode) -> Episode:
    """An episode with a gap in its middle."""
    return select_rows(e, np.abs(e.time - e.time.mean()) > 0.2)


def _repeat(e: Episode) -> Episode:
    """An episode in which every twentieth time comes again."""
    steps = np.diff(e.time, prepend=e.time[0] - 1)
    time = e.time.copy()
    time[5::20] = time[4::20][: len(time[5::20])] + 1e-4 * np.median(steps)
    return replace(e, time=time)


def change_columns(
    recording: Recording, columns: Collection[str], change: Change
) -> Recording:
    """A recording with some signals changed, by their times and values."""
    return edit_episodes(recording, lambda e: _change(e, columns, change))


def _change(e: Episode, columns: Collection[str], change: Change) -> Episode:
    """An episode with some signals changed; the state it begins with is left out."""
    changed = edit_values(e, lambda n, x: change(e.time, x) if n in columns else x)
    return replace(changed, qpos0=None, qvel0=None)


def exchange_columns(recording: Recording, columns: dict[str, str]) -> Recording:
    """A recording in which each of some columns has the readings of another."""

    def exchange(e: Episode) -> Episode:
        taken = edit_values(e, lambda n, x: e.signals[columns.get(n, n)].values)
        return replace(taken, qpos0=None, qvel0=None)

    return edit_episodes(recording, exchange)


def _negate(time: Values, x: Values) -> Values:
    return -x


def _write_degrees(time: Values, x: Values) -> Values:
    return DEGREES * x


def _roll(time: Values, x: Values) -> Values:
    return np.roll(x, -1, axis=1)


def _hold(samples: int, time: Values, x: Values) -> Values:
    """Readings of which each is repeated so often."""
    return x[np.arange(len(x)) // samples * samples]


def _resample(time: Values, late: Values, x: Values) -> Values:
    """Readings (T, ...) as they were at other times (T) [s]; gaps stay."""
    columns = x.reshape(len(time), -1)
    out = np.full(columns.shape, np.nan)
    for c, column in enumerate(columns.T):
        known = np.isfinite(column)
        if known.any():
            out[:, c] = np.interp(late, time[known], column[known])
    return np.where(np.isfinite(columns), out, np.nan).reshape(x.shape)


def _narrow(log: _Log, joint: JointColumns, share: float) -> mujoco.MjModel:
    """The model with a range of which the readings take a share, or leave it."""
    x = join_readings(log.recording, joint.position)
    low, high = np.nanquantile(x, [0.01, 0.99])
    narrowed = copy.copy(log.model)
    narrowed.jnt_limited[joint.number] = 1
    start = low - max(share - 1, 0) / 2 * (high - low)
    narrowed.jnt_range[joint.number] = start, start + share * (high - low)
    return narrowed


def _moves(recording: Recording, name: str) -> bool:
    return bool(np.nanstd(join_readings(recording, name)) > 0.05)
