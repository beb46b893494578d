"""How much an effect shows: takes runs of a hidden robot, gives errors over noise.

Pieces of the runs are simulated again without the effect, from the states where they
begin; what a bounded refit of the stated values would explain is taken off.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from scipy.optimize import lsq_linear

from benchmarks.sealed.hidden_robot import (
    HiddenRobot,
    Nuisance,
    list_nuisances,
    scale_value,
)
from benchmarks.sealed.mjcf import Robot
from benchmarks.sealed.sensors import Instruments
from benchmarks.sealed.simulator import Rollout

PIECES = 10  # chosen: about ten seconds of simulation
SEEN = 60  # samples of a piece that are compared
MANY = 12  # nuisances; beyond it those of a kind move together
NUDGE = 0.05  # of a value, for its sensitivity


@dataclass(frozen=True)
class Segment:
    """A stretch of a run."""

    run: int
    first: int
    last: int

    def list_samples(self) -> range:
        """Samples that are compared."""
        return range(self.first, self.last + 1, (self.last - self.first) // SEEN + 1)


def pick_segments(robot: Robot, runs: Sequence[Rollout]) -> list[Segment]:
    """Segments spread evenly over the rollouts."""
    found = []
    for number, run in enumerate(runs):
        since = run.rows * robot.fine
        length = robot.window
        starts = np.arange(0.0, since[-1] - 0.9 * length + 1e-9, length)
        for start in starts if len(starts) else [0.0]:
            at = np.flatnonzero((since >= start) & (since <= start + length))
            found.append(Segment(number, int(at[0]), int(at[-1])))
    chosen = np.linspace(0, len(found) - 1, min(PIECES, len(found))).round()
    return [found[int(i)] for i in chosen]


def replay_segments(
    model: Any, fine: float, runs: Sequence[Rollout], pieces: Sequence[Segment]
):
    """Positions (samples, nq) of all segments, each simulated from where it begins.

    Args:
        model: compiled, simulates.
        fine: [s] step of the rollouts.
        runs: the rollouts.
        pieces: segments of them.
    """
    each = max(round(float(model.opt.timestep) / fine), 1)
    data, found = mujoco.MjData(model), []
    for piece in pieces:
        run = runs[piece.run]
        mujoco.mj_resetData(model, data)
        data.qpos[:] = run.qpos[piece.first]
        data.qvel[:] = run.qvel[piece.first]
        done = 0
        for i in range(piece.first, piece.last + 1):
            steps = round((run.rows[i] - run.rows[piece.first]) / each) - done
            if steps:
                mujoco.mj_step(model, data, steps)
            done += steps
            data.ctrl[:] = run.ctrl[i]
            if i in piece.list_samples():
                rest = (run.rows[i] - run.rows[piece.first] - done * each) * fine
                qpos = data.qpos.copy()
                mujoco.mj_integratePos(model, qpos, data.qvel, rest)
                found.append(qpos)
    return np.array(found)


def compute_residuals(
    instruments: Instruments, seen: np.ndarray, other: np.ndarray
) -> dict[str, Any]:
    """Differences of two sets of positions over noise, by signal: (samples, d) [1].

    Args:
        instruments: whose noise counts.
        seen: (samples, nq) positions.
        other: (samples, nq) positions.
    """
    robot, noise = instruments.robot, instruments.noise
    model = mujoco.MjModel.from_xml_string(robot.xml)
    found = {}
    for name in robot.joints:
        q = model.joint(name).qposadr[0]
        found[name] = ((seen - other)[:, [q]]) / noise.position
    if robot.free:
        found["place"] = (seen - other)[:, :3] / noise.place
        pairs = zip(seen[:, 3:7], other[:, 3:7], strict=True)
        found["turn"] = (
            np.array([_compute_rotation(a, b) for a, b in pairs]) / noise.turn
        )
    return found


def _compute_rotation(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    turn = np.zeros(3)
    mujoco.mju_subQuat(turn, one, other)
    return turn


def find_largest_rms(errors: dict[str, np.ndarray]) -> float:
    """RMS over noise of the signal where it is largest."""
    return max(float(np.sqrt(np.mean(e**2))) for e in errors.values())


def group_nuisances(robot: Robot) -> list[list[Nuisance]]:
    """The stated values: each alone, or by kind where they are many."""
    every = list_nuisances(robot)
    if len(every) <= MANY:
        return [[n] for n in every]
    kinds = dict.fromkeys(n.kind for n in every)
    return [[n for n in every if n.kind == kind] for kind in kinds]


def read_segments(
    instruments: Instruments, runs: Sequence[Rollout], pieces: Sequence[Segment]
) -> np.ndarray:
    """Positions (samples, nq) of segments as sensors without noise read them.

    Args:
        instruments: that read them.
        runs: the rollouts.
        pieces: segments of them.
    """
    model = mujoco.MjModel.from_xml_string(instruments.robot.xml)
    columns = {
        f"{j}_position": model.joint(j).qposadr[0] for j in instruments.robot.joints
    }
    found = []
    for piece in pieces:
        run = runs[piece.run]
        signals, qpos = instruments.read_clean(run), run.qpos.copy()
        for name, column in columns.items():
            qpos[:, column] = signals[name].values
            if (
                step := instruments.readings[name].step
                if name in instruments.readings
                else 0.0
            ):
                qpos[:, column] = np.round(qpos[:, column] / step) * step
        found.append(qpos[piece.list_samples()])
    return np.concatenate(found)


def measure_strength(
    instruments: Instruments, base: HiddenRobot, runs: Sequence[Rollout]
) -> tuple[float, float]:
    """Error without the effect over noise: as it is, and after a bounded refit.

    Args:
        instruments: that measures the runs.
        base: the same robot without the effect.
        runs: of the robot with the effect.
    """
    robot, pieces = base.robot, pick_segments(base.robot, runs)
    seen = read_segments(instruments, runs, pieces)

    def simulated(spec: Any) -> np.ndarray:
        return replay_segments(spec.compile(), robot.fine, runs, pieces)

    raw = compute_residuals(instruments, seen, simulated(base.spec))
    if not all(np.isfinite(e).all() for e in raw.values()):
        return np.inf, np.inf
    if find_largest_rms(raw) < 1:
        return find_largest_rms(raw), find_largest_rms(raw)
    given, slopes, bounds = make_coarse_spec(base), [], []
    plain = simulated(given)
    for group in group_nuisances(robot):
        nudged = given.copy()
        for nuisance in group:
            scale_value(nudged, nuisance, 1 + NUDGE)
        moved = compute_residuals(instruments, simulated(nudged), plain)
        slopes.append(np.concatenate([m.ravel() for m in moved.values()]) / NUDGE)
        bounds.append(0.8 * group[0].bound)
    left = _subtract_refit(raw, np.array(slopes).T, np.array(bounds))
    return find_largest_rms(raw), find_largest_rms(left)


def make_coarse_spec(base: HiddenRobot) -> Any:
    """MjSpec of the hidden robot with the given model's step and integrator."""
    given = mujoco.MjModel.from_xml_string(base.robot.xml)
    spec = base.spec.copy()
    spec.option.timestep = given.opt.timestep
    spec.option.integrator = given.opt.integrator
    return spec


def _subtract_refit(raw: dict[str, np.ndarray], slopes: np.ndarray, bounds: np.ndarray):
    """What a refit within bounds leaves of the errors."""
    flat = np.concatenate([e.ravel() for e in raw.values()])
    slopes = np.nan_to_num(slopes)
    fit = lsq_linear(slopes, flat, (-bounds, bounds))
    rest, found, at = flat - slopes @ fit.x, {}, 0
    for name, error in raw.items():
        found[name] = rest[at : at + error.size]
        at += error.size
    return found


def measure_integration_error(
    instruments: Instruments, base: HiddenRobot, runs: Sequence[Rollout]
) -> float:
    """What the given model's step and integrator alone cost, over noise.

    Args:
        instruments: whose noise counts.
        base: hidden robot.
        runs: rollouts of it.
    """
    robot, pieces = base.robot, pick_segments(base.robot, runs)
    one = replay_segments(base.spec.compile(), robot.fine, runs, pieces)
    other = replay_segments(make_coarse_spec(base).compile(), robot.fine, runs, pieces)
    return find_largest_rms(compute_residuals(instruments, one, other))
