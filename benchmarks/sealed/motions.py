"""Motions of the sealed benchmark: takes a robot, gives plans of its episodes."""

from collections.abc import Callable

import numpy as np

from benchmarks.sealed.mjcf import Robot
from benchmarks.sealed.simulator import MotionPlan

Rng = np.random.Generator
TRAIN = ("multisine", "slow", "steps", "chirp", "fast", "holds", "multisine", "slow")
TEST = ("multisine", "steps", "slow", "fast")
SECONDS = 5.0  # of a driven episode; chosen: forty seconds of log a case
LEGGED_SECONDS = 3.0
SWING_SECONDS = 4.0
TOSS_SECONDS = 0.7  # as in the recorded tosses of a real cube
TOSSES = 24
PIECES = 16


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


MOTIONS: dict[str, Callable[[np.ndarray, Rng], np.ndarray]] = {
    "multisine": draw_multisine,
    "steps": draw_steps,
    "holds": draw_holds,
    "slow": draw_slow_ramps,
    "fast": draw_fast_ramps,
    "chirp": draw_chirp,
}


def draw_sample_steps(
    robot: Robot, rng: Rng, rate: float, seconds: float, jitter: float
):
    """(T) fine steps of the samples, at a rate with jitter.

    Args:
        robot: whose fine step counts.
        rng: draws the jitter.
        rate: [Hz].
        seconds: [s] of the episode.
        jitter: share of a period by which samples are moved.
    """
    count = int(seconds * rate)
    ideal = np.arange(count) / rate
    ideal[1:] += rng.uniform(-jitter, jitter, count - 1) / rate
    return np.unique(np.round(ideal / robot.fine).astype(int))


def _plan_driven(
    robot: Robot, rng: Rng, motion: str, sampling, seconds: float
) -> MotionPlan:
    rate, jitter, hold = sampling
    at = draw_sample_steps(robot, rng, rate, seconds, jitter)
    columns = []
    for joint in robot.actuators.values():
        middle = robot.center.get(joint, 0.0)
        wave = MOTIONS[motion](at * robot.fine, rng)
        columns.append(middle + robot.amplitude[joint] * wave)
    return MotionPlan(motion, at, hold, np.stack(columns, 1))


def _plan_release(robot: Robot, rng: Rng, sampling, seconds: float) -> MotionPlan:
    at = draw_sample_steps(robot, rng, sampling[0], seconds, sampling[1])
    sizes = np.array([robot.amplitude[j] for j in robot.joints])
    start = rng.uniform(0.4, 1.3, len(sizes)) * sizes * rng.choice([-1, 1], len(sizes))
    return MotionPlan(
        "release", at, 1, np.zeros((len(at), 0)), start, np.zeros(len(start))
    )


def _plan_toss(robot: Robot, rng: Rng, sampling) -> MotionPlan:
    at = draw_sample_steps(robot, rng, sampling[0], TOSS_SECONDS, sampling[1])
    turn = rng.normal(size=4)
    speed = np.r_[rng.uniform(-1.2, 1.2, 2), rng.uniform(-0.5, 0.8)]
    spin = rng.normal(0, 3.0, 3)
    place = np.r_[rng.uniform(-0.1, 0.1, 2), rng.uniform(0.16, 0.3)]
    start = np.r_[place, turn / np.linalg.norm(turn)]
    return MotionPlan("toss", at, 1, np.zeros((len(at), 0)), start, np.r_[speed, spin])


def draw_sampling(robot: Robot, rng: Rng) -> tuple[float, float, int]:
    """Rate [Hz], jitter (share of a period), samples that a command is held."""
    # of a driven robot, whole steps of the given model: commands then fall between
    # two steps in the jittered cases only
    legged = robot.contact and robot.drive == "servo"
    rates: tuple[int, ...] = (100, 125) if legged else (100, 200, 250, 500)
    if robot.drive == "none":
        rates = (150, 200, 250, 400, 500)
    rate = float(rng.choice(rates))
    jitter = float(rng.choice([0.0, 0.0, 0.2, 0.35]))
    # a torque feedback at less than 100 Hz would not be stable
    slow_hold = max(2, int(rate / 100)) if robot.drive == "torque" else int(rate / 40)
    hold = slow_hold if rng.random() < 0.3 and rate > 100 else 1
    return rate, jitter, hold


def draw_plans(robot: Robot, rng: Rng, sampled, *, test: bool) -> list[MotionPlan]:
    """The plans of all episodes of one recording.

    Args:
        robot: that moves.
        rng: draws the motions.
        sampled: rate [Hz], jitter [1] and held samples, as `draw_sampling` gives them.
        test: whether it is the test, with fewer and other episodes.
    """
    if robot.drive != "none":
        seconds = LEGGED_SECONDS if robot.contact else SECONDS
        names = TEST if test else TRAIN
        return [_plan_driven(robot, rng, name, sampled, seconds) for name in names]
    if robot.free:
        count = TOSSES // 3 if test else TOSSES
        return [_plan_toss(robot, rng, sampled) for _ in range(count)]
    count = 4 if test else 8
    return [_plan_release(robot, rng, sampled, SWING_SECONDS) for _ in range(count)]
