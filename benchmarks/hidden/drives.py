"""The suite of drives that a model lacks: drafts in, recorded cases out."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import count

import mujoco
import numpy as np

from benchmarks.hidden import motions as move
from benchmarks.hidden.case import Case, Experiment, Session, build_case
from benchmarks.hidden.drafts import KINDS, Draft, Log
from benchmarks.hidden.robots.robot import Rng, Robot
from benchmarks.hidden.sensors import (
    Instruments,
    Record,
    Sensor,
    measure_joints,
    measure_pose,
    measure_torque,
)
from benchmarks.hidden.simulator import Command, MotionPlan, Rollout
from benchmarks.hidden.truth import UnfitDraw
from benchmarks.recordings import edit_episodes, select_signals
from selfheal.recording import Episode, Recording

FARTHEST = 4.0  # swings; a robot that goes farther was unstable; chosen
LEAST = 0.2  # swings from end to end; a joint that moves less is stuck; chosen
HORIZONS = {"0.5 s": 0.5, "2 s": 2.0, "whole": 0.0}  # [s] of the pieces; 0: episodes
CALM = 0.3  # [s] in which the next piece may begin
SETTLE = 1.5  # [s] at the first goal
SINCE = 0.05  # [s] of motion before the first sample; more than clocks are apart
# motions, and how fast they are played at a rate of 1 Hz
MOTIONS = {"multisine": 0.7, "chirp": 0.7, "steps": 0.75, "bits": 1.0, "holds": 1.45}


def _list_sensors(robot: Robot, log: Log) -> dict[str, Sensor]:
    found: dict[str, Sensor] = {}
    for joint, torque in robot.load.items():
        if log.camera:
            found |= measure_pose(f"b_{joint}", log.camera, 2 * log.camera)
            continue
        swing = robot.amplitude[joint]
        speed = log.speed * swing * 2 * np.pi * robot.rate
        sensors = measure_joints(robot, [joint], log.noise * swing, speed)
        if log.steps:
            step = (0.1 if robot.is_slide(joint) else 2 * np.pi) / log.steps
            name = f"{joint}_position"
            sensors[name] = replace(sensors[name], step=step)
        if log.torque or log.repeats:
            noise = 0.0 if log.repeats else log.torque * torque
            measured = measure_torque(robot, joint, noise)
            sensors[f"{joint}_torque"] = replace(measured, repeats=log.repeats)
        found |= sensors
    return found


def _set_feedback(draft: Draft) -> Robot:
    """The robot with gains of a controller outside of the drives, tuned to them."""
    robot, log = draft.robot, draft.log
    values = {(one.effect.name, one.target): one.values for one in draft.hidden}
    lags = [v["timeconst"] for (n, _), v in values.items() if n == "actuator_lag"]
    shift = values.get(("clock_shift", "world"), {"shift": 0.0})["shift"]
    late = 1.5 / log.rate + shift + max(lags, default=0.0)
    fast, gains = min(2 * np.pi * 3.0 * robot.rate, 0.25 / late), {}
    for joint, moved in robot.inertia.items():
        inertia = moved + values["armature", f"joint:{joint}"]["armature"]
        gains[joint] = inertia * fast**2, 1.2 * inertia * fast
    return replace(robot, gains=gains)


def _carry_weight(robot: Robot, follow: Command) -> Command:
    """Torques of a feedback with those that hold the given model, within limits."""
    model, data = robot.model, mujoco.MjData(robot.model)
    most = 8 * np.array(list(robot.load.values()))
    at = [model.joint(joint).dofadr[0] for joint in robot.load]

    def command(i: int, there: mujoco.MjData) -> np.ndarray:
        data.qpos[:] = there.qpos
        mujoco.mj_forward(model, data)
        return np.clip(follow(i, there) + data.qfrc_bias[at], -most, most)

    return command


def _plan_episode(draft: Draft, rng: Rng) -> MotionPlan:
    """An episode of a random motion: from rest, or let go."""
    robot, log, joints = draft.robot, draft.log, tuple(draft.robot.load)
    rates = robot.rate * rng.uniform(0.7, 1.3, len(joints))
    times = np.arange(int(log.seconds * log.rate)) / log.rate
    rows = np.round(times / robot.fine).astype(int)
    still = np.zeros(robot.model.nv)
    if robot.drive == "none":
        return move.plan_free("release", rows, _draw_start(robot, rng), still)
    motion = str(rng.choice(list(MOTIONS)))
    paces = MOTIONS[motion] * rates
    waves = [move.MOTIONS[motion](rows * robot.fine * pace, rng) for pace in paces]
    sizes, homes, torques = (
        np.array([of[joint] for joint in joints])
        for of in (robot.amplitude, robot.center, robot.load)
    )
    if robot.drive == "torque" and not draft.feedback:
        table = move.command_table(1.5 * torques * np.stack(waves, 1))
        return MotionPlan(motion, rows, table, _draw_start(robot, rng), still)
    goals = homes + sizes * np.stack(waves, 1)
    rows = rows + round(SINCE / robot.fine)
    start = _close_loops(robot.model, joints, goals[0])
    if not draft.feedback:
        return move.plan_goals(robot, motion, rows, goals, qpos=start, settle=SETTLE)
    command = _carry_weight(robot, move.follow_goals(_set_feedback(draft), goals))
    return MotionPlan(motion, rows, command, start, still, settle=SETTLE)


def _draw_start(robot: Robot, rng: Rng) -> np.ndarray:
    n = robot.model.nq
    return rng.uniform(0.4, 1.0, n) * rng.choice([-1, 1], n)


def _close_loops(
    model: mujoco.MjModel, joints: Sequence[str], qpos: np.ndarray
) -> np.ndarray:
    """All coordinates at those (n) of some joints, as the equality constraints ask."""
    data = mujoco.MjData(model)
    read = [model.joint(name).qposadr[0] for name in joints]
    rest = np.setdiff1d(np.arange(model.nq), read)
    data.qpos[read] = qpos
    for _ in range(20 if len(rest) else 0):  # Newton's steps
        mujoco.mj_forward(model, data)
        equal = data.efc_type[: data.nefc] == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        # dense: the model is small
        rows = data.efc_J.reshape(-1, model.nv)[: data.nefc][equal]
        gap = data.efc_pos[: data.nefc][equal]
        data.qpos[rest] -= np.linalg.pinv(rows[:, rest]) @ gap
    return data.qpos.copy()


def _check_rollout(draft: Draft, run: Rollout) -> None:
    """Refuse a robot that was unstable, or a joint that stuck."""
    robot = draft.robot
    for joint, swing in robot.amplitude.items():
        q = run.qpos[:, robot.model.joint(joint).qposadr[0]] - robot.center[joint]
        if np.ptp(q) < LEAST * swing:
            raise UnfitDraw(f"{joint} hardly moves")
        far = np.abs(q).max() > FARTHEST * swing
        if far and (robot.drive == "servo" or draft.feedback):
            raise UnfitDraw(f"{joint} goes too far")


def _cut(record: Record, seconds: float) -> Recording:
    """Pieces without the places of bodies: of links near the base they hardly move."""

    def drop(e: Episode) -> Episode:
        kept = [n for n, s in e.signals.items() if s.kind != "body_position"]
        return select_signals(e, kept)

    return edit_episodes(record.cut(seconds, CALM).seen, drop)


def name_case(kind: str, seed: int) -> str:
    """Name of a case's folder."""
    return f"{kind}_{seed:05d}"


