"""Held-out parts (contract section 2): takes a Recording, gives two of them."""

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import UnknownNameError
from .data import Episode, Floats, Location
from .recording import Recording

# of an episode's duration, left out beside each held-out piece; chosen: both sides of
# a cut share the same motion, and a fit that saw one has nearly seen the other
GAP = 0.05
HELD_OUT_PART = 1 / 3  # of a lone episode, its end; the contract's
EDGES = (0.02, 0.98)  # quantiles that an episode reaches; chosen: not its outliers
_SEGMENT = re.compile(r"(?P<id>.+)\[(?P<start>[^\],]+),(?P<end>[^\],]+)\]")


def split(
    recording: Recording, *, held_out: Sequence[str] = ()
) -> tuple[Recording, Recording]:
    """Part a recording into what a fit may see and what it is judged on.

    A piece of an episode becomes an episode `id[t0,t1]`, and a gap on either side of
    it goes to neither part. A piece that does not begin with its episode has no qpos0
    and qvel0: its initial state was not recorded.

    Args:
        held_out: `id`, `id[t0,t1]` [s], `file.h5:id` or `file.h5:id[t0,t1]`. Without
            any: of one episode the last third, of several a third of them but the
            first, such that what is fitted still spans what is held out.

    Returns:
        What may be fitted, what is held out.

    Raises:
        UnknownNameError: a name that is no episode of this file.
        RecordingError: a piece without samples, or nothing left to fit.
    """
    windows = (
        _parse_windows(recording, held_out) if held_out else _choose_windows(recording)
    )
    fit: dict[str, Episode] = {}
    held: dict[str, Episode] = {}
    for name, episode in recording.episodes.items():
        _split_episode(name, episode, windows.get(name, []), fit, held)
    if not fit:
        raise Location(recording.file).make_error(
            "held out is everything; nothing is left"
        )
    return replace(recording, episodes=fit), replace(recording, episodes=held)


def strip_file(entry: str, file: str) -> str:
    """A held-out name without the file before it: its path, or the end of that."""
    own = Path(os.path.abspath(file)).parts
    for colon in re.finditer(":", entry):
        named = entry[: colon.start()]
        parts = Path(os.path.normpath(named)).parts if named else ()
        same = named == file or os.path.realpath(named) == os.path.realpath(file)
        if named and (same or own[-len(parts) :] == parts):
            return entry[colon.end() :]
    return entry


def strip_window(name: str) -> str:
    """The episode of which a name, such as `split` gives it, is or is a piece."""
    piece = _SEGMENT.fullmatch(name)
    return name if piece is None else piece["id"]


def shorten_names(files: Sequence[str]) -> list[str]:
    """Of each file the shortest end of its path that no other one of them has."""
    every = [Path(os.path.abspath(file)).parts for file in files]
    found = []
    for own in every:
        others, k = set(every) - {own}, 1
        while any(parts[-k:] == own[-k:] for parts in others):
            k += 1
        found.append(os.path.join(*own[-k:]))
    return found


_Windows = dict[str, list[tuple[float, float] | None]]  # None: the whole episode


