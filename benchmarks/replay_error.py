"""The contract's score of a model on a test: takes recordings, gives one number."""

from collections.abc import Iterator, Mapping

import mujoco
import numpy as np
from mujoco import rollout

from benchmarks.recordings import edit_episodes, edit_values
from selfheal.recording import Episode, Recording, reorder_commands

SCORED = ("joint_position", "body_position", "body_orientation", "sensor")
WORST = 10.0  # standard deviations; what is farther off, or diverged, counts as this
Values = dict[str, np.ndarray]


def simulate_open_loop(
    model: mujoco.MjModel, recording: Recording, delay: float = 0.0
) -> dict[str, Values]:
    """Joint positions, body poses and sensors of a model, by episode and signal.

    Args:
        model: compiled, with the coordinates of qpos0.
        recording: whose episodes state where they start.
        delay: [s] of the commands.
    """
    episodes = recording.episodes.items()
    return {k: _simulate_episode(model, e, delay) for k, e in episodes}


def average_commands(
    time: np.ndarray, ctrl: np.ndarray, step: float, delay: float
) -> np.ndarray:
    """Mean command (K, nu) over each time step, held between samples, late by `delay`.

    Before its first sample the command is that of the first sample.

    Args:
        time: (T) [s] of the samples, from 0.
        ctrl: (T, nu) commands.
        step: [s] of the model.
        delay: [s] of the commands.
    """
    count = int(np.ceil(time[-1] / step - 1e-9)) + 1
    edges = np.arange(count + 1) * step - delay
    # the integral of what is held is piecewise linear, so its differences are exact
    knots = np.concatenate([[-1.0], time, [time[-1] + 1.0]])
    held = np.concatenate([ctrl[:1], ctrl])
    steps = np.cumsum(held * np.diff(knots)[:, None], 0)
    area = np.concatenate([np.zeros((1, held.shape[1])), steps])
    columns = [np.interp(edges, knots, column) for column in area.T]
    return np.diff(np.array(columns).T.reshape(count + 1, -1), axis=0) / step


def _simulate_episode(model: mujoco.MjModel, episode: Episode, delay: float) -> Values:
    data, step = mujoco.MjData(model), float(model.opt.timestep)
    data.qpos[:], data.qvel[:] = episode.qpos0, episode.qvel0
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, data, start, full)
    ctrl = reorder_commands(episode, model).ctrl
    since = episode.time - episode.time[0]
    control = average_commands(since, ctrl, step, delay)
    states, _ = rollout.rollout(
        model, data, start, control if model.nu else None, nstep=len(control)
    )
    states, q, v = np.vstack([start, states[0]]), 1 + model.nq, 1 + model.nq + model.nv
    rows, sensed = [], []
    for i, at in enumerate(since):
        done = int((at + 1e-9) / step)
        data.qpos[:], data.qvel[:] = states[done, 1:q], states[done, q:v]
        mujoco.mj_integratePos(model, data.qpos, data.qvel, at - done * step)
        data.ctrl[:] = ctrl[i]
        if model.nsensor:
            mujoco.mj_forward(model, data)
        rows.append(data.qpos.copy())
        sensed.append(data.sensordata.copy())
    return _extract_signals(model, episode, np.array(rows), np.array(sensed))


def _extract_signals(model: mujoco.MjModel, episode: Episode, qpos, sensed) -> Values:
    found = {}
    for name, signal in episode.signals.items():
        if signal.kind == "joint_position":
            found[name] = qpos[:, model.joint(signal.target).qposadr[0]]
        elif signal.kind.startswith("body"):
            place, turn = _read_pose(model, signal.target, qpos)
            found[name] = place if signal.kind == "body_position" else turn
        elif signal.kind == "sensor":
            sensor = model.sensor(signal.target)
            found[name] = sensed[:, sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]
    return found


def _read_pose(model: mujoco.MjModel, body: str, qpos: np.ndarray):
    """Position (T, 3) and quaternion (T, 4) of a body."""
    data, poses = mujoco.MjData(model), []
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        poses.append(np.concatenate([data.body(body).xpos, data.body(body).xquat]))
    return np.array(poses)[:, :3], np.array(poses)[:, 3:]


def list_errors(
    predicted: Mapping[str, Mapping[str, np.ndarray]], seen: Recording
) -> Iterator[np.ndarray]:
    """Errors over spread (rows, columns) [1] of each position-like signal."""
    names = {
        name: signal.kind
        for episode in seen.episodes.values()
        for name, signal in episode.signals.items()
        if signal.kind in SCORED
    }
    for name, kind in names.items():
        pairs = [
            _align_columns(predicted[k][name], e.signals[name].values, kind)
            for k, e in seen.episodes.items()
        ]
        error = np.concatenate([p - s for p, s in pairs])
        spread = np.concatenate([s for _, s in pairs]).var(0).sum()
        yield np.nan_to_num(error / np.sqrt(spread), nan=WORST).clip(-WORST, WORST)


def compute_score(
    predicted: Mapping[str, Mapping[str, np.ndarray]], seen: Recording
) -> float:
    """Normalized RMSE over the position-like signals (contract section 2)."""
    parts = [np.mean(np.sum(e**2, 1)) for e in list_errors(predicted, seen)]
    return float(np.sqrt(np.mean(parts)))


def _align_columns(predicted: np.ndarray, seen: np.ndarray, kind: str):
    """Both as (rows where something was seen, columns)."""
    rows = len(seen)
    predicted, seen = predicted.reshape(rows, -1), seen.reshape(rows, -1)
    there = np.isfinite(seen).all(1)
    predicted, seen = predicted[there], seen[there]
    if kind == "body_orientation":
        sign = np.where((predicted * seen).sum(1) < 0, -1.0, 1.0)
        predicted = predicted * sign[:, None]
    return predicted, seen


def extract_values(recording: Recording) -> dict[str, Values]:
    """The values of a recording's signals, by episode and signal."""
    return {
        name: {key: signal.values for key, signal in episode.signals.items()}
        for name, episode in recording.episodes.items()
    }


def drop_samples(recording: Recording) -> Recording:
    """The recording with every sample missing: the inputs of a test alone."""

    def drop(name: str, values: np.ndarray) -> np.ndarray:
        return np.full_like(values, np.nan)

    return edit_episodes(recording, lambda e: edit_values(e, drop))
