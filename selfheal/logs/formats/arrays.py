"""Logs that are arrays: takes arrays of one length, gives a stream of their columns."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ..base import Log, Report, Rows, Stream, Values
from .common import (
    MAX_COLUMNS,
    MAX_ELEMENTS,
    PIECE_VALUES,
    check_wanted,
    convert_cells,
    explain_damage,
    make_unique,
    name_elements,
)

_KINDS = "biufMSUO"  # of numpy, that become numbers, times or texts
_MAX_PIECE = 65_536  # rows; chosen
# by which arrays of a log may be shorter than the longest ones, so that they are taken
# for measurements, not for settings; chosen: 20 Hz beside 1 kHz
_MIN_LENGTH = 1 / 50


@dataclass(frozen=True)
class Run:
    """Arrays whose rows belong together.

    Attributes:
        arrays: by name: (T) or (T, d), or what has their shape and dtype and reads them
            when it is sliced.
        label: that tells this run from others; "" if it has none.
    """

    arrays: Mapping[str, Any]
    label: str = ""

    def count(self) -> int:
        """T, how many rows there are."""
        return next((len(array) for array in self.arrays.values()), 0)


@dataclass(frozen=True)
class Table:
    """Runs of one stream.

    Attributes:
        runs: one or more.
        name: of the stream.
        units: of arrays by name, as far as they are known.
        time: name of the array of time [s]; "" if it is not known.
        period: [s] from row to row where the log states it.
        names: of the elements of arrays, by the arrays' names, where the log states
            them.
    """

    runs: Sequence[Run]
    name: str = ""
    units: Mapping[str, str] = field(default_factory=dict)
    time: str = ""
    period: float | None = None
    names: Mapping[str, Sequence[str]] = field(default_factory=dict)


class ArrayLog(Log):
    """A log of tables.

    Attributes:
        path: of the file.
        streams: one for each table.
        robot: name of the robot where the log states it.
    """

    def __init__(
        self, path: Path, tables: Sequence[Table], robot: str | None = None
    ) -> None:
        if not any(run.arrays for table in tables for run in table.runs):
            raise InputError(
                f"{path}: no arrays of numbers, of one length each, that are a log"
            )
        self.path, self.robot = path, robot
        self._tables = [_OpenTable(table) for table in tables]
        self.streams = [table.make_stream() for table in self._tables]

    def read(
        self, wanted: Mapping[str, Sequence[str]], report: Report | None = None
    ) -> Iterator[tuple[str, Rows]]:
        """Read columns, one run after the other."""
        check_wanted(self, wanted)
        tables = [t for t in self._tables if t.table.name in wanted]
        total, done = max(1, sum(table.rows for table in tables)), 0
        with explain_damage(self.path, "log"):
            for table in tables:
                columns = wanted[table.table.name]
                for count, rows in table.read(columns):
                    yield table.table.name, rows
                    done += count
                    if report:
                        report(done / total)


class _OpenTable:
    """A table and the places of its columns.

    Attributes:
        table: the table.
        rows: how many it has.
    """

    def __init__(self, table: Table) -> None:
        self.table = table
        self.rows = sum(run.count() for run in table.runs)
        widths = dict[str, int]()
        for run in table.runs:
            for name, array in run.arrays.items():
                width = array.shape[1] if len(array.shape) > 1 else 0
                widths[name] = max(width, widths.get(name, 0))
        self._labels = make_unique(
            run.label or str(number) for number, run in enumerate(table.runs)
        )
        places = list[tuple[str, int]]()
        names = list[str]()
        for name, width in widths.items():
            places += [(name, element) for element in range(width or 1)]
            names += name_elements(
                name, (width,) if width else (), table.names.get(name)
            )
        if len(names) > MAX_COLUMNS:
            raise InputError(f"more than {MAX_COLUMNS} columns")
        has_episodes = len(table.runs) > 1 or any(run.label for run in table.runs)
        names = make_unique([*names, *(["episode"] if has_episodes else [])])
        self._episode = names[-1] if has_episodes else ""
        self._places = dict(zip(names, places, strict=False))
        self._units = {n: table.units.get(p[0], "") for n, p in self._places.items()}

    def make_stream(self) -> Stream:
        """What there is to read."""
        columns = {**self._units, **({self._episode: ""} if self._episode else {})}
        return Stream(
            name=self.table.name,
            columns=columns,
            rows=self.rows,
            time=self.table.time,
            period=self.table.period,
            episode=self._episode,
        )

    def read(self, columns: Sequence[str]) -> Iterator[tuple[int, Rows]]:
        """Pieces of some columns, and how many rows they have."""
        if not columns:
            return
        places = {name: self._places[name] for name in columns if name in self._places}
        arrays = {name for name, _ in places.values()}
        for label, run in zip(self._labels, self.table.runs, strict=True):
            parts = {name: run.arrays[name] for name in arrays if name in run.arrays}
            width = sum(int(np.prod(a.shape[1:])) for a in parts.values())
            step = min(_MAX_PIECE, max(1, PIECE_VALUES // max(1, width)))
            for start in range(0, run.count(), step):
                stop = min(start + step, run.count())
                blocks = {n: convert_block(a[start:stop]) for n, a in parts.items()}
                rows = {
                    name: np.full(stop - start, label, dtype=object)
                    if name == self._episode
                    else _pick(blocks, *places[name], stop - start)
                    for name in columns
                }
                yield stop - start, rows


def _pick(blocks: Mapping[str, Any], name: str, element: int, rows: int) -> Values:
    """A column of blocks; NaN where the run lacks it."""
    block = blocks.get(name)
    if block is None:
        return np.full(rows, np.nan)
    if block.ndim == 1:
        return block if element == 0 else np.full(rows, np.nan)
    return (
        block[:, element].copy() if element < block.shape[1] else np.full(rows, np.nan)
    )


def convert_block(block: Any) -> Values:
    """Rows of an array (n, ...) as numbers or texts."""
    block = np.asarray(block)
    if block.dtype.kind == "M":
        missing = np.isnat(block)
        seconds = block.astype("M8[ns]").astype(np.int64) / 1e9
        return np.where(missing, np.nan, seconds)
    if block.dtype.kind in "SUO":
        texts = [c.decode(errors="replace") if isinstance(c, bytes) else c
                 for c in block.ravel().tolist()]  # fmt: skip
        return convert_cells(texts).reshape(block.shape)
    return np.asarray(block, dtype=float)


def is_usable(array: Any) -> bool:
    """Whether something with a shape and a dtype is columns of a log."""
    shape = array.shape
    return (
        array.dtype.kind in _KINDS
        and len(shape) in (1, 2)
        and shape[0] > 0
        and (len(shape) == 1 or 0 < shape[1] <= MAX_ELEMENTS)
    )


def group_arrays(arrays: Mapping[str, Any]) -> list[Table]:
    """Tables of arrays by their lengths, the one with the most values first."""
    usable = {n: array for n, array in arrays.items() if is_usable(array)}
    usable = {n: array for n, array in usable.items() if len(array) > 1}
    numeric = [len(a) for a in usable.values() if a.dtype.kind in "biufM"]
    lengths = Counter[int]()
    for array in usable.values():
        if len(array) in numeric and len(array) >= _MIN_LENGTH * max(numeric):
            lengths[len(array)] += int(np.prod(array.shape))
    tables = list[Table]()
    for length, _ in lengths.most_common():
        group = {name: array for name, array in usable.items() if len(array) == length}
        name = f"{length} rows" if len(lengths) > 1 else ""
        tables.append(Table([Run(group)], name))
    return tables