def _choose_windows(recording: Recording) -> _Windows:
    names = list(recording.episodes)
    if len(names) > 1:
        chosen = _choose_spanned(
            list(recording.episodes.values()), max(1, len(names) // 3)
        )
        return {name: [None] for i, name in enumerate(names) if i in chosen}
    name, time = names[0], recording.episodes[names[0]].time
    if time.size < 3:
        raise Location(recording.file, name).make_error(
            f"too few samples to hold out the last third: {time.size}; would fit: at "
            "least 3"
        )
    start = time[-1] - HELD_OUT_PART * (time[-1] - time[0])
    return {name: [(float(start), float(time[-1]))]}


def _choose_spanned(episodes: Sequence[Episode], count: int) -> set[int]:
    """Numbers of so many episodes whose commands, readings and rates the rest span.

    A fit that never saw the fastest motion has to extrapolate in one that did. Of
    the episodes that the rest span about equally well, those that reach furthest are
    held out: they ask most of a fit. The first one is not: it may be all that shows the
    robot as it was before it changed.
    """
    reach = [_measure_ranges(e) for e in episodes]
    columns = sorted(set().union(*reach))
    lost = (np.nan, np.nan)
    edges = np.array([[r.get(c, lost) for r in reach] for c in columns])
    edges = edges.reshape(len(columns), len(episodes), 2)
    whole = np.nanmax(edges, axis=(1, 2)) - np.nanmin(edges, axis=(1, 2))
    edges = edges[whole > 0] / whole[whole > 0, None, None]
    low, high = edges[..., 0], edges[..., 1]
    left = list(range(len(episodes)))

    def key(i: int) -> tuple[float, float, bool, int]:
        rest = [j for j in left if j != i]
        lowest = np.fmin.reduce(low[:, rest], axis=1)
        highest = np.fmax.reduce(high[:, rest], axis=1)
        beyond = np.nan_to_num(np.fmax(high[:, i] - highest, lowest - low[:, i]))
        width = np.nansum(high[:, i] - low[:, i])
        beyond = round(float(np.max(beyond, initial=0.0)), 1)
        return beyond, -round(float(width), 1), i % 3 < 2, i  # else each third one

    for _ in range(count):
        left.remove(min(left[1:], key=key))
    return set(range(len(episodes))) - set(left)


def _measure_ranges(episode: Episode) -> dict[tuple[str, int], tuple[float, float]]:
    """Low and high of each column of commands and signals, and of their rates."""
    names = episode.ctrl_names
    columns = {f"ctrl {n}": episode.ctrl[:, [m == n for m in names]] for n in names}
    columns |= {f"signal {name}": s.values for name, s in episode.signals.items()}
    found = {}
    for name, values in columns.items():
        for i, x in enumerate(values.reshape(episode.time.size, -1).T):
            read = np.isfinite(x)
            if read.any():
                found[name, i] = tuple(np.quantile(x[read], EDGES))
            if read.sum() > 2:
                rate = np.gradient(x[read], episode.time[read])
                found[f"rate of {name}", i] = tuple(np.quantile(rate, EDGES))
    return found


def _parse_windows(recording: Recording, held_out: Sequence[str]) -> _Windows:
    windows: _Windows = {}
    for entry in held_out:
        name, window = _parse_entry(entry, recording)
        windows.setdefault(name, []).append(window)
    return windows


def _parse_entry(
    entry: str, recording: Recording
) -> tuple[str, tuple[float, float] | None]:
    """The episode that an entry names, and its window if it names one."""
    name = strip_file(entry, recording.file)
    if name in recording.episodes:
        return name, None
    piece = _SEGMENT.fullmatch(name)
    if piece is None or piece["id"] not in recording.episodes:
        raise UnknownNameError(f"episode of {recording.file}", name, recording.episodes)
    place = Location(recording.file, piece["id"])
    return piece["id"], _parse_window(
        piece, recording.episodes[piece["id"]].time, place
    )


def _parse_window(
    piece: re.Match[str], time: Floats, place: Location
) -> tuple[float, float]:
    try:
        start, end = float(piece["start"]), float(piece["end"])
    except ValueError:
        raise place.make_error(
            f"held-out piece {piece[0]!r}; would fit: id[t0,t1] with two times in s"
        ) from None
    if not ((time >= start) & (time <= end)).any():
        raise place.make_error(
            f"held-out piece {piece[0]!r} has no sample; the episode lasts from "
            f"{time[0]} to {time[-1]} s"
        )
    return start, end


def _split_episode(
    name: str,
    episode: Episode,
    windows: Sequence[tuple[float, float] | None],
    fit: dict[str, Episode],
    held: dict[str, Episode],
) -> None:
    """Sort the pieces of one episode into `fit` and `held`."""
    if None in windows:
        held[name] = episode
        return
    time = episode.time
    gap = GAP * (time[-1] - time[0])
    seen = np.ones(time.size, bool)
    for start, end in filter(None, windows):
        held.update([_cut_segment(name, episode, (time >= start) & (time <= end))])
        seen &= (time < start - gap) | (time > end + gap)
    fit.update(_cut_segment(name, episode, run) for run in _find_runs(seen))


def _find_runs(mask: NDArray[np.bool_]) -> Iterator[NDArray[np.bool_]]:
    """Each unbroken stretch of True, as a mask of its own."""
    label = np.cumsum(np.diff(mask, prepend=False) != 0)
    for run in np.unique(label[mask]):
        yield mask & (label == run)


def _cut_segment(
    name: str, episode: Episode, rows: NDArray[np.bool_]
) -> tuple[str, Episode]:
    """The samples `rows` (T) of an episode, under the name that says where they are."""
    if rows.all():
        return name, episode
    time = episode.time[rows]
    signals = {
        key: replace(signal, values=signal.values[rows])
        for key, signal in episode.signals.items()
    }
    piece = replace(episode, time=time, ctrl=episode.ctrl[rows], signals=signals)
    if not rows[0]:
        piece = replace(piece, qpos0=None, qvel0=None)
    return f"{name}[{float(time[0])!r},{float(time[-1])!r}]", piece
