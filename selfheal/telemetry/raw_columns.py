"""Columns as they were read: takes a recording, gives the liveliest of each signal."""

from collections.abc import Callable, Collection, Iterator

import numpy as np

from ..recording import Recording
from ..recording.data import Floats

# kinds of signals that sensors read of a motion
READ = ("joint_position", "joint_velocity", "body_position", "body_orientation",
        "body_linear_velocity", "body_angular_velocity", "sensor")  # fmt: skip


def list_columns(
    recording: Recording,
    kinds: Collection[str],
    least: int,
    measure: Callable[[Floats], Floats],
) -> Iterator[tuple[str, str, Floats, Floats]]:
    """The liveliest column of each signal in each episode.

    Args:
        recording: of the robot.
        kinds: of the signals.
        least: samples that are read.
        measure: how lively (d) columns (n, d) are.

    Yields:
        Episode, signal, times (n) [s] and readings (n) [unit].
    """
    for episode, e in recording.episodes.items():
        for name, signal in e.signals.items():
            values = signal.values.reshape(e.time.size, -1)
            read = np.isfinite(values).all(axis=1)
            if signal.kind not in kinds or read.sum() < least:
                continue
            column = int(np.argmax(measure(values[read])))
            yield episode, name, e.time[read], values[read, column]
