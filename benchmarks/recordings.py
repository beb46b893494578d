"""Changed copies of recordings: of their episodes, their readings, their rows."""

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from selfheal.recording import Episode, Recording


def edit_episodes(
    recording: Recording, change: Callable[[Episode], Episode]
) -> Recording:
    """A recording with every episode changed."""
    episodes = {name: change(e) for name, e in recording.episodes.items()}
    return replace(recording, episodes=episodes)


def edit_values(
    episode: Episode, change: Callable[[str, np.ndarray], np.ndarray]
) -> Episode:
    """An episode with other readings, made of a signal's name and values (T, ...)."""
    signals = {
        n: replace(s, values=change(n, s.values)) for n, s in episode.signals.items()
    }
    return replace(episode, signals=signals)


def select_rows(episode: Episode, rows: slice | np.ndarray) -> Episode:
    """An episode of some of its samples."""
    kept = edit_values(episode, lambda name, values: values[rows])
    return replace(kept, time=episode.time[rows], ctrl=episode.ctrl[rows])


def select_signals(episode: Episode, names: Collection[str]) -> Episode:
    """An episode of some of its signals."""
    signals = {n: s for n, s in episode.signals.items() if n in names}
    return replace(episode, signals=signals)


def join_readings(recording: Recording, name: str) -> np.ndarray:
    """(T, ...) readings of a signal in all episodes."""
    return np.concatenate([e.signals[name].values for e in recording.episodes.values()])
