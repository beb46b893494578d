"""Rows of zeros: takes a recording, finds those that no sensor of it has read."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...logs.motion import find_zero_rows
from ...recording import Episode
from ..context import Context
from ..fault import ColumnCorrection, Fault, format_columns

MEASURED = ("joint_position", "body_position")  # in which zeros are looked for
SILENT = 0.5  # share of such rows in which other columns are 0 or not read; chosen


def find(context: Context) -> Iterator[Fault]:
    """Rows in which all positions are 0 at once, between others that are not.

    The recording of the context is then without these readings.
    """
    counts, columns = dict[str, tuple[int, int]](), dict[str, None]()
    episodes = {**context.recording.episodes}
    for key, episode in context.recording.episodes.items():
        rows, names = _find_in_episode(episode)
        if names:
            first = _stack(episode, names[:1])
            counts[key] = int(rows.sum()), int(np.isfinite(first).all(axis=1).sum())
            columns |= dict.fromkeys(names)
            episodes[key] = _leave_out(episode, rows, names)
    if not counts:
        return
    context.recording = replace(context.recording, episodes=episodes)
    zeros, read = (sum(each) for each in zip(*counts.values(), strict=True))
    seen = (
        f"in {zeros} of {read} rows {format_columns(list(columns)[:3])}"
        f"{' and others' * (len(columns) > 3)} are 0 at once, and go there and back "
        "as no motion does: rows of a second publisher, or of a bus that was lost"
    )
    rules = tuple(ColumnCorrection(name, {"missing": 0.0}) for name in columns)
    yield Fault("zeros", tuple(counts), tuple(columns), "", seen, corrections=rules)


def _find_in_episode(episode: Episode) -> tuple[np.ndarray, list[str]]:
    """Rows (T) of zeros, and the signals that have them."""
    found, names = np.zeros(episode.time.size, bool), list[str]()
    for kind in MEASURED:
        of_kind = [n for n, s in episode.signals.items() if s.kind == kind]
        if of_kind:
            rows = find_zero_rows(_stack(episode, of_kind))
            found |= rows
            names += of_kind * bool(rows.any())
    for name, signal in episode.signals.items():
        values = signal.values.reshape(episode.time.size, -1)[found]
        if name not in names and values.size:
            silent = (values == 0).all(axis=1)
            names += [name] * bool(silent.mean() > SILENT)
    return found, names


def _stack(episode: Episode, names: Sequence[str]) -> np.ndarray:
    """Columns (T, d) of signals side by side."""
    parts = [episode.signals[n].values.reshape(episode.time.size, -1) for n in names]
    return np.concatenate(parts, axis=1)


def _leave_out(episode: Episode, rows: np.ndarray, names: Sequence[str]) -> Episode:
    """An episode whose signals were not read in some rows."""
    signals = dict(episode.signals)
    for name in names:
        values = signals[name].values.copy()
        values[rows] = np.nan
        signals[name] = replace(signals[name], values=values)
    return replace(episode, signals=signals)
