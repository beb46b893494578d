"""The other cases made: takes a case, gives model, recording, test and key."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from benchmarks.other_cases.cases import OtherCase
from benchmarks.other_cases.motions import Rng
from benchmarks.other_cases.robot import Robot, Sensor
from benchmarks.replay_error import compute_score, extract_values, simulate_open_loop
from benchmarks.sealed.cases import Case
from benchmarks.sealed.sensors import cut_segments
from selfheal.recording import Episode, Recording, Signal, list_controls

STATED = 0.06  # share that a stated mass is off at most; a damping twice that
TEST = 1000  # added to the seed of a recording


@dataclass(frozen=True)
class Rollout:
    """What the robot did.

    Attributes:
        time: (T) [s] of each sample.
        ctrl: (T, nu) commands as sent.
        qpos: (T, nq), qvel: (T, nv) in the given model's coordinates.
        seen: by signal: (T) or (T, d), biases included, noise not.
    """

    time: np.ndarray
    ctrl: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    seen: dict[str, np.ndarray]


def make_hidden_spec(case: OtherCase) -> Any:
    """MjSpec of the hidden robot: wrong stated values, effects, the given time step."""
    rng = np.random.default_rng(case.stated)
    spec = mujoco.MjSpec.from_string(case.robot.xml)
    for body in spec.bodies[1:]:
        for geom in body.geoms:
            if geom.mass > 0:
                geom.mass *= 1 + STATED * rng.uniform(-1, 1)
    for joint in spec.joints:
        joint.damping = np.array(joint.damping) * (1 + 2 * STATED * rng.uniform(-1, 1))
    case.change(spec)
    return spec


def compile_hidden_robot(case: OtherCase) -> Any:
    """Compiled model of the hidden robot, at its finer time step."""
    spec = make_hidden_spec(case)
    spec.option.timestep = case.robot.fine or spec.option.timestep / 5
    return spec.compile()


def _read_sensor(reading: Sensor, data: Any) -> Any:
    """What a sensor would say without noise; those of the model a fine step late."""
    if reading.kind == "joint_position":
        value = data.joint(reading.target).qpos[0]
    elif reading.kind == "joint_velocity":
        value = data.joint(reading.target).qvel[0]
    elif reading.kind == "body_position":
        value = data.body(reading.target).xpos
    elif reading.kind == "body_orientation":
        value = data.body(reading.target).xquat
    else:
        found = data.sensor(reading.target).data
        value = found if len(found) > 1 else found[0]
    return value + np.array(reading.bias)


def simulate_episode(case: OtherCase, model: Any, rng: Rng) -> Rollout:
    """Simulate one episode; a command takes `case.delay` to arrive.

    Args:
        case: whose robot moves.
        model: compiled hidden robot.
        rng: draws the motion, the start and the jitter.
    """
    robot, data = case.robot, mujoco.MjData(model)
    if robot.start:
        robot.start(data, rng)
    mujoco.mj_forward(model, data)
    command, rows, sent = robot.motion(rng, model), [], []
    step, due = model.opt.timestep, 0.0
    for i in range(int(robot.seconds / step)):
        now = i * step
        if now >= due - 1e-12:
            ctrl = np.asarray(command(now, data), float)
            sent.append((now + case.delay, ctrl))
            seen = {k: _read_sensor(r, data) for k, r in robot.signals.items()}
            rows.append((now, ctrl, data.qpos.copy(), data.qvel.copy(), seen))
            due += 1 / robot.rate * (1 + case.jitter * rng.uniform(-1, 1))
        while sent and sent[0][0] <= now + 1e-12:
            data.ctrl[:] = sent.pop(0)[1]
        mujoco.mj_step(model, data)
    return _collect_rollout(case.robot, model, rows)


def _collect_rollout(robot: Robot, model: Any, rows: Sequence[Any]) -> Rollout:
    """The samples as arrays, without the joints that the given model does not have."""
    time, ctrl, qpos, qvel, seen = zip(*rows, strict=True)
    given = mujoco.MjModel.from_xml_string(robot.xml)
    names = {given.joint(j).name for j in range(given.njnt)}
    extra = [j for j in range(model.njnt) if model.joint(j).name not in names]
    return Rollout(
        np.array(time),
        np.array(ctrl).reshape(len(time), model.nu),
        np.delete(np.array(qpos), model.jnt_qposadr[extra], axis=1),
        np.delete(np.array(qvel), model.jnt_dofadr[extra], axis=1),
        {k: np.array([row[k] for row in seen]) for k in robot.signals},
    )


def _add_noise(
    case: OtherCase, reading: Sensor, seen: np.ndarray, rng: Rng
) -> np.ndarray:
    """A signal as recorded."""
    if reading.step:
        seen = np.round(seen / reading.step) * reading.step
    seen = seen + reading.noise * rng.normal(size=seen.shape)
    if reading.kind == "body_orientation":
        seen = seen / np.linalg.norm(seen, axis=1, keepdims=True)
    if case.missing:
        seen[rng.random(len(seen)) < case.missing] = np.nan
    return seen


def _make_episode(
    case: OtherCase, model: Any, run: Rollout, seen, *, state: bool
) -> Episode:
    readings = case.robot.signals
    signals = {
        name: Signal(seen[name], r.kind, r.target, r.unit)
        for name, r in readings.items()
    }
    return Episode(
        run.time,
        run.ctrl,
        tuple(c.actuator for c in list_controls(model)),
        signals,
        run.qpos[0] if state else None,
        run.qvel[0] if state else None,
    )


def record_case(
    case: OtherCase, seed: int, *, state: bool
) -> tuple[Recording, Recording, list]:
    """A recording, the same without noise, and the rollouts behind both.

    Args:
        case: that is recorded.
        seed: of the motions and the noise.
        state: whether episodes state where they start.
    """
    rng, model, readings = (
        np.random.default_rng(seed),
        compile_hidden_robot(case),
        case.robot.signals,
    )
    noisy, clean, runs = {}, {}, []
    for k in range(case.robot.episodes):
        run = simulate_episode(case, model, rng)
        seen = {n: _add_noise(case, r, run.seen[n], rng) for n, r in readings.items()}
        noisy[f"run{k}"] = _make_episode(case, model, run, seen, state=state)
        clean[f"run{k}"] = _make_episode(case, model, run, run.seen, state=state)
        runs.append(run)
    file = "recording.h5"
    return Recording(noisy, file=file), Recording(clean, file=file), runs


def make_case(case: OtherCase) -> Case:
    """A case with its recordings and key; always the same for the same case."""
    train, _, _ = record_case(case, case.seed, state=case.state)
    test, clean, runs = record_case(case, case.seed + TEST, state=True)
    if length := case.robot.piece:
        test, clean = (
            cut_segments(test, runs, length),
            cut_segments(clean, runs, length),
        )
    key = make_key(case) | {"test": _score_references(case, test, clean)}
    return Case(case.name, case.robot, train, test, key)


def _score_references(
    case: OtherCase, test: Recording, clean: Recording
) -> dict[str, float]:
    """Scores on the test as the sealed benchmark's key has them."""
    given = mujoco.MjModel.from_xml_string(case.robot.xml)
    stated = make_hidden_spec(replace(case, change=lambda spec: None)).compile()
    return {
        "given": compute_score(simulate_open_loop(given, test), test),
        "stated": compute_score(simulate_open_loop(stated, test), test),
        "floor": compute_score(extract_values(clean), test),
    }


def make_key(case: OtherCase) -> dict[str, Any]:
    """The part of a case's key that the scorer reads."""
    signals = case.robot.signals.items()
    return {
        "format": "selfheal-sealed-key",
        "version": 1,
        "kind": case.kind,
        "seed": case.seed,
        "robot": case.robot.name,
        "effects": [_describe_effect(effect) for effect in case.effects],
        "quantized_noise": [f"sensor:{name}" for name, r in signals if r.step],
    }


def _describe_effect(effect: Any) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "effect": effect.name,
        "target": effect.target,
        "parameters": [
            {"name": name, "value": value, "unit": unit}
            for name, (value, unit) in effect.values.items()
        ],
    }
    if effect.measured:
        entry["measured"] = effect.measured
    return entry
