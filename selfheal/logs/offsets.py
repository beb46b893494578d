"""Clocks of streams against each other: an episode and a model in; offsets out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..recording import Episode
from .base import Floats
from .log_map import COMMAND
from .model_facts import list_places
from .motion import compare_command

if TYPE_CHECKING:
    import mujoco

_MAX_SHIFT, _STEP = 0.5, 0.005  # [s] of what is tried; chosen
_SMOOTHING = 0.06  # [s] over which positions give a speed; chosen
_GRID = 4000  # times at which the robot is placed; chosen
_SAME_LAG = 0.03  # [s] between lags that may be one shift; chosen
_NEAR = 4  # shifts on either side of the best that give the parabola's top; chosen
_BLOCKS = 8  # parts of an episode, each of which gives an estimate; chosen
_LEAST_CORRELATION = 0.9  # below, a stream does not follow the joints; chosen
_LEAST_ROWS = 40  # of a part of a stream; chosen
_CONFIDENCE = 0.9  # of an interval: the contract's


@dataclass(frozen=True)
class Offset:
    """By how much the clock of a stream is late against that of the joints.

    Attributes:
        reference: stream of the joints' positions.
        seconds: to be subtracted from the stream's times [s].
        low: end of its 90 % interval [s].
        high: other end [s].
        correlation: of the stream's signals with those of the joints, at the best
            shift.
    """

    stream: str
    reference: str
    seconds: float
    low: float
    high: float
    correlation: float


class _Motion(NamedTuple):
    """Times (K) [s], positions (K, nq) and speeds (K, nv) of a robot."""

    time: Floats
    qpos: Floats
    qvel: Floats


@dataclass(frozen=True)
class _Pair:
    """A signal and what the joints' positions make of it.

    Attributes:
        time: (n) [s] of the signal.
        values: (n, d) of the signal.
        predicted: (K, d) at the times of the grid.
    """

    time: Floats
    values: Floats
    predicted: Floats


def estimate_offsets(
    episode: Episode, streams: Mapping[str, str], model: "mujoco.MjModel"
) -> list[Offset]:
    """Estimate the offsets of all clocks that the kinematics tie to the joints'.

    Poses, their speeds and gyroscopes follow from positions of all joints, where the
    base is fixed; speeds of joints follow from their positions. The shift is that at
    which the correlation is largest; its interval comes of parts of the episode
    (Student's t over their estimates).

    Args:
        streams: the log's stream of each signal of the episode.

    Returns:
        An offset for each stream that moves as the joints do; none where the robot's
        joints are not all read by one stream.
    """
    positions: dict[str, list[str]] = {}
    for name, signal in episode.signals.items():
        if signal.kind == "joint_position":
            positions.setdefault(streams[name], []).append(name)
    if not positions or len(set(streams.values())) < 2:
        return []
    reference = max(positions, key=lambda stream: len(positions[stream]))
    placed = _place_robot(episode, positions[reference], model)
    if placed is None:
        return []
    names = [n for n in episode.signals if streams[n] != reference]
    pairs = dict[str, list[_Pair]]()
    for name, predicted in _predict_signals(episode, names, model, placed).items():
        if pair := _make_pair(episode, name, predicted):
            pairs.setdefault(streams[name], []).append(pair)
    found = (_estimate(placed.time, pairs[s], s, reference) for s in pairs)
    return [offset for offset in found if offset]


def find_common_lag(
    episode: Episode,
    streams: Mapping[str, str],
    sources: Mapping[str, str],
    model: "mujoco.MjModel",
) -> tuple[float, float] | None:
    """By how much all positions follow their commands, where their clocks may differ.

    Args:
        streams: the log's stream of each signal.
        sources: the log's stream of each actuator's command.

    Returns:
        Shortest and longest lag [s]; None where commands and positions share a stream,
        or where the lags do not agree.
    """
    kind, signals = "joint_position", episode.signals.items()
    positions = {s.target: name for name, s in signals if s.kind == kind}
    places = {p.name: p for p in list_places(model) if p.kind == COMMAND}
    lags = []
    for column, actuator in enumerate(episode.ctrl_names):
        place = places.get(actuator)
        name = positions.get(place.aliases[0]) if place and place.aliases else None
        if name is None or sources.get(actuator) in (None, streams[name]):
            continue
        values = episode.signals[name].values
        relation = compare_command(
            (episode.time, episode.ctrl[:, column]), (episode.time, values)
        )
        if abs(relation.correlation) > _LEAST_CORRELATION:
            lags.append(relation.lag)
    if not lags or max(lags) - min(lags) > _SAME_LAG or not max(lags) > 0:
        return None
    return min(lags), max(lags)


def _place_robot(
    episode: Episode, names: Sequence[str], model: "mujoco.MjModel"
) -> _Motion | None:
    """The motion of the measured positions; None where a joint is not measured."""
    import mujoco
    from scipy.signal import savgol_filter

    scalar = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    by_joint = {episode.signals[n].target: episode.signals[n].values for n in names}
    joints = [model.joint(j) for j in range(model.njnt)]
    kinds = [mujoco.mjtJoint(joint.type[0]) for joint in joints]
    if not {*kinds} <= {*scalar} or any(j.name not in by_joint for j in joints):
        return None
    rows = [np.flatnonzero(np.isfinite(by_joint[j.name])) for j in joints]
    if not rows or min(map(len, rows)) < _LEAST_ROWS:
        return None
    start = max(episode.time[r[0]] for r in rows)
    end = min(episode.time[r[-1]] for r in rows)
    grid = np.linspace(start, end, _GRID)
    step = grid[1] - grid[0]
    if not step > 0:
        return None
    window = 2 * round(_SMOOTHING / step / 2) + 1
    if not 3 <= window < _GRID:
        return None
    qpos = np.tile(model.qpos0, (_GRID, 1))
    for joint, own in zip(joints, rows, strict=True):
        values = by_joint[joint.name][own]
        qpos[:, joint.qposadr[0]] = np.interp(grid, episode.time[own], values)
    # one position and one speed a joint, in the same order
    qvel = savgol_filter(qpos, window, 2, deriv=1, delta=step, axis=0)
    return _Motion(grid, qpos, qvel)


def _predict_signals(
    episode: Episode,
    names: Sequence[str],
    model: "mujoco.MjModel",
    motion: _Motion,
) -> dict[str, Floats]:
    """What a motion makes of signals, (K, d) each."""
    import mujoco

    data = mujoco.MjData(model)
    found = {name: list[Floats]() for name in names}
    for q, v in zip(motion.qpos, motion.qvel, strict=True):
        data.qpos[:], data.qvel[:] = q, v
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_sensorPos(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_sensorVel(model, data)
        for name in names:
            signal = episode.signals[name]
            value = _read_value(model, data, signal.kind, signal.target)
            if value is not None:
                found[name].append(value)
    return {name: np.array(values) for name, values in found.items() if values}


def _read_value(
    model: "mujoco.MjModel", data: "mujoco.MjData", kind: str, target: str
) -> Floats | None:
    """A signal (d) of a placed robot; None of a kind that needs forces."""
    import mujoco

    if kind == "joint_velocity":
        return data.qvel[model.joint(target).dofadr].copy()
    if kind.startswith("body_"):
        body, speed = data.body(target), np.empty(6)
        local = int(kind == "body_angular_velocity")
        of = mujoco.mjtObj.mjOBJ_XBODY
        mujoco.mj_objectVelocity(model, data, of, body.id, speed, local)
        velocity = speed[:3] if local else speed[3:]
        poses = {"body_position": body.xpos, "body_orientation": body.xmat}
        return poses.get(kind, velocity).copy()
    sensor = model.sensor(target) if kind == "sensor" else None
    forces = mujoco.mjtStage.mjSTAGE_ACC
    if sensor is None or mujoco.mjtStage(sensor.needstage[0]) == forces:
        return None
    values = data.sensordata[sensor.adr[0] : sensor.adr[0] + sensor.dim[0]].copy()
    return _rotate(values) if sensor.dim[0] == 4 else values


def _rotate(quaternion: Floats) -> Floats:
    """The rotation matrix (9) of a quaternion (4), which has no sign."""
    import mujoco

    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix


def _make_pair(episode: Episode, name: str, predicted: Floats) -> _Pair | None:
    """A signal beside its prediction (K, d); None where it hardly has a row."""
    values = episode.signals[name].values.reshape(episode.time.size, -1)
    rows = np.flatnonzero(np.isfinite(values).all(axis=1))
    if rows.size < _LEAST_ROWS:
        return None
    values = values[rows]
    if values.shape[1] == 4 and predicted.shape[1] == 9:
        values = np.array([_rotate(v / np.linalg.norm(v)) for v in values])
    return _Pair(episode.time[rows], values, predicted)


def _estimate(
    grid: Floats, pairs: Sequence[_Pair], stream: str, reference: str
) -> Offset | None:
    """The offset of one stream; None where it does not follow the joints."""
    from scipy import stats

    start, end = grid[0] + _MAX_SHIFT, grid[-1] - _MAX_SHIFT
    if not end > start:
        return None
    whole, correlation = _find_shift(grid, pairs, start, end)
    if correlation < _LEAST_CORRELATION:
        return None
    edges = np.linspace(start, end, _BLOCKS + 1)
    parts = [
        shift
        for low, high in pairwise(edges)
        for shift, found in [_find_shift(grid, pairs, low, high)]
        if found > _LEAST_CORRELATION
    ]
    if len(parts) < 3:
        return None
    width = stats.t.ppf((1 + _CONFIDENCE) / 2, len(parts) - 1) * stats.sem(parts)
    return Offset(stream, reference, whole, whole - width, whole + width, correlation)


def _find_shift(
    grid: Floats, pairs: Sequence[_Pair], start: float, end: float
) -> tuple[float, float]:
    """By how much signals between two times are late [s], and the correlation."""
    shifts = np.arange(-_MAX_SHIFT, _MAX_SHIFT + _STEP / 2, _STEP)
    scores = np.array([_correlate(grid, pairs, start, end, s) for s in shifts])
    best = int(np.argmax(scores))
    near = slice(max(best - _NEAR, 0), best + _NEAR + 1)
    bend, slope, _ = np.polyfit(shifts[near] - shifts[best], scores[near], 2)
    move = -slope / (2 * bend) if bend < 0 else 0.0
    move = float(np.clip(move, -_STEP, _STEP))
    return float(shifts[best]) + move, float(scores[best])


def _correlate(
    grid: Floats, pairs: Sequence[_Pair], start: float, end: float, shift: float
) -> float:
    """Mean correlation of signals with their predictions, moved by a shift [s]."""
    products, spread = 0.0, 0.0
    for pair in pairs:
        rows = slice(*np.searchsorted(pair.time, (start, end)))
        time, values = pair.time[rows], pair.values[rows]
        if time.size < _LEAST_ROWS // 2:
            continue
        for measured, predicted in zip(values.T, pair.predicted.T, strict=True):
            other = np.interp(time - shift, grid, predicted)
            x, y = measured - measured.mean(), other - other.mean()
            products += x @ y / max(x.std() * x.size, 1e-300)
            spread += y.std()
    return float(products / spread) if spread > 0 else 0.0
