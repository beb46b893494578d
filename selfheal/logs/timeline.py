"""Rows of streams in time: clocks in; episodes with one time base out."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from .base import Floats
from .log_map import Clock, EpisodeRule, TimeBase

Indices = NDArray[np.integer]
# [s]; times that differ by less are one: what float64 resolves of seconds since 1970
TIME_RESOLUTION = 5e-7
_MOST_LATE = 8  # rows that a network may bring too late one after another; chosen


@dataclass(frozen=True)
class StreamTime:
    """When the rows of a stream were measured.

    Attributes:
        time: (n) [s] in the order of the log.
        label: (n) number of the episode that the log states for each row; None where
            it states none.
    """

    time: Floats
    label: Indices | None = None


@dataclass(frozen=True)
class Span:
    """Rows of one episode.

    Attributes:
        label: number that the log states; -1 where it states none.
        rows: (n) of each stream, in the order of time, by the stream's name.
    """

    label: int
    rows: Mapping[str, Indices]


@dataclass
class RowCounts:
    """Rows that were not taken as the log has them.

    Attributes:
        sorted: rows that stood behind a later one and were sorted in.
        dropped: rows without a time or with one that another row has.
        before_command: rows left out before the first command of their episode.
    """

    sorted: int = 0
    dropped: int = 0
    before_command: int = 0


def read_clock(clock: Clock, column: Floats | None, rows: int, factor: float) -> Floats:
    """Times of a stream's rows, (N) [s].

    Args:
        column: (N) of the time, None to count rows.
        factor: [s] of a unit of the column, or from row to row.
    """
    time = np.arange(rows, dtype=float) if column is None else column
    return clock.stretch * factor * time + clock.offset


def read_labels(values: Floats) -> Indices:
    """Numbers of episodes, (n): a row without one belongs to the episode before it.

    Args:
        values: (n) of the column of labels; NaN of rows without one.

    Raises:
        InputError: one is no whole number.
    """
    known = ~np.isnan(values)
    wrong = known & ((values != np.rint(values)) | (np.abs(values) > 2**53))
    if wrong.any():
        raise InputError(
            f"tells episodes apart and holds {values[wrong][0]:g}; would fit: whole "
            "numbers, or texts"
        )
    if not known.any():
        return np.zeros(values.size, dtype=np.intp)
    last = np.maximum.accumulate(np.where(known, np.arange(values.size), 0))
    return values[np.maximum(last, known.argmax())].astype(np.intp)


def split_episodes(
    streams: Mapping[str, StreamTime], rule: EpisodeRule, counts: RowCounts
) -> list[Span]:
    """Part streams into episodes.

    An episode ends where the label changes and where the marking stream has a row. It
    ends where no stream has a row for longer than the gap, too, and where the time of a
    lone stream begins again.

    Args:
        counts: to which the rows are added that are not taken as they are.

    Returns:
        Episodes in the order of time, or of the log where its time begins again.

    Raises:
        InputError: the time of one of several streams begins again.
    """
    if len(streams) == 1:
        ((name, stream),) = streams.items()
        spans = [
            Span(label, {name: _sort_rows(stream.time, rows, counts)})
            for label, rows in split_rows(stream)
        ]
    else:
        spans = _split_streams(streams, counts)
    marks = streams[rule.stream].time if rule.stream is not None else np.empty(0)
    found = [
        part
        for span in spans
        for part in _cut_span(span, streams, rule.gap or np.inf, np.sort(marks))
    ]
    return [span for span in found if any(map(len, span.rows.values()))]


def split_rows(stream: StreamTime) -> Iterator[tuple[int, Indices]]:
    """Rows (n) of a stream between changes of its label, or where time begins again."""
    count = stream.time.size
    new = np.zeros(count, dtype=bool)
    if stream.label is not None:
        new[1:] = np.diff(stream.label) != 0
    else:
        # some rows on it is still before the last one: a new run, no row that was late
        for row in np.flatnonzero(stream.time[1:] < stream.time[:-1]) + 1:
            ahead = stream.time[min(int(row) + _MOST_LATE, count - 1)]
            new[row] = ahead < stream.time[row - 1]
    cuts = [0, *np.flatnonzero(new), count]
    for start, end in pairwise(cuts):
        if start < end:
            label = -1 if stream.label is None else int(stream.label[start])
            yield label, _count_rows(start, end)


def _split_streams(streams: Mapping[str, StreamTime], counts: RowCounts) -> list[Span]:
    """Episodes of several streams, which share a time that never begins again."""
    for name, stream in streams.items():
        if stream.label is None and len(list(split_rows(stream))) > 1:
            raise _make_time_error(name)
    every = {
        name: _sort_rows(stream.time, _count_rows(0, stream.time.size), counts)
        for name, stream in streams.items()
    }
    labeled = next((n for n, s in streams.items() if s.label is not None), None)
    if labeled is None:
        return [Span(-1, every)]
    owner = streams[labeled]
    parts = list(split_rows(owner))
    starts = np.array([owner.time[rows[0]] for _, rows in parts])
    if (np.diff(starts) <= 0).any():
        raise _make_time_error(labeled)
    where = {
        name: np.searchsorted(starts, streams[name].time[rows], side="right") - 1
        for name, rows in every.items()
    }
    return [
        Span(label, {n: rows[where[n] == k] for n, rows in every.items()})
        for k, (label, _) in enumerate(parts)
    ]


def _make_time_error(name: str) -> InputError:
    return InputError(
        f"the time of {name} begins again, and the log holds several streams; would "
        "fit: [time] with a column that does not, or a file a run"
    )


def _count_rows(start: int, end: int) -> Indices:
    """Numbers of rows, (n), in as few bytes as hold them."""
    return np.arange(start, end, dtype=np.int32 if end < 2**31 else np.int64)


def shorten_rows(rows: Indices) -> Indices | slice:
    """Rows (n), as a slice where they are all of a range: it takes no copy."""
    if rows.size and rows[-1] - rows[0] == rows.size - 1 and (np.diff(rows) == 1).all():
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows


def take_rows(values: Floats, rows: Indices) -> Floats:
    """Rows (n) of values (N); where they are all of a range, no copy of it."""
    return values[shorten_rows(rows)]


def _sort_rows(time: Floats, rows: Indices, counts: RowCounts) -> Indices:
    """Rows by time, each time once, those without a time left out."""
    values = take_rows(time, rows)
    if (np.diff(values) > TIME_RESOLUTION).all() and np.isfinite(values[-1:]).all():
        return rows  # as nearly always
    valid = rows[np.isfinite(values)]
    values = time[valid]
    if (np.diff(values) < 0).any():
        late = values < np.maximum.accumulate(values)
        counts.sorted += int(late.sum())
        valid = valid[np.argsort(values, kind="stable")]
        values = time[valid]
    new = np.ones(valid.size, dtype=bool)
    new[1:] = np.diff(values) > TIME_RESOLUTION
    counts.dropped += int(rows.size - new.sum())
    return valid[new]


def _cut_span(
    span: Span, streams: Mapping[str, StreamTime], gap: float, marks: Floats
) -> Iterator[Span]:
    """Parts of an episode between gaps and marks."""
    if gap == np.inf and not marks.size:
        yield span
        return
    times = {name: streams[name].time[rows] for name, rows in span.rows.items()}
    every = np.sort(np.concatenate(list(times.values())))
    cuts = every[1:][np.diff(every) > gap]
    inner = marks[(marks > every[0]) & (marks <= every[-1])] if every.size else marks
    cuts = np.unique(np.concatenate([cuts, inner]))
    if not cuts.size:
        yield span
        return
    parts = {
        name: np.split(span.rows[name], np.searchsorted(time, cuts))
        for name, time in times.items()
    }
    for k in range(cuts.size + 1):
        yield replace(span, rows={name: rows[k] for name, rows in parts.items()})


def merge_times(times: Sequence[Floats]) -> Floats:
    """The time base of an episode: every time of any stream once, (T) [s]."""
    if len(times) == 1:  # a stream's own rows are apart already
        return times[0]
    every = np.unique(np.concatenate([np.empty(0), *times]))
    new = np.ones(every.size, dtype=bool)
    new[1:] = np.diff(every) > TIME_RESOLUTION
    return every[new]


def clip_times(base: TimeBase, time: Floats) -> Floats:
    """The part of a time base (T) [s] that a map takes."""
    if not time.size or (base.start is None and base.end is None):
        return time
    start = -np.inf if base.start is None else time[0] + base.start
    end = np.inf if base.end is None else time[0] + base.end
    return time[(time >= start) & (time <= end)]


class FoundRows(NamedTuple):
    """Rows of a stream at times of a block of a time base.

    Attributes:
        first, end: of the stream's rows around them, the end behind the last one.
        chosen: (M) which of those they are.
        place: (M) their rows in the block.
    """

    first: int
    end: int
    chosen: Indices | slice
    place: Indices | slice


def find_in_block(rows: Indices, clock: Floats, time: Floats) -> FoundRows:
    """Rows of a stream at times of a block of a time base.

    Args:
        rows: (n) of an episode.
        clock: (n) [s] their times; one that the block does not have is left out.
        time: (T) [s] of the block.
    """
    low, high = np.searchsorted(clock, (time[0] - 1e-6, time[-1] + 1e-6))
    place = np.searchsorted(time, clock[low:high] - TIME_RESOLUTION)
    nearest = time[np.minimum(place, time.size - 1)]
    near = np.abs(nearest - clock[low:high]) <= TIME_RESOLUTION
    found = rows[low:high][near]
    first, end = (int(found.min()), int(found.max()) + 1) if found.size else (0, 0)
    return FoundRows(first, end, shorten_rows(found - first), shorten_rows(place[near]))
