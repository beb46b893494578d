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

from benchmarks.hidden.robots.robot import Robot
from benchmarks.hidden.sensors import Instruments
from benchmarks.hidden.simulator import Rollout
from benchmarks.hidden.truth import (
    HiddenRobot,
    Nuisance,
    SensorModel,
    list_nuisances,
    scale_value,
)

PIECES = 10  # chosen: about ten seconds of simulation
SEEN = 60  # samples of a piece that are compared
MANY = 12  # nuisances; beyond it those of a kind move together
NUDGE = 0.05  # of a value, for its sensitivity


@dataclass(frozen=True)
class Stretch:
    """A part of a run, from one sample to another."""

    run: Rollout
    first: int
    last: int

    @property
    def samples(self) -> range:
        """Samples that are compared."""
        return range(self.first, self.last + 1, (self.last - self.first) // SEEN + 1)


class Probe:
    """Stretches spread evenly over rollouts: read, and simulated by other models."""

    def __init__(self, instruments: Instruments, runs: Sequence[Rollout]) -> None:
        self.instruments, self.robot = instruments, instruments.robot
        length, found = self.robot.window, []
        for run in runs:
            since = run.rows * self.robot.fine
            starts = np.arange(0.0, since[-1] - 0.9 * length + 1e-9, length)
            for start in starts if len(starts) else [0.0]:
                at = np.flatnonzero((since >= start) & (since <= start + length))
                found.append(Stretch(run, int(at[0]), int(at[-1])))
        chosen = np.linspace(0, len(found) - 1, min(PIECES, len(found))).round()
        self.stretches = [found[int(i)] for i in chosen]

    def read(self) -> np.ndarray:
        """Positions (samples, nq) as sensors without noise read them."""
        robot, found = self.robot, []
        for stretch in self.stretches:
            run = stretch.run
            signals = self.instruments.read_clean(run, robot.model)
            qpos = run.qpos.copy()
            for joint in robot.joints:
                name, column = f"{joint}_position", robot.model.joint(joint).qposadr[0]
                qpos[:, column] = signals[name].values
                reading = self.instruments.readings.get(name, SensorModel())
                if step := reading.step:
                    qpos[:, column] = np.round(qpos[:, column] / step) * step
            found.append(qpos[stretch.samples])
        return np.concatenate(found)

    def simulate(self, spec: mujoco.MjSpec) -> np.ndarray:
        """Positions (samples, nq) by a model, each stretch from where it begins."""
        model, fine = spec.compile(), self.robot.fine
        each = max(round(float(model.opt.timestep) / fine), 1)
        data, found = mujoco.MjData(model), []
        for stretch in self.stretches:
            run, first = stretch.run, stretch.first
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:] = run.qpos[first], run.qvel[first]
            done = 0
            for i in range(first, stretch.last + 1):
                steps = round((run.rows[i] - run.rows[first]) / each) - done
                if steps:
                    mujoco.mj_step(model, data, steps)
                done += steps
                data.ctrl[:] = run.ctrl[i]
                if i in stretch.samples:
                    rest = (run.rows[i] - run.rows[first] - done * each) * fine
                    qpos = data.qpos.copy()
                    mujoco.mj_integratePos(model, qpos, data.qvel, rest)
                    found.append(qpos)
        return np.array(found)

    def compare(self, one: np.ndarray, other: np.ndarray) -> list[np.ndarray]:
        """Differences of positions (samples, nq) over noise, by signal."""
        robot, sensors, off = self.robot, self.instruments.sensors, one - other
        found = []
        for name in robot.joints:
            q = robot.model.joint(name).qposadr[0]
            found.append(off[:, [q]] / sensors[f"{name}_position"].noise)
        if free := robot.free:
            found.append(off[:, :3] / sensors[f"{free}_position"].noise)
            pairs = zip(one[:, 3:7], other[:, 3:7], strict=True)
            turns = np.array([_compute_rotation(a, b) for a, b in pairs])
            found.append(turns / sensors[f"{free}_orientation"].noise)
        return found


def _compute_rotation(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    turn = np.zeros(3)
    mujoco.mju_subQuat(turn, one, other)
    return turn


def _find_largest_rms(errors: Sequence[np.ndarray]) -> float:
    """RMS over noise of the signal where it is largest."""
    return max(float(np.sqrt(np.mean(e**2))) for e in errors)


def _group_nuisances(robot: Robot) -> list[list[Nuisance]]:
    """The stated values: each alone, or by kind where they are many."""
    every = list_nuisances(robot)
    if len(every) <= MANY:
        return [[n] for n in every]
    kinds = dict.fromkeys(n.kind for n in every)
    return [[n for n in every if n.kind == kind] for kind in kinds]


def measure_strength(
    instruments: Instruments, base: HiddenRobot, runs: Sequence[Rollout]
) -> tuple[float, float]:
    """Error without the effect over noise: as it is, and after a bounded refit.

    Args:
        base: the same robot without the effect.
        runs: of the robot with the effect.
    """
    probe = Probe(instruments, runs)
    raw = probe.compare(probe.read(), probe.simulate(base.spec))
    if not all(np.isfinite(e).all() for e in raw):
        return np.inf, np.inf
    largest = _find_largest_rms(raw)
    if largest < 1:
        return largest, largest
    given, slopes, bounds = make_coarse_spec(base), [], []
    plain = probe.simulate(given)
    for group in _group_nuisances(base.robot):
        nudged = given.copy()
        for nuisance in group:
            scale_value(nudged, nuisance.kind, nuisance.name, 1 + NUDGE)
        moved = probe.compare(probe.simulate(nudged), plain)
        slopes.append(np.concatenate([m.ravel() for m in moved]) / NUDGE)
        bounds.append(0.8 * group[0].bound)
    left = _subtract_refit(raw, np.array(slopes).T, np.array(bounds))
    return largest, _find_largest_rms(left)


def make_coarse_spec(base: HiddenRobot) -> Any:
    """MjSpec of the hidden robot with the given model's step and integrator."""
    spec, given = base.spec.copy(), base.robot.model.opt
    spec.option.timestep, spec.option.integrator = given.timestep, given.integrator
    return spec


def _subtract_refit(
    raw: Sequence[np.ndarray], slopes: np.ndarray, bounds: np.ndarray
) -> list[np.ndarray]:
    """What a refit within bounds leaves of the errors."""
    flat, slopes = np.concatenate([e.ravel() for e in raw]), np.nan_to_num(slopes)
    fit = lsq_linear(slopes, flat, (-bounds, bounds))
    ends = np.cumsum([error.size for error in raw])[:-1]
    return np.split(flat - slopes @ fit.x, ends)


def measure_integration_error(
    instruments: Instruments, base: HiddenRobot, runs: Sequence[Rollout]
) -> float:
    """What the given model's step and integrator alone cost, over noise."""
    probe = Probe(instruments, runs)
    fine, coarse = probe.simulate(base.spec), probe.simulate(make_coarse_spec(base))
    return _find_largest_rms(probe.compare(fine, coarse))
