"""A case: kind and seed in; model, recording, test and truth out."""

import json
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.drives.joint_reader import JointReader
from benchmarks.drives.kinds import KINDS, Draft, Log
from benchmarks.drives.motions import MOTIONS, draw_paths
from benchmarks.drives.plant import Command, Plant, Rollout
from benchmarks.drives.robots import Rng, Robot, measure_loads, write_mjcf
from benchmarks.drives.truth import Truth, list_effects
from selfheal.files import atomic_path
from selfheal.recording import Episode, Recording, Signal, write

FARTHEST = 4.0  # swings; a robot that goes farther was unstable; chosen
LEAST = 0.2  # swings from end to end; a joint that moves less is stuck; chosen


@dataclass(frozen=True)
class Case:
    """What is written of a case.

    Attributes:
        name: of its folder.
        robot: as its model has it.
        truth: what the robot has.
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


class UnfitDraw(Exception):
    """The drawn robot does not follow what is asked of it; another one is drawn."""


def _make_torque_control(plant: Plant, goals: np.ndarray, period: float) -> Command:
    """Commands of a controller outside of the drives, which follows goals by torques.

    Args:
        plant: whose drives it was tuned to; its weight is that of the model.
        goals: (T, n) [rad or m].
        period: [s] between commands.
    """
    truth, robot = plant.truth, plant.robot
    torques, inertias = measure_loads(robot)
    inertias = inertias + [drive.armature for drive in truth.drives]
    late = 1.5 * period + truth.delay + max(drive.lag for drive in truth.drives)
    fast = min(2 * np.pi * 3.0 * robot.rate, 0.25 / late)
    kp, kv = inertias * fast**2, 1.2 * inertias * fast

    def command(k: int, data: Any) -> np.ndarray:
        asked = kp * (goals[k] - data.qpos) - kv * data.qvel
        return np.clip(
            asked + plant.compute_weights(data.qpos), -8 * torques, 8 * torques
        )

    return command


def simulate_episode(draft: Draft, plant: Plant, rng: Rng) -> tuple[Rollout, str]:
    """One episode of a random motion, from rest.

    Args:
        draft: of the case.
        plant: its hidden robot.
        rng: draws the motion.

    Returns:
        What it did, and the name of the motion.

    Raises:
        UnfitDraw: the robot was unstable, or a joint stuck.
    """
    robot, log, n = draft.robot, draft.log, len(draft.robot.links)
    motion = str(rng.choice(list(MOTIONS))) if robot.actuators else "release"
    times = np.arange(int(log.seconds * log.rate)) / log.rate
    rates = robot.rate * rng.uniform(0.7, 1.3, n)
    paths = draw_paths(rng, motion, rates, log.seconds)(times) if robot.actuators else (
        np.zeros((len(times), 0))
    )  # fmt: skip
    follows = robot.is_servo or draft.feedback
    if follows:
        goals = robot.home + robot.swings * paths
        before = np.arange(-int(1.5 * log.rate), 0) / log.rate
        qpos = goals[0]
    else:
        goals = 1.5 * measure_loads(robot)[0] * paths if robot.actuators else paths
        before, qpos = np.zeros(0), rng.uniform(0.4, 1.0, n) * rng.choice([-1, 1], n)
    table = np.concatenate([np.repeat(goals[:1], len(before), 0), goals])
    asked: np.ndarray | Command = table
    if draft.feedback:
        asked = _make_torque_control(plant, table, 1 / log.rate)
    start = _complete_start(robot, qpos)
    run = plant.run(np.concatenate([before, times]), asked, start, 0 * start)
    k = len(before)
    run = Rollout(times, run.ctrl[k:], run.qpos[k:], run.qvel[k:], run.torque[k:],
                  run.whole[k:])  # fmt: skip
    moved = (run.qpos[:, _find_columns(robot)] - robot.home) / robot.swings
    if not np.isfinite(run.qpos).all() or np.ptp(moved, axis=0).min() < LEAST:
        raise UnfitDraw
    if follows and np.abs(moved).max() > FARTHEST:
        raise UnfitDraw
    return run, motion


def _find_columns(robot: Robot) -> list[int]:
    """Columns of the given model's positions that are the driven joints."""
    model = mujoco.MjModel.from_xml_string(write_mjcf(robot))
    return [int(model.joint(name).qposadr[0]) for name in robot.joints]


