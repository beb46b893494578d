"""Motions: takes a robot and a generator, gives plans of episodes."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from benchmarks.hidden.robots.robot import Rng, Robot
from benchmarks.hidden.simulator import Command, MotionPlan

SETTLE = 1.0  # [s] before a driven episode; chosen: all come to rest
TOSS_SECONDS = 0.7  # as in the recorded tosses of a real cube


def draw_multisine(time: np.ndarray, rng: Rng) -> np.ndarray:
    """Five sines between 0.15 and 2.5 Hz, within -1 to 1."""
    rates = np.exp(rng.uniform(np.log(0.15), np.log(2.5), 5))
    weights = rng.uniform(0.4, 1.0, 5) / np.sqrt(rates / 0.15)
    phases = rng.uniform(0, 2 * np.pi, 5)
    waves = np.sin(2 * np.pi * np.outer(time, rates) + phases)
    return waves @ weights / weights.sum() * 1.4


def draw_steps(time: np.ndarray, rng: Rng) -> np.ndarray:
    """Levels that change at once every 0.5 to 1 s."""
    edges = np.cumsum(rng.uniform(0.5, 1.0, 60))
    return rng.uniform(-0.8, 0.8, 61)[np.searchsorted(edges, time, side="right")]


def draw_holds(time: np.ndarray, rng: Rng) -> np.ndarray:
    """Levels held 0.6 to 1.2 s, with ramps of 0.4 s between them."""
    edges = np.repeat(np.cumsum(rng.uniform(1.0, 1.6, 60)), 2)
    edges[1::2] += 0.4
    levels = np.repeat(rng.uniform(-0.9, 0.9, 61), 2)[:-2]
    return np.interp(time, edges, levels)


def _make_triangle(time: np.ndarray, period: float, phase: float) -> np.ndarray:
    return 2 / np.pi * np.arcsin(np.sin(2 * np.pi * time / period + phase))


def draw_slow_ramps(time: np.ndarray, rng: Rng) -> np.ndarray:
    """A ramp back and forth of 3 to 6 s, over a part of the range."""
    middle, size = rng.uniform(-0.3, 0.3), rng.uniform(0.25, 0.6)
    period, phase = rng.uniform(3.0, 6.0), rng.uniform(0, 2 * np.pi)
    return middle + size * _make_triangle(time, period, phase)


def draw_fast_ramps(time: np.ndarray, rng: Rng) -> np.ndarray:
    """A ramp back and forth of 0.7 to 1.4 s."""
    return 0.7 * _make_triangle(time, rng.uniform(0.7, 1.4), rng.uniform(0, 2 * np.pi))


def draw_chirp(time: np.ndarray, rng: Rng) -> np.ndarray:
    """A sine that climbs from 0.2 to about 4 Hz and becomes smaller."""
    top, phase = rng.uniform(3.0, 5.0), rng.uniform(0, 2 * np.pi)
    rate = 0.2 + (top - 0.2) * time / max(time[-1], 1e-9) / 2
    return np.sin(2 * np.pi * rate * time + phase) * (0.8 - 0.6 * time / time[-1])


def draw_bits(time: np.ndarray, rng: Rng) -> np.ndarray:
    """A binary sequence whose bits last a third of a second."""
    number = (3 * time).astype(int)
    return 0.35 * (2 * rng.integers(0, 2, number[-1] + 1) - 1)[number]


MOTIONS: dict[str, Callable[[np.ndarray, Rng], np.ndarray]] = {
    "multisine": draw_multisine,
    "steps": draw_steps,
    "holds": draw_holds,
    "slow": draw_slow_ramps,
    "fast": draw_fast_ramps,
    "chirp": draw_chirp,
    "bits": draw_bits,
}


def draw_sample_steps(
    robot: Robot, rng: Rng, rate: float, seconds: float, jitter: float
):
    """(T) fine steps of the samples, at a rate with jitter.

    Args:
        rate: [Hz].
        jitter: share of a period by which samples are moved.
    """
    count = int(seconds * rate)
    ideal = np.arange(count) / rate
    ideal[1:] += rng.uniform(-jitter, jitter, count - 1) / rate
    return np.unique(np.round(ideal / robot.fine).astype(int))


def command_table(table: np.ndarray) -> Command:
    """Commands (T, nu) that do not depend on the state."""
    return lambda i, data: table[i].copy()


def follow_goals(robot: Robot, goals: np.ndarray) -> Command:
    """What makes a robot follow goals: the goals, or the torques of a feedback.

    Args:
        goals: (T, nu) [rad or m] of the joints that its actuators move.
    """
    if robot.drive == "servo":
        return command_table(goals)

    def command(i: int, data: mujoco.MjData) -> np.ndarray:
        sent = []
        for joint, goal in zip(robot.actuators.values(), goals[i], strict=True):
            stiff, damp = robot.gains[joint]
            state = data.joint(joint)
            sent.append(stiff * (goal - state.qpos[0]) - damp * state.qvel[0])
        return np.array(sent)

    return command


def plan_goals(
    robot: Robot, motion: str, rows: np.ndarray, goals: np.ndarray, **more: Any
) -> MotionPlan:
    """A plan that follows goals, from rest where the first one is.

    Args:
        rows: (T) fine step of each sample.
        goals: (T, nu) [rad or m] of the joints that its actuators move.
    """
    qpos = robot.model.qpos0.copy()
    for joint, goal in zip(robot.actuators.values(), goals[0], strict=True):
        qpos[robot.model.joint(joint).qposadr[0]] = goal
    plan = {
        "command": follow_goals(robot, goals),
        "qpos": qpos,
        "qvel": np.zeros(robot.model.nv),
        "settle": SETTLE,
    }
    return MotionPlan(motion, rows, **(plan | more))


def plan_driven(
    robot: Robot, rng: Rng, motion: str, sampling, seconds: float
) -> MotionPlan:
    """A plan in which every driven joint has its own wave of one sort of motion."""
    rate, jitter, hold = sampling
    at = draw_sample_steps(robot, rng, rate, seconds, jitter)
    columns = []
    for joint in robot.actuators.values():
        middle = robot.center.get(joint, 0.0)
        wave = MOTIONS[motion](at * robot.fine, rng)
        columns.append(middle + robot.amplitude[joint] * wave)
    return plan_goals(robot, motion, at, np.stack(columns, 1), hold=hold)


def plan_free(
    motion: str, at: np.ndarray, qpos: np.ndarray, qvel: np.ndarray
) -> MotionPlan:
    """A plan without commands.

    Args:
        at: (T) fine step of each sample.
        qpos: (nq) start.
        qvel: (nv) start.
    """
    return MotionPlan(motion, at, command_table(np.zeros((len(at), 0))), qpos, qvel)


def plan_release(robot: Robot, rng: Rng, sampling, seconds: float) -> MotionPlan:
    """A plan in which a robot is let go."""
    at = draw_sample_steps(robot, rng, sampling[0], seconds, sampling[1])
    sizes = np.array([robot.amplitude[j] for j in robot.joints])
    start = rng.uniform(0.4, 1.3, len(sizes)) * sizes * rng.choice([-1, 1], len(sizes))
    return plan_free("release", at, start, np.zeros(len(start)))


def plan_toss(robot: Robot, rng: Rng, sampling) -> MotionPlan:
    """A plan in which a body is thrown."""
    at = draw_sample_steps(robot, rng, sampling[0], TOSS_SECONDS, sampling[1])
    turn = rng.normal(size=4)
    speed = np.r_[rng.uniform(-1.2, 1.2, 2), rng.uniform(-0.5, 0.8)]
    spin = rng.normal(0, 3.0, 3)
    place = np.r_[rng.uniform(-0.1, 0.1, 2), rng.uniform(0.16, 0.3)]
    start = np.r_[place, turn / np.linalg.norm(turn)]
    return plan_free("toss", at, start, np.r_[speed, spin])