def draft_case(kind: str, seed: int, attempt: int) -> tuple[Draft, Experiment, Rng]:
    """A draw of a case: its draft, the experiment, and what draws the recording."""
    rng = np.random.default_rng([*kind.encode(), seed, attempt])
    draft = KINDS[kind](rng, seed)
    robot = draft.robot
    errors = {
        ("mass", body): error
        for body, error in zip(robot.links, draft.masses, strict=True)
    }
    instruments = Instruments(robot, _list_sensors(robot, draft.log))
    experiment = Experiment(robot, instruments, errors, "implicitfast")
    return draft, experiment, rng


def make_case(kind: str, seed: int) -> Case:
    """The case of a kind and a seed, always the same."""
    for attempt in count():
        draft, experiment, rng = draft_case(kind, seed, attempt)
        train, test = (
            (_plan_episode(draft, rng) for _ in range(number))
            for number in (draft.log.episodes, draft.log.held)
        )
        session = Session(
            train,
            test,
            (rng, rng),
            draft.log.state,
            check=partial(_check_rollout, draft),
        )
        try:
            case, learned, proof = build_case(
                name_case(kind, seed),
                experiment,
                draft.hidden,
                session,
                given=draft.state_model(),
                kind=kind,
                seed=seed,
                attempt=attempt,
                joints=len(draft.robot.load),
                rate=draft.log.rate,
            )
        except UnfitDraw:
            continue
        pieces = {f"test {k}": _cut(proof, s) for k, s in HORIZONS.items()}
        pieces["train 0.5 s"] = _cut(learned, HORIZONS["0.5 s"])
        return replace(case, pieces=pieces)
    raise AssertionError
