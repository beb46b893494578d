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


def inject_faults(
    recording: Recording, model: mujoco.MjModel, rng: np.random.Generator
) -> Iterator[Injection]:
    """Every sort of fault that a recording can have, one after the other.

    A late column is only made where another one shows it: its velocity, or the command
    of a servo. Joints that are exchanged move differently.
    """
    every = list_joints(recording, model).values()
    joints = [j for j in every if j.position and _moves(recording, j.position)]

    def inject(
        name: str, kind: str, columns: Iterable[str], change: Change
    ) -> Injection:
        changed = change_columns(recording, frozenset(columns), change)
        return Injection(name, (kind,), frozenset(columns), changed, model)

    if joints:
        joint = joints[rng.integers(len(joints))]
        yield from _inject_joint(joint, inject)
        samples = int(rng.integers(*HOLDS))
        if len(recording.episodes) >= ODD_AMONG:
            yield from _inject_episode(recording, model, joint, rng)
        yield inject(
            "repeated",
            "stale",
            joint.columns,
            lambda t, x: x[np.arange(len(x)) // samples * samples],
        )
        yield from _inject_range(recording, model, joint)
    first = next(iter(recording.episodes.values())).signals
    exchanges = list[tuple[str, dict[str, str]]]()
    if len(joints) > 1:
        one, other = (joints[i] for i in rng.permutation(len(joints))[:2])
        columns = dict(zip(one.columns, other.columns, strict=True))
        exchanges.append(("exchange", columns))
    torques = [n for n, s in first.items() if s.kind == "joint_torque"]
    if len(torques) > 1:
        exchanges.append(("exchanged torques", {torques[0]: torques[1]}))
    for name, columns in exchanges:
        both = columns | {b: a for a, b in columns.items()}
        exchanged = exchange_columns(recording, both)
        yield Injection(name, ("exchange",), frozenset(both), exchanged, model)
    for name, signal in first.items():
        if signal.kind == "body_orientation":
            yield inject(
                "order", "quaternion_order", [name], lambda t, x: np.roll(x, -1, axis=1)
            )
    yield from _inject_times(recording, model)
    yield from _inject_drift(recording, model)


def _inject_joint(
    joint: JointColumns, inject: Callable[..., Injection]
) -> Iterator[Injection]:
    """Faults of one joint's columns in all episodes."""
    velocity = [("sign of a velocity", "velocity in degrees", [joint.velocity])]
    for sign, degrees, columns in (
        ("sign", "degrees", joint.columns),
        *velocity[: bool(joint.velocity)],
    ):
        yield inject(sign, "sign", columns, lambda t, x: -x)
        yield inject(degrees, "unit", columns, lambda t, x: DEGREES * x)
    yield inject("frozen", "frozen", [joint.position], lambda t, x: 0 * x + x[0])
    if joint.velocity or joint.servo:
        late = LATE_VELOCITY if joint.velocity else LATE_COMMAND
        delayed = inject("late", "delay", [joint.position], partial(_delay, late))
        yield replace(delayed, columns=frozenset(joint.columns))


def _inject_episode(
    recording: Recording,
    model: mujoco.MjModel,
    joint: JointColumns,
    rng: np.random.Generator,
) -> Iterator[Injection]:
    """One episode in which a joint's columns have another sign, unit or zero."""
    odd = str(rng.choice(list(recording.episodes)))
    both, position = frozenset(joint.columns), frozenset([joint.position])
    readings = recording.episodes[odd].signals[joint.position].values
    spread = float(np.nanstd(readings))
    for name, columns, factor, zero in (
        ("sign in one episode", both, -1.0, 0.0),
        ("degrees in one episode", both, DEGREES, 0.0),
        ("zero in one episode", position, 1.0, ODD_ZERO * spread),
    ):
        if zero and not joint.servo:
            continue  # nothing shows the zero of a cart or a wheel
        change = partial(_rescale, factor=factor, zero=zero)
        changed = _change(recording.episodes[odd], columns, change)
        wrong = replace(recording, episodes={**recording.episodes, odd: changed})
        yield Injection(name, ("odd_episode",), frozenset([odd]), wrong, model)


def _inject_range(
    recording: Recording, model: mujoco.MjModel, joint: JointColumns
) -> Iterator[Injection]:
    """Columns in percent of the joint's range, and a range that is too narrow."""
    both, position = frozenset(joint.columns), frozenset([joint.position])
    limited = _narrow(recording, model, joint, PERCENT_SHARE)
    low, high = limited.jnt_range[joint.number]
    rescale = partial(_rescale, factor=100 / (high - low))
    percent = change_columns(recording, both - position, partial(rescale, zero=0.0))
    zero = -100 * low / (high - low)
    percent = change_columns(percent, position, partial(rescale, zero=zero))
    yield Injection("percent of the range", ("unit",), both, percent, limited)
    narrow = _narrow(recording, model, joint, RANGE_SHARE)
    yield Injection("range", ("joint_range",), position, recording, narrow)


def _inject_drift(recording: Recording, model: mujoco.MjModel) -> Iterator[Injection]:
    """A clock that runs slow: of all velocities, or of all readings of servos."""
    joints = list_joints(recording, model).values()
    longest = max(float(np.ptp(e.time)) for e in recording.episodes.values())
    speeds = frozenset(j.velocity for j in joints if j.velocity and j.position)
    led = frozenset(j.position for j in joints if j.position and j.servo)
    first = next(iter(recording.episodes.values()))
    for name, columns, of in (
        ("drifting velocities", speeds, speeds),
        ("drifting readings", frozenset(first.signals), led),
    ):
        if of and sum(np.ptp(e.time) for e in recording.episodes.values()) > SHORT:
            change = partial(_stretch, slope=DRIFT / longest)
            drifting = change_columns(recording, columns, change)
            yield Injection(name, ("clock_drift",), of, drifting, model)


def _inject_times(recording: Recording, model: mujoco.MjModel) -> Iterator[Injection]:
    def tear(e: Episode) -> Episode:
        return select_rows(e, np.abs(e.time - e.time.mean()) > 0.2)

    def repeat(e: Episode) -> Episode:
        steps = np.diff(e.time, prepend=e.time[0] - 1)
        time = e.time.copy()
        time[5::20] = time[4::20][: len(time[5::20])] + 1e-4 * np.median(steps)
        return replace(e, time=time)

    if min(e.time[-1] - e.time[0] for e in recording.episodes.values()) > 2:
        for name, kind, change in (
            ("gap", "gap", tear),
            ("duplicates", "duplicate", repeat),
        ):
            yield Injection(
                name, (kind,), frozenset(), edit_episodes(recording, change), model
            )


def change_columns(
    recording: Recording, columns: Collection[str], change: Change
) -> Recording:
    """A recording with some signals changed, by their times and values."""
    return edit_episodes(recording, lambda e: _change(e, columns, change))


def _change(e: Episode, columns: Collection[str], change: Change) -> Episode:
    """An episode with some signals changed; the state it begins with is left out."""
    changed = edit_values(e, lambda n, x: change(e.time, x) if n in columns else x)
    return replace(changed, qpos0=None, qvel0=None)


def _rescale(time: Values, x: Values, factor: float, zero: float) -> Values:
    """Readings in another unit, with another zero."""
    return factor * x + zero


def exchange_columns(recording: Recording, columns: dict[str, str]) -> Recording:
    """A recording in which each of some columns has the readings of another."""

    def exchange(e: Episode) -> Episode:
        taken = edit_values(e, lambda n, x: e.signals[columns.get(n, n)].values)
        return replace(taken, qpos0=None, qvel0=None)

    return edit_episodes(recording, exchange)


def _delay(seconds: float, time: Values, x: Values) -> Values:
    known = np.isfinite(x)
    late = np.interp(time - seconds, time[known], x[known])
    return np.where(known, late, np.nan)


def _narrow(
    recording: Recording, model: mujoco.MjModel, joint: JointColumns, share: float
) -> mujoco.MjModel:
    """The model with a range of which the readings take a share, or leave it."""
    x = join_readings(recording, joint.position)
    low, high = np.nanquantile(x, [0.01, 0.99])
    narrowed = copy.copy(model)
    narrowed.jnt_limited[joint.number] = 1
    start = low - max(share - 1, 0) / 2 * (high - low)
    narrowed.jnt_range[joint.number] = start, start + share * (high - low)
    return narrowed


def _moves(recording: Recording, name: str) -> bool:
    return bool(np.nanstd(join_readings(recording, name)) > 0.05)


def _stretch(time: Values, x: Values, slope: float) -> Values:
    """Readings (T, ...) that come later by `slope` each second."""
    late = time - slope * (time - time[0])
    columns = x.reshape(len(time), -1)
    out = np.full(columns.shape, np.nan)
    for c, column in enumerate(columns.T):
        known = np.isfinite(column)
        if known.any():
            out[:, c] = np.interp(late, time[known], column[known])
    return np.where(np.isfinite(columns), out, np.nan).reshape(x.shape)