def _complete_start(robot: Robot, qpos: np.ndarray) -> np.ndarray:
    """All positions [rad or m] where the driven joints (n) are at `qpos`."""
    model = mujoco.MjModel.from_xml_string(write_mjcf(robot))
    empty = np.zeros(1)
    signals = {name: Signal(empty, "joint_position", name, "rad")
               for name in robot.joints}  # fmt: skip
    seen = Recording({"": Episode(empty, np.zeros((1, 0)), (), signals)})
    return JointReader(model, seen).complete_state(qpos, 0 * qpos)[0]


def read_signals(
    draft: Draft, plant: Plant, run: Rollout, rng: Rng
) -> dict[str, Signal]:
    """What the sensors say of a rollout.

    Args:
        draft: of the case.
        plant: its hidden robot.
        run: what it did.
        rng: draws the noise.
    """
    if draft.log.camera:
        return _read_camera(draft, plant, run, rng)
    robot, log, found = draft.robot, draft.log, {}
    torques, columns = measure_loads(robot)[0], _find_columns(robot)
    for i, (link, column) in enumerate(zip(robot.links, columns, strict=True)):
        rad, newton = ("m", "N") if link.slide else ("rad", "N m")
        white = rng.normal(size=(3, len(run.time)))
        q = run.qpos[:, column] + log.noise * link.swing * white[0]
        if log.steps:
            step = (0.1 if link.slide else 2 * np.pi) / log.steps
            q = np.round(q / step) * step
        kind = "joint_position"
        found[f"{link.joint}_position"] = Signal(q, kind, link.joint, rad)
        if log.speed:
            size = log.speed * link.swing * 2 * np.pi * robot.rate
            v = run.qvel[:, column] + size * white[1]
            kind = "joint_velocity"
            found[f"{link.joint}_velocity"] = Signal(v, kind, link.joint, f"{rad}/s")
        if log.torque or log.repeats:
            read = run.torque[:, i] + log.torque * torques[i] * white[2]
            tau = run.ctrl[:, i] if log.repeats else read
            at = robot.actuators[i]
            found[f"{link.joint}_torque"] = Signal(tau, "joint_torque", at, newton)
    return found


def _read_camera(
    draft: Draft, plant: Plant, run: Rollout, rng: Rng
) -> dict[str, Signal]:
    poses, noise, found = plant.compute_poses(run), draft.log.camera, {}
    for i, link in enumerate(draft.robot.links):
        place = poses[:, i, :3] + noise * rng.normal(size=(len(poses), 3))
        turn = poses[:, i, 3:] + noise * rng.normal(size=(len(poses), 4))
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        body = f"b_{link.joint}"
        found[f"{link.joint}_place"] = Signal(place, "body_position", body, "m")
        kind = "body_orientation"
        found[f"{link.joint}_turn"] = Signal(turn, kind, body, "quaternion")
    return found


def _record(draft: Draft, rng: Rng, name: str) -> Case:
    """The case of a draft.

    Args:
        draft: what is recorded.
        rng: draws motions and noise.
        name: of the case.

    Raises:
        UnfitDraw: the robot was unstable, or a joint stuck.
    """
    log, made = draft.log, dict[str, dict[str, Episode]](recording={}, test={})
    plant = Plant(draft.robot, draft.truth)
    for k in range(log.episodes + log.held):
        run, motion = simulate_episode(draft, plant, rng)
        file = "test" if k >= log.episodes else "recording"
        state = log.state or file == "test"
        made[file][f"{k:03d}"] = Episode(
            run.time,
            run.ctrl,
            draft.robot.actuators,
            read_signals(draft, plant, run, rng),
            run.qpos[0] if state else None,
            run.qvel[0] if state else None,
            motion,
        )
    train, test = (Recording(made[k], file=f"{k}.h5") for k in made)
    return Case(name, draft.robot, draft.truth, log, train, test)


def name_case(kind: str, seed: int) -> str:
    """Name of a case's folder."""
    return f"{kind}_{seed:05d}"


def make_case(kind: str, seed: int) -> Case:
    """The case of a kind and a seed, always the same."""
    for attempt in count():
        rng = np.random.default_rng([*kind.encode(), seed, attempt])
        try:
            return _record(KINDS[kind](rng, seed), rng, name_case(kind, seed))
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
        {"names": e.names, "targets": e.targets, "values": e.values}
        for e in list_effects(case.robot, case.truth)
    ]
    truth = {"effects": effects, **case.truth.describe()}
    with atomic_path(place / "truth.json") as path:  # last: the case is whole
        path.write_text(json.dumps(truth, indent=1) + "\n")
    return place
