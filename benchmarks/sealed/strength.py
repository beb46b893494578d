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

from benchmarks.sealed.hidden_robot import Nuisance, Run, Truth, change, nuisances
from benchmarks.sealed.mjcf import Robot
from benchmarks.sealed.sensors import Bench

PIECES = 10  # chosen: about ten seconds of simulation
SEEN = 60  # samples of a piece that are compared
MANY = 12  # nuisances; beyond it those of a kind move together
NUDGE = 0.05  # of a value, for its sensitivity


@dataclass(frozen=True)
class Piece:
    """A stretch of a run."""

    run: int
    first: int
    last: int

    def seen(self) -> range:
        """Samples that are compared."""
        return range(self.first, self.last + 1, (self.last - self.first) // SEEN + 1)


def pick(robot: Robot, runs: Sequence[Run]) -> list[Piece]:
    """Pieces spread evenly over the runs."""
    found = []
    for number, run in enumerate(runs):
        since = run.rows * robot.fine
        length = robot.window
        starts = np.arange(0.0, since[-1] - 0.9 * length + 1e-9, length)
        for start in starts if len(starts) else [0.0]:
            at = np.flatnonzero((since >= start) & (since <= start + length))
            found.append(Piece(number, int(at[0]), int(at[-1])))
    chosen = np.linspace(0, len(found) - 1, min(PIECES, len(found))).round()
    return [found[int(i)] for i in chosen]


def replay(model: Any, fine: float, runs: Sequence[Run], pieces: Sequence[Piece]):
    """Positions (samples, nq) of all pieces, simulated from where they begin."""
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
            if i in piece.seen():
                rest = (run.rows[i] - run.rows[piece.first] - done * each) * fine
                qpos = data.qpos.copy()
                mujoco.mj_integratePos(model, qpos, data.qvel, rest)
                found.append(qpos)
    return np.array(found)


def residual(bench: Bench, seen: np.ndarray, other: np.ndarray) -> dict[str, Any]:
    """Differences of two sets of positions, over noise, by signal: (samples, d)."""
    robot, noise = bench.robot, bench.noise
    model = mujoco.MjModel.from_xml_string(robot.xml)
    found = {}
    for name in robot.joints:
        q = model.joint(name).qposadr[0]
        found[name] = ((seen - other)[:, [q]]) / noise.position
    if robot.free:
        found["place"] = (seen - other)[:, :3] / noise.place
        pairs = zip(seen[:, 3:7], other[:, 3:7], strict=True)
        found["turn"] = np.array([_apart(a, b) for a, b in pairs]) / noise.turn
    return found


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    turn = np.zeros(3)
    mujoco.mju_subQuat(turn, one, other)
    return turn


def largest(errors: dict[str, np.ndarray]) -> float:
    """RMS over noise of the signal where it is largest."""
    return max(float(np.sqrt(np.mean(e**2))) for e in errors.values())


def groups(robot: Robot) -> list[list[Nuisance]]:
    """The stated values, each alone, or by kind where they are many."""
    every = nuisances(robot)
    if len(every) <= MANY:
        return [[n] for n in every]
    kinds = dict.fromkeys(n.kind for n in every)
    return [[n for n in every if n.kind == kind] for kind in kinds]


def observed(bench: Bench, runs: Sequence[Run], pieces: Sequence[Piece]) -> np.ndarray:
    """Positions (samples, nq) of the pieces as sensors without noise say them."""
    model = mujoco.MjModel.from_xml_string(bench.robot.xml)
    columns = {f"{j}_position": model.joint(j).qposadr[0] for j in bench.robot.joints}
    found = []
    for piece in pieces:
        run = runs[piece.run]
        signals, qpos = bench.clean(run), run.qpos.copy()
        for name, column in columns.items():
            qpos[:, column] = signals[name].values
            if step := bench.readings[name].step if name in bench.readings else 0.0:
                qpos[:, column] = np.round(qpos[:, column] / step) * step
        found.append(qpos[piece.seen()])
    return np.concatenate(found)


def strength(bench: Bench, base: Truth, runs: Sequence[Run]) -> tuple[float, float]:
    """Error without the effect over noise: as it is, and after a bounded refit.

    Args:
        bench: that measures the runs.
        base: the same robot without the effect.
        runs: of the robot with the effect.
    """
    robot, pieces = base.robot, pick(base.robot, runs)
    seen = observed(bench, runs, pieces)

    def simulated(spec: Any) -> np.ndarray:
        return replay(spec.compile(), robot.fine, runs, pieces)

    raw = residual(bench, seen, simulated(base.spec))
    if not all(np.isfinite(e).all() for e in raw.values()):
        return np.inf, np.inf
    if largest(raw) < 1:
        return largest(raw), largest(raw)
    given, slopes, bounds = coarse(base), [], []
    plain = simulated(given)
    for group in groups(robot):
        nudged = given.copy()
        for nuisance in group:
            change(nudged, nuisance, 1 + NUDGE)
        moved = residual(bench, simulated(nudged), plain)
        slopes.append(np.concatenate([m.ravel() for m in moved.values()]) / NUDGE)
        bounds.append(0.8 * group[0].bound)
    left = _refitted(raw, np.array(slopes).T, np.array(bounds))
    return largest(raw), largest(left)


def coarse(base: Truth) -> Any:
    """The hidden robot with the given model's step and integrator."""
    given = mujoco.MjModel.from_xml_string(base.robot.xml)
    spec = base.spec.copy()
    spec.option.timestep = given.opt.timestep
    spec.option.integrator = given.opt.integrator
    return spec


def _refitted(raw: dict[str, np.ndarray], slopes: np.ndarray, bounds: np.ndarray):
    """What a refit within bounds leaves of the errors."""
    flat = np.concatenate([e.ravel() for e in raw.values()])
    slopes = np.nan_to_num(slopes)
    fit = lsq_linear(slopes, flat, (-bounds, bounds))
    rest, found, at = flat - slopes @ fit.x, {}, 0
    for name, error in raw.items():
        found[name] = rest[at : at + error.size]
        at += error.size
    return found


def integration(bench: Bench, base: Truth, runs: Sequence[Run]) -> float:
    """What the given model's step and integrator alone cost, over noise."""
    robot, pieces = base.robot, pick(base.robot, runs)
    one = replay(base.spec.compile(), robot.fine, runs, pieces)
    other = replay(coarse(base).compile(), robot.fine, runs, pieces)
    return largest(residual(bench, one, other))
