"""A case: kind and seed in; model, recording, test and truth out."""

import json
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.drives.motions import MOTIONS, draw_paths
from benchmarks.drives.plant import Plant, Rollout
from benchmarks.drives.robots import Rng, Robot, draw_robot, measure_loads, write_mjcf
from benchmarks.drives.truth import Truth, draw_drives, list_effects
from selfheal.files import atomic_path
from selfheal.recording import Episode, Recording, Signal, write

RATES = (30.0, 50.0, 100.0, 200.0, 250.0, 500.0)  # [Hz] of logs
FAST = (100.0, 200.0, 250.0, 500.0)  # [Hz] of those whose controller gives torques


@dataclass(frozen=True)
class Log:
    """How a case is recorded.

    Attributes:
        rate: [Hz] of the samples.
        episodes: for the diagnosis.
        held: episodes that only the scorer sees.
        seconds: [s] of an episode.
        noise: share of a joint's swing that its encoder's noise is.
        steps: counts of an encoder for a turn, 0: not rounded.
        speed: share of a joint's speed that its tachometer's noise is; 0: none.
        torque: share of a joint's torque that its sensor's noise is; 0: none.
        state: whether episodes state where they start.
    """

    rate: float
    episodes: int
    held: int
    seconds: float
    noise: float
    steps: int
    speed: float
    torque: float
    state: bool


@dataclass(frozen=True)
class Case:
    """What is written of a case.

    Attributes:
        name: of its folder.
        robot: as its model has it.
        truth: what the robot has besides.
        log: how it was recorded.
        train: recording for the diagnosis.
        test: recording that only the scorer sees; it always states where it starts.
    """

    name: str
    robot: Robot
    truth: Truth
    log: Log
    train: Recording
    test: Recording


def draw_log(rng: Rng, *, servo: bool, feedback: bool) -> Log:
    """How a case is recorded.

    Args:
        rng: draws it.
        servo: whether goals are commanded, not torques.
        feedback: whether commands depend on the state.
    """
    steps = int(rng.choice([0, 0, 4096, 16384]))
    return Log(
        rate=float(rng.choice(FAST if feedback else RATES)),
        episodes=5,
        held=2,
        seconds=float(rng.uniform(7, 10)),
        noise=0.0 if steps else float(10 ** rng.uniform(-4, -2.7)),
        steps=steps,
        speed=float(rng.choice([0.0, 0.01, 0.03])),
        torque=float(rng.choice([0.0, 0.0, 0.0, 0.03])) if servo else 0.0,
        state=bool(rng.random() < 0.5),
    )


def _make_torque_control(robot: Robot, truth: Truth, goals: np.ndarray, period: float):
    """Commands of a controller outside of the drives, which follows goals by torques.

    Args:
        robot: its masses are those of the model.
        truth: for the inertia that the gains were tuned to.
        goals: (T, n) [rad or m].
        period: [s] between commands.
    """
    given = mujoco.MjModel.from_xml_string(write_mjcf(robot, actuated=False))
    there, (torques, inertias) = mujoco.MjData(given), measure_loads(robot)
    rotors = np.array([drive.armature for drive in truth.drives])
    late = 1.5 * period + truth.delay + max(drive.lag for drive in truth.drives)
    fast = min(2 * np.pi * 3.0 * robot.rate, 0.25 / late)
    kp = (inertias + rotors) * fast**2
    kv = 1.2 * (inertias + rotors) * fast
    most = 8 * torques

    def command(k: int, time: float, data: Any) -> np.ndarray:
        there.qpos[:] = data.qpos
        mujoco.mj_forward(given, there)
        asked = kp * (goals[k] - data.qpos) - kv * data.qvel + there.qfrc_bias
        return np.clip(asked, -most, most)

    return command


def simulate_episode(
    robot: Robot, truth: Truth, log: Log, rng: Rng, *, feedback: bool
) -> tuple[Rollout, str]:
    """One episode of a random motion, from rest.

    Args:
        robot: that moves.
        truth: what its model lacks.
        log: for rate and length.
        rng: draws the motion.
        feedback: whether torques are those of a controller.

    Returns:
        What it did, and the name of the motion.
    """
    plant, motion = Plant(robot, truth), str(rng.choice(list(MOTIONS)))
    rates = robot.rate * rng.uniform(0.7, 1.3, len(robot.links))
    times = np.arange(int(log.seconds * log.rate)) / log.rate
    paths = draw_paths(rng, motion, rates, log.seconds)(times)
    goals, rest = robot.home + robot.swings * paths, np.zeros(len(robot.links))
    if robot.style == "motor" and not feedback:
        goals = 1.5 * measure_loads(robot)[0] * paths
        settle, qpos = 0.0, rng.uniform(-0.5, 0.5, len(rest))
    else:
        settle, qpos = 1.5, goals[0]
    before = np.arange(-int(settle * log.rate), 0) / log.rate
    if feedback:
        held = np.concatenate([np.repeat(goals[:1], len(before), 0), goals])
        command = _make_torque_control(robot, truth, held, 1 / log.rate)
    else:

        def command(k: int, time: float, data: Any) -> np.ndarray:
            return goals[max(k - len(before), 0)]

    run = plant.run(np.concatenate([before, times]), command, qpos, rest)
    n = len(before)
    cut = Rollout(times, run.ctrl[n:], run.qpos[n:], run.qvel[n:], run.torque[n:])
    return cut, motion


