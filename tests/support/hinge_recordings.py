"""Recordings of hinges, sampled at uneven times and on a grid."""

import numpy as np

from selfheal.diagnosis.data.episodes import build_channels, sample_episode
from selfheal.recording import Episode, Recording, Signal

STEP = 0.002  # of the grid [s]


def draw_times(rng, count=80) -> np.ndarray:
    """Times (count) of samples that are unevenly apart [s]."""
    return np.cumsum(rng.uniform(0.003, 0.02, count))


def make_hinge_recording(time, **columns) -> Recording:
    """One episode of hinges whose positions were read."""
    signals = {
        name: Signal(values, "joint_position", name, "rad")
        for name, values in columns.items()
    }
    episode = Episode(time, np.zeros((time.size, 0)), (), signals)
    return Recording({"only": episode})


def sample_recording(recording: Recording):
    """Its episode on a grid of time steps, and its channels."""
    found = build_channels([recording])
    (episode,) = recording.episodes.values()
    return sample_episode("only", episode, found, STEP), found
