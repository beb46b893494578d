"""Logs of tables: takes readers of numbers and vectors, gives streams of columns."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol

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
Blocks = Iterator[tuple[float, Mapping[str, Values]]]


class Array(Protocol):
    """What has the shape and the dtype of an array, and reads it when it is sliced."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(T, ...)."""

    @property
    def dtype(self) -> np.dtype:
        """Type of an element."""

    def __len__(self) -> int: ...

    def __getitem__(self, rows: slice, /) -> object: ...


@dataclass(frozen=True)
class Cell:
    """What a table has in every row: a number, a text or a vector.

    Attributes:
        width: elements of a vector; 0 of a number or a text.
        unit: "" where the log states none.
        names: of the elements of a vector, where the log states as many.
    """

    width: int = 0
    unit: str = ""
    names: Sequence[str] | None = None


@dataclass(frozen=True)
class Table:
    """What becomes a stream.

    Attributes:
        cells: by name; those of vectors are a column for each element.
        read: reads some cells: the share of the table that was read until then, and
            (n) or, of vectors, (n, d) of each cell.
        losses: what of the table is damaged, in words; known when all was read.
        name, rows, time, period, episode: as of a `Stream`; the time and the episode
            are cells.
    """

    cells: Mapping[str, Cell]
    read: Callable[[Collection[str]], Blocks]
    losses: list[str] = field(default_factory=list)
    name: str = ""
    rows: int | None = None
    time: str = ""
    period: float | None = None
    episode: str = ""


class TableLog(Log):
    """A log of tables, a stream each.

    Args:
        what: such a log in words, for messages.

    Raises:
        InputError: there is nothing to read, or there are too many columns.
    """

    def __init__(
        self,
        path: Path,
        tables: Sequence[Table],
        what: str = "log",
        robot: str | None = None,
    ) -> None:
        self.path, self.robot, self._what = path, robot, what
        self._tables = {table.name: table for table in tables}
        self._places = {table.name: _place_columns(table) for table in tables}
        self.streams = [_make_stream(t, self._places[t.name]) for t in tables]
        if not any(stream.columns for stream in self.streams):
            raise InputError(f"{path}: no columns, of one length each, that are a log")

    def read(
        self, wanted: Mapping[str, Sequence[str]], report: Report | None = None
    ) -> Iterator[tuple[str, Rows]]:
        """Read columns, one table after the other."""
        check_wanted(self, wanted)
        chosen = [name for name in self._tables if wanted.get(name)]
        with explain_damage(self.path, self._what):
            for number, name in enumerate(chosen):
                places = {column: self._places[name][column] for column in wanted[name]}
                cells = {cell: None for cell, _ in places.values()}
                for share, block in self._tables[name].read(cells):
                    yield name, {c: _pick(block[p[0]], p[1]) for c, p in places.items()}
                    if report:
                        report(min(1.0, (number + share) / len(chosen)))
        self.losses = [loss for table in self._tables.values() for loss in table.losses]


def _place_columns(table: Table) -> dict[str, tuple[str, int]]:
    """Cell and element of each column of a table, by the column's name."""
    places, names = list[tuple[str, int]](), list[str]()
    for name, cell in table.cells.items():
        places += [(name, element) for element in range(cell.width or 1)]
        names += name_elements(name, (cell.width,) if cell.width else (), cell.names)
    if len(names) > MAX_COLUMNS:
        raise InputError(f"more than {MAX_COLUMNS} columns")
    return dict(zip(make_unique(names), places, strict=True))


def _make_stream(table: Table, places: Mapping[str, tuple[str, int]]) -> Stream:
    """The stream of a table with such columns; its time is in seconds."""
    units = {name: table.cells[cell].unit for name, (cell, _) in places.items()}
    time = table.time if table.time in places else ""
    units |= {time: "s"} if time else {}
    return Stream(table.name, units, table.rows, time, table.period, table.episode)


def _pick(block: Values, element: int) -> Values:
    """An element (n) of numbers (n) or vectors (n, d); NaN where they lack it."""
    columns = block.reshape(len(block), -1)
    if element >= columns.shape[1]:
        return np.full(len(block), np.nan)
    return np.ascontiguousarray(columns[:, element])