def read_signals(
    robot: Robot, log: Log, run: Rollout, rng: Rng, *, noisy: bool = True
) -> dict[str, Signal]:
    """What the sensors say of a rollout.

    Args:
        robot: whose joints are measured.
        log: has the noise.
        run: what it did.
        rng: draws the noise.
        noisy: whether there is any, rounding included.
    """
    found, torques = {}, measure_loads(robot)[0]
    for i, link in enumerate(robot.links):
        rad, newton = ("m", "N") if link.slide else ("rad", "N m")
        q = run.qpos[:, i] + noisy * log.noise * link.swing * rng.normal(
            size=len(run.time)
        )
        if log.steps and noisy:
            step = (0.1 if link.slide else 2 * np.pi) / log.steps
            q = np.round(q / step) * step
        found[f"{link.joint}_position"] = Signal(q, "joint_position", link.joint, rad)
        if log.speed:
            size = log.speed * link.swing * 2 * np.pi * robot.rate
            v = run.qvel[:, i] + noisy * size * rng.normal(size=len(q))
            found[f"{link.joint}_velocity"] = Signal(
                v, "joint_velocity", link.joint, f"{rad}/s"
            )
        if log.torque:
            tau = run.torque[:, i] + noisy * log.torque * torques[i] * rng.normal(
                size=len(q)
            )
            found[f"{link.joint}_torque"] = Signal(
                tau, "joint_torque", robot.actuators[i], newton
            )
    return found


class UnfitDraw(Exception):
    """The drawn robot does not follow what is asked of it; another one is drawn."""


def check_motion(robot: Robot, run: Rollout) -> None:
    """Refuse a robot that swings far beyond what was asked, as an unstable one does.

    Raises:
        UnfitDraw: it does.
    """
    far = np.abs(run.qpos - robot.home).max(0) / robot.swings
    if not (np.isfinite(run.qpos).all() and far.max() < 4.0):
        raise UnfitDraw


def make_everything_missing(rng: Rng, seed: int) -> Case:
    """A case whose model lacks the whole drive at every joint.

    Args:
        rng: draws everything.
        seed: tells the number of joints.

    Raises:
        UnfitDraw: the robot was unstable.
    """
    joints = 1 + seed % 7
    servo = bool(rng.random() < 0.55)
    feedback = not servo and (joints > 2 or bool(rng.random() < 0.3))
    robot = draw_robot(rng, joints, servo=servo)
    truth = draw_drives(rng, robot)
    log = draw_log(rng, servo=servo, feedback=feedback)
    made: dict[str, dict[str, Episode]] = {"recording": {}, "test": {}}
    for k in range(log.episodes + log.held):
        run, motion = simulate_episode(robot, truth, log, rng, feedback=feedback)
        if servo or feedback:
            check_motion(robot, run)
        file = "test" if k >= log.episodes else "recording"
        state = log.state or file == "test"
        made[file][f"{k:03d}"] = Episode(
            run.time,
            run.ctrl,
            robot.actuators,
            read_signals(robot, log, run, rng),
            run.qpos[0] if state else None,
            run.qvel[0] if state else None,
            motion,
        )
    train, test = (Recording(made[k], file=f"{k}.h5") for k in made)
    return Case(f"everything_{seed:05d}", robot, truth, log, train, test)


KINDS = {"everything": make_everything_missing}


def make_case(kind: str, seed: int) -> Case:
    """The case of a kind and a seed, always the same."""
    number = list(KINDS).index(kind)
    for attempt in count():
        try:
            return KINDS[kind](np.random.default_rng([number, seed, attempt]), seed)
        except UnfitDraw:
            continue
    raise AssertionError


def save_case(case: Case, folder: Path) -> Path:
    """Write model.xml, recording.h5, test.h5 and truth.json into a new folder."""
    place = folder / case.name
    place.mkdir(parents=True, exist_ok=True)
    with atomic_path(place / "model.xml") as path:
        path.write_text(write_mjcf(case.robot))
    write(case.train, place / "recording.h5")
    write(case.test, place / "test.h5")
    effects = [
        {"effect": e.name, "targets": e.targets, "values": e.values}
        for e in list_effects(case.robot, case.truth)
    ]
    truth = {"effects": effects, **case.truth.describe()}
    with atomic_path(place / "truth.json") as path:  # last: the case is whole
        path.write_text(json.dumps(truth, indent=1) + "\n")
    return place
