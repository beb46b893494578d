"""Recordings with a fault: a clean one and a change of its columns in, another out."""

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from selfheal.recording import Recording

DEGREES = 180 / np.pi


def edit(
    recording: Recording,
    change: Callable[[np.ndarray, np.ndarray], np.ndarray],
    *names: str,
    episodes: Collection[str] | None = None,
    ctrl: np.ndarray | float = 1.0,
) -> Recording:
    """The recording with `change(time, values)` of some signals, or of all.

    Args:
        recording: a clean one.
        change: of values (T, ...) at times (T).
        names: of the signals; none: all.
        episodes: that are changed; None: all.
        ctrl: by which commands are multiplied.
    """
    changed = {
        k: replace(e, ctrl=e.ctrl * ctrl, signals={
            n: replace(s, values=change(e.time, s.values))
            if not names or n in names else s
            for n, s in e.signals.items()
        }) if episodes is None or k in episodes else e
        for k, e in recording.episodes.items()
    }  # fmt: skip
    return replace(recording, episodes=changed)


def flip(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values with the other sign."""
    return -values


def to_degrees(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values in degrees."""
    return values * DEGREES