@dataclass(frozen=True)
class Run:
    """Arrays (T) or (T, d) whose rows belong together.

    Attributes:
        label: of this run alone; "" if it has none.
    """

    arrays: Mapping[str, Array]
    label: str = ""

    def count(self) -> int:
        """T, how many rows there are."""
        return next((len(array) for array in self.arrays.values()), 0)


def make_table(
    runs: Sequence[Run], name: str = "", units: Mapping[str, str] | None = None
) -> Table:
    """The table of runs, which follow each other.

    Args:
        units: of arrays, as far as they are known.
    """
    widths = dict[str, int]()
    for run in runs:
        for cell, array in run.arrays.items():
            width = array.shape[1] if len(array.shape) > 1 else 0
            widths[cell] = max(width, widths.get(cell, 0))
    cells = {cell: Cell(w, (units or {}).get(cell, "")) for cell, w in widths.items()}
    episode = ""
    if len(runs) > 1 or any(run.label for run in runs):
        *_, episode = make_unique([*widths, "episode"])
        cells[episode] = Cell()
    read = partial(_read_runs, runs, episode)
    rows = sum(run.count() for run in runs)
    return Table(cells, read, name=name, rows=rows, episode=episode)


def _read_runs(runs: Sequence[Run], episode: str, cells: Collection[str]) -> Blocks:
    """Blocks of runs; the cell `episode` has the runs' labels."""
    labels = make_unique(run.label or str(number) for number, run in enumerate(runs))
    total, done = sum(run.count() for run in runs), 0
    for label, run in zip(labels, runs, strict=True):
        count = run.count()
        parts = {name: run.arrays[name] for name in cells if name in run.arrays}
        width = sum(int(np.prod(array.shape[1:])) for array in parts.values())
        step = min(_MAX_PIECE, max(1, PIECE_VALUES // max(1, width)))
        for start in range(0, count, step):
            stop = min(start + step, count)
            block = dict.fromkeys(cells, np.full(stop - start, np.nan))
            block |= {n: convert_block(array[start:stop]) for n, array in parts.items()}
            if episode in block:
                block[episode] = np.full(stop - start, label, dtype=object)
            done += stop - start
            yield done / total, block


def convert_block(rows: object) -> Values:
    """Rows of an array (n, ...) as numbers or texts."""
    block = np.asarray(rows)
    if block.dtype.kind == "M":
        seconds = block.astype("M8[ns]").astype(np.int64) / 1e9
        return np.where(np.isnat(block), np.nan, seconds)
    if block.dtype.kind in "SUO":
        cells = block.ravel().tolist()
        texts = [
            c.decode(errors="replace") if isinstance(c, bytes) else c for c in cells
        ]
        return convert_cells(texts).reshape(block.shape)
    return np.asarray(block, dtype=float)


def is_usable(array: Array) -> bool:
    """Whether an array (T, ...) is columns of a log."""
    shape = array.shape
    return (
        array.dtype.kind in _KINDS
        and len(shape) in (1, 2)
        and shape[0] > 0
        and (len(shape) == 1 or 0 < shape[1] <= MAX_ELEMENTS)
    )


def group_arrays(arrays: Mapping[str, Array]) -> list[Run]:
    """Arrays (T) or (T, d) of one length each, those with the most values first."""
    usable = {n: a for n, a in arrays.items() if is_usable(a) and len(a) > 1}
    numeric = [len(a) for a in usable.values() if a.dtype.kind in "biufM"]
    lengths = Counter[int]()
    for array in usable.values():
        if len(array) in numeric and len(array) >= _MIN_LENGTH * max(numeric):
            lengths[len(array)] += int(np.prod(array.shape))
    return [
        Run({name: array for name, array in usable.items() if len(array) == length})
        for length, _ in lengths.most_common()
    ]


def make_length_tables(
    arrays: Mapping[str, Array], units: Mapping[str, str] | None = None
) -> list[Table]:
    """A table for each length of arrays (T, ...), named after it if there are more."""
    runs = group_arrays(arrays)
    names = [f"{run.count()} rows" if len(runs) > 1 else "" for run in runs]
    return [
        make_table([run], name, units) for run, name in zip(runs, names, strict=True)
    ]
