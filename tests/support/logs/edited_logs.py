"""Recordings with a fault: motions of a model, and columns that are changed."""

from collections.abc import Callable, Collection
from dataclasses import replace

import mujoco
import numpy as np

from selfheal.recording import Recording

RATE = 100  # [Hz] of a recording
DEGREES = 180 / np.pi


def drive(model: mujoco.MjModel, commands: np.ndarray) -> np.ndarray:
    """Positions (T, nq) of a model before each of some commands (T, nu)."""
    data, rows = mujoco.MjData(model), []
    for command in commands:
        data.ctrl[:] = command
        rows.append(data.qpos.copy())
        mujoco.mj_step(model, data, round(1 / RATE / model.opt.timestep))
    return np.array(rows)


def edit(
    recording: Recording,
    change: Callable[[np.ndarray, np.ndarray], np.ndarray],
    *names: str,
    episodes: Collection[str] | None = None,
    ctrl: np.ndarray | float = 1.0,
) -> Recording:
    """The recording with `change(time, values)` of some signals, or of all.

    Args:
        change: of values (T, ...) at times (T).
        episodes: that are changed; None: all.
    """
    changed = dict(recording.episodes)
    for key in changed if episodes is None else episodes:
        episode = changed[key]
        signals = dict(episode.signals)
        for name in names or signals:
            values = change(episode.time, signals[name].values)
            signals[name] = replace(signals[name], values=values)
        changed[key] = replace(episode, ctrl=episode.ctrl * ctrl, signals=signals)
    return replace(recording, episodes=changed)


def flip(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values with the other sign."""
    return -values


def to_degrees(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values in degrees."""
    return values * DEGREES
