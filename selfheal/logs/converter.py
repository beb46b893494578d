"""Conversion of a log: takes columns from the disk, gives episodes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..files import MAX_VALUES
from ..recording import Episode, Signal
from .base import Floats, Log, Stream
from .guessing.clocks import check_time_unit
from .import_report import EpisodeReport, ImportReport
from .log_map import COMMAND, Clock, LogMap
from .resolve import Channel, name_signals
from .spool import Spool
from .timeline import (
    TIME_RESOLUTION,
    FoundRows,
    Span,
    StreamTime,
    clip_times,
    find_in_block,
    merge_times,
    read_clock,
    read_labels,
    split_episodes,
    take_rows,
)
from .units import get_unit

_BLOCK = 200_000  # rows that are converted at once; chosen: some 10 MB of a robot
_RATE_ROWS = 100_000  # of which a stream's rate is the median; chosen: the first ones
Clocks = Mapping[tuple[str, float], Floats]  # by stream and delay [s]
Report = Callable[
    [str, float], None
]  # called with a file and the share of it that was read


class _Source(NamedTuple):
    """A stream, its clock, and the columns of its time and its labels ("" if none)."""

    stream: Stream
    clock: Clock
    time: str
    label: str

    @property
    def name(self) -> str:
        """Of the stream."""
        return self.stream.name


@dataclass
class Converter:
    """Converts one log into episodes.

    Attributes:
        channels: that are taken; commands in the order of the model's actuators.
        prefix: of the ids of its episodes.
        read: numbers of the channels in which there was a number.
    """

    log: Log
    log_map: LogMap
    channels: Sequence[Channel]
    spool: Spool
    prefix: str
    used: set[str] = field(default_factory=set)
    remarks: list[str] = field(default_factory=list)
    read: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        """Look which streams are needed, and when their rows were measured."""
        used = {channel.stream for channel in self.channels if channel.columns}
        marks = self.log_map.episodes.stream
        self._streams = [
            _Source(stream, *self._find_clock(stream), self._find_label(stream))
            for stream in self.log.streams
            if stream.name in used or stream.name == marks
        ]

    def read_log(self, report: Report | None) -> None:
        """Bring all columns that are needed to the disk."""
        wanted = {source.name: {source.time, source.label} for source in self._streams}
        for channel in self.channels:
            if channel.columns:
                wanted[channel.stream] |= {*channel.columns}
        columns = {name: sorted(some - {""}) for name, some in wanted.items()}
        name = self.log.path.name
        progress = None if report is None else partial(report, name)
        for stream_name, rows in self.log.read(columns, progress):
            self.spool.append(stream_name, rows)
        for channel in self.channels:
            for column in channel.columns:
                text = self.spool.find_text(channel.stream, column)
                if text is not None:
                    raise InputError(
                        f"{name}: column {column!r} holds the text {text!r}; would "
                        "fit: numbers, and an empty cell where one is missing"
                    )

    def convert(self, made: ImportReport) -> Iterator[tuple[str, Iterator[Episode]]]:
        """The episodes, each in parts, by id."""
        streams = {source.name: self._read_time(source) for source in self._streams}
        spans = split_episodes(streams, self.log_map.episodes, made)
        for number, span in enumerate(spans):
            times = {n: take_rows(streams[n].time, r) for n, r in span.rows.items()}
            clocks = {
                (c.stream, c.delay): times[c.stream] - c.delay
                for c in self.channels
                if c.columns
            }
            base = clip_times(self.log_map.time, merge_times(list(clocks.values())))
            if not base.size:
                continue
            start, held = self._find_first_commands(span, clocks, base)
            first = int(np.searchsorted(base, start))
            made.before_command += first
            base = base[first:]
            self._check_size(base)
            name = self._name_episode(number, span)
            rates = {
                n: 1 / float(np.median(np.diff(time[:_RATE_ROWS])))
                for n, time in times.items()
                if time.size > 1
            }
            seconds = float(base[-1] - base[0])
            made.episodes.append(
                EpisodeReport(name, float(base[0]), seconds, base.size, rates)
            )
            yield name, self._convert_span(span, clocks, base, held)

    def _find_clock(self, stream: Stream) -> tuple[Clock, str]:
        """The clock of a stream and the column of its time, "" if it has none."""
        base = self.log_map.time
        clock = base.streams.get(stream.name, base)
        column = clock.column.removeprefix(f"{stream.name}:")
        if clock.rate is not None:
            return clock, ""
        if column and column not in stream.columns:
            raise InputError(
                f"{self.log.path}: stream {stream.name!r} has no column {column!r} for "
                f"the time; would fit: {', '.join(stream.columns)}"
            )
        if not column and not stream.time and stream.period is None:
            raise InputError(
                f"{self.log.path}: the map states no time, and the log has none; would "
                'fit: [time] column = "..." or rate = ... in Hz'
            )
        return clock, column or stream.time

    def _find_label(self, stream: Stream) -> str:
        """The column of the labels of a stream's episodes; "" if it has none."""
        rule = self.log_map.episodes
        column = rule.column.removeprefix(f"{stream.name}:")
        if column:
            return column if column in stream.columns else ""
        return stream.episode if rule.gap is None and rule.stream is None else ""

    def _read_time(self, source: _Source) -> StreamTime:
        """When the rows of a stream were measured."""
        clock, column = source.clock, source.time
        factor = source.stream.period or 0.0
        if clock.rate is not None:
            factor = 1 / clock.rate
        elif column:
            factor = get_unit((clock.column and clock.unit) or "s").factor
        values = self.spool.read(source.name, column) if column else None
        if values is not None and clock.column:
            what = f"{self.log.path}: column {column!r}"
            if doubt := check_time_unit(clock, what, values):
                self.remarks.append(doubt)
        time = read_clock(clock, values, self.spool.rows.get(source.name, 0), factor)
        if not source.label:
            return StreamTime(time)
        labels = self.spool.read(source.name, source.label)
        try:
            return StreamTime(time, read_labels(labels))
        except InputError as error:
            where = f"{self.log.path}: column {source.label!r}"
            raise InputError(f"{where} {error}") from error

    def _find_first_commands(
        self, span: Span, clocks: Clocks, base: Floats
    ) -> tuple[float, Floats]:
        """Since when every command is known.

        Args:
            clocks: (n) [s] by stream and delay.
            base: (T) [s] time base.

        Returns:
            [s] that time, not before the base begins, and (nu) the commands then.
        """
        commands = [c for c in self.channels if c.kind == COMMAND]
        start = float(base[0])
        for channel in commands:
            if channel.columns:
                time, _ = self._read_command(channel, span, clocks)
                start = max(start, float(time[0]))
        held = np.array([c.offset[0] for c in commands])
        for k, channel in enumerate(commands):
            if channel.columns:
                time, values = self._read_command(channel, span, clocks)
                last = np.searchsorted(time, start + TIME_RESOLUTION, side="right") - 1
                held[k] = channel.convert(values[[last]])[0]
        return start, held

    def _read_command(
        self, channel: Channel, span: Span, clocks: Clocks
    ) -> tuple[Floats, Floats]:
        """Times (n) [s] and numbers (n) of a command's column in an episode."""
        rows = span.rows[channel.stream]
        values = np.empty(0)
        if rows.size:
            first, end = int(rows.min()), int(rows.max()) + 1
            piece = self.spool.read(channel.stream, channel.columns[0], first, end)
            values = take_rows(piece, rows - first)
        known = np.isfinite(values)
        if not known.any():
            raise InputError(
                f"{self.log.path}: an episode has no command of {channel.target}: "
                f"no number in column {channel.columns[0]!r}"
            )
        return clocks[channel.stream, channel.delay][known], values[known]

    def _check_size(self, base: Floats) -> None:
        """Refuse what no recording can hold."""
        count = base.size * (1 + sum(max(1, len(c.columns)) for c in self.channels))
        if count > MAX_VALUES:
            raise InputError(
                f"{self.log.path}: an episode of {count} values; a recording holds at "
                f"most {MAX_VALUES}: take fewer columns, or a part by [time] start and "
                "end"
            )

    def _name_episode(self, number: int, span: Span) -> str:
        """An id that no other episode has."""
        label = ""
        for source in self._streams:
            texts = self.spool.get_labels(source.name, source.label)
            label = texts.get(span.label, label)
        if not label:
            label = f"{number if span.label < 0 else span.label:03d}"
        label = self.prefix + label.replace("/", "_").replace("\0", "_")
        name, k = label, 1
        while name in self.used or name in ("", ".", ".."):
            k += 1
            name = f"{label}_{k}"
        self.used.add(name)
        return name

    def _convert_span(
        self, span: Span, clocks: Clocks, base: Floats, held: Floats
    ) -> Iterator[Episode]:
        """An episode in parts.

        Args:
            clocks: (n) [s] by stream and delay.
            base: (T) [s] time base.
            held: (nu) commands when it begins.
        """
        names = name_signals(self.channels)
        commands = [k for k, c in enumerate(self.channels) if c.kind == COMMAND]
        for start in range(0, base.size, _BLOCK):
            time = base[start : start + _BLOCK]
            found = {
                key: find_in_block(span.rows[key[0]], clock, time)
                for key, clock in clocks.items()
            }
            blocks = [self._read_block(c, found, time.size) for c in self.channels]
            self.read |= {k for k, b in enumerate(blocks) if np.isfinite(b).any()}
            if any(channel.missing is not None for channel in self.channels):
                kept = _find_read(self.channels, blocks)
                time, blocks = time[kept], [block[kept] for block in blocks]
            ctrl = np.empty((time.size, len(commands)))
            for column, k in enumerate(commands):
                ctrl[:, column] = blocks[k][:, 0]
            held = _hold(ctrl, held)
            signals = dict[str, Signal]()
            for k, name in names.items():
                channel, values = self.channels[k], blocks[k]
                values = values if len(channel.columns) > 1 else values[:, 0]
                about = channel.kind, channel.target, channel.unit
                signals[name] = Signal(values, *about)
            targets = tuple(self.channels[k].target for k in commands)
            yield Episode(time - base[0], ctrl, targets, signals)

    def _read_block(
        self,
        channel: Channel,
        found: Mapping[tuple[str, float], FoundRows],
        size: int,
    ) -> Floats:
        """Values (T, d) of a channel in a block; NaN where it has none."""
        values = np.full((size, max(1, len(channel.columns))), np.nan)
        if not channel.columns:
            values[:] = channel.offset
            return values
        rows = found[channel.stream, channel.delay]

        def read(column: str) -> Floats:
            piece = self.spool.read(channel.stream, column, rows.first, rows.end)
            return piece[rows.chosen]

        for k, column in enumerate(channel.columns):
            values[rows.place, k] = read(column)
        values[rows.place] = channel.convert(values[rows.place])
        if channel.missing is not None:
            absent = [read(column) == channel.missing for column in channel.beside]
            places = np.arange(size)[rows.place]
            values[places[np.all(absent, axis=0)]] = np.nan
        return values


def _find_read(
    channels: Sequence[Channel], blocks: Sequence[Floats]
) -> NDArray[np.bool_]:
    """Rows (T) in which something was read: blocks (T, d) of channels."""
    pairs = zip(channels, blocks, strict=True)
    read = [
        np.isfinite(block).any(axis=1) for channel, block in pairs if channel.columns
    ]
    return np.any(read, axis=0)


def _hold(ctrl: Floats, before: Floats) -> Floats:
    """Repeat each command (T, nu) until the next one, in place.

    Args:
        ctrl: NaN where there is no new one.
        before: (nu) the commands held before the first row.

    Returns:
        (nu) those of the last row.
    """
    rows = np.arange(len(ctrl))[:, None]
    last = np.maximum.accumulate(np.where(np.isnan(ctrl), -1, rows), axis=0)
    held = np.take_along_axis(ctrl, np.maximum(last, 0), axis=0)
    ctrl[:] = np.where(last < 0, before, held)
    return ctrl[-1].copy() if len(ctrl) else before
