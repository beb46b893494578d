"""The contract's score of a model on a test: takes recordings, gives one number."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from selfheal.recording import Episode, Recording, reorder_commands

SCORED = ("joint_position", "body_position", "body_orientation", "sensor")


def simulate_open_loop(
    model: Any, recording: Recording
) -> dict[str, dict[str, np.ndarray]]:
    """Joint positions, body poses and sensors of a model, by episode and signal.

    Args:
        model: compiled, with the coordinates of qpos0.
        recording: whose episodes state where they start.
    """
    return {k: _simulate_episode(model, e) for k, e in recording.episodes.items()}


def _simulate_episode(model: Any, episode: Episode) -> dict[str, np.ndarray]:
    data, step = mujoco.MjData(model), float(model.opt.timestep)
    there = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = episode.qpos0, episode.qvel0
    ctrl = reorder_commands(episode, model).ctrl
    since, done, found = episode.time - episode.time[0], 0, []
    for i, at in enumerate(since):
        steps = int((at + 1e-9) / step) - done
        if steps:
            mujoco.mj_step(model, data, steps)
        done += steps
        qpos = data.qpos.copy()
        mujoco.mj_integratePos(model, qpos, data.qvel, at - done * step)
        there.qpos[:], there.qvel[:] = qpos, data.qvel
        there.ctrl[:] = data.ctrl[:] = ctrl[i]
        if model.nsensor:
            mujoco.mj_forward(model, there)
        found.append((qpos, there.sensordata.copy()))
    qpos, sensed = (np.array(rows) for rows in zip(*found, strict=True))
    return _extract_signals(model, episode, qpos, sensed)


def _extract_signals(
    model: Any, episode: Episode, qpos, sensed
) -> dict[str, np.ndarray]:
    found = {}
    for name, signal in episode.signals.items():
        if signal.kind == "joint_position":
            found[name] = qpos[:, model.joint(signal.target).qposadr[0]]
        elif signal.kind == "body_position":
            found[name] = qpos[:, :3]
        elif signal.kind == "body_orientation":
            found[name] = qpos[:, 3:7]
        elif signal.kind == "sensor":
            sensor = model.sensor(signal.target)
            found[name] = sensed[:, sensor.adr[0] : sensor.adr[0] + sensor.dim[0]]
    return found


def compute_score(
    predicted: Mapping[str, Mapping[str, np.ndarray]], seen: Recording
) -> float:
    """Normalized RMSE over the position-like signals (contract section 2).

    Args:
        predicted: values by episode and signal.
        seen: the recording that they are compared with.
    """
    names = {
        name: signal.kind
        for episode in seen.episodes.values()
        for name, signal in episode.signals.items()
        if signal.kind in SCORED
    }
    parts = []
    for name, kind in names.items():
        pairs = [
            _align_columns(predicted[k][name], e.signals[name].values, kind)
            for k, e in seen.episodes.items()
        ]
        error = np.concatenate([p - s for p, s in pairs])
        spread = np.concatenate([s for _, s in pairs]).var(0).sum()
        parts.append(np.mean(np.sum(error**2, 1)) / spread)
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


def extract_values(recording: Recording) -> dict[str, dict[str, np.ndarray]]:
    """The values of a recording's signals, by episode and signal."""
    return {
        name: {key: signal.values for key, signal in episode.signals.items()}
        for name, episode in recording.episodes.items()
    }


def drop_samples(recording: Recording) -> Recording:
    """The recording with every sample missing: the inputs of a test alone."""
    episodes = {
        key: replace(
            e,
            signals={
                n: replace(s, values=np.full_like(s.values, np.nan))
                for n, s in e.signals.items()
            },
        )
        for key, e in recording.episodes.items()
    }
    return replace(recording, episodes=episodes)
