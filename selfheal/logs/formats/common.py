"""What readers of formats share: takes names, cells and errors as files have them."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from types import ModuleType

import numpy as np

from ... import extras
from ...documents import shorten_value
from ...errors import InputError
from ...printable import make_printable
from ..base import Floats, Log, Values

MAX_COLUMNS = 10_000  # of a stream; chosen: ten times those of a humanoid's whole state
# elements of a vector that become columns each; chosen: above any state of a robot,
# below any picture
MAX_ELEMENTS = 1_000
_MAX_LINE = 200  # characters of a library's message that are shown; chosen
CUT_LINE = "the last line is cut off"
PIECE_VALUES = 1_000_000  # of a piece of a stream; chosen: 8 MB as float64


def import_extra(module: str, what: str) -> ModuleType:
    """A module of a library that only the extra `logs` installs.

    Args:
        what: is read with it, for the message.

    Raises:
        InputError: it is not installed.
    """
    return extras.import_extra(module, "logs", f"reading {what}")


@contextmanager
def explain_damage(path: Path, what: str) -> Iterator[None]:
    """Make an `InputError` of whatever a library raises of a file.

    The libraries were written for files that are in order: of others they raise
    anything, an AssertionError or a struct.error even.

    Raises:
        InputError: in place of any other exception; it names the file.
    """
    try:
        yield
    except InputError as error:
        if str(path) in str(error):
            raise
        raise InputError(f"{path}: {error}") from error
    except MemoryError as error:
        raise InputError(f"{path}: it states sizes that are too large") from error
    except Exception as error:
        raise InputError(f"{path}: a damaged {what}: {clean_text(error)}") from error


def clean_text(said: object) -> str:
    """The first line of what a library says, short and printable."""
    text = str(said).strip() or type(said).__name__
    return make_printable(text.splitlines()[0], most=_MAX_LINE)


def read_start(path: Path, size: int = 16) -> bytes:
    """The first bytes of a file; none where there is no file that can be read."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as file:
            return file.read(size)
    except OSError:
        return b""


def get_size(path: Path) -> int:
    """Size of a file [B], at least 1 so that it can be divided by."""
    return max(1, os.stat(path).st_size)


def order_naturally(name: str) -> list[tuple[int, str]]:
    """A key to sort names by, which puts "demo_2" before "demo_10"."""
    parts = re.split(r"(\d+)", name)
    return [(int(p) if p.isdecimal() and len(p) < 20 else -1, p) for p in parts]


def make_unique(names: Iterable[str]) -> list[str]:
    """Names, of which one that stood before gets a number, as in "q_2"."""
    found, counts = dict[str, None](), Counter[str]()
    for name in names:
        counts[name] += 1
        new = name if counts[name] == 1 else f"{name}_{counts[name]}"
        while new in found:
            counts[name] += 1
            new = f"{name}_{counts[name]}"
        found[new] = None
    return list(found)


def name_elements(
    name: str, shape: Sequence[int], names: Sequence[str] | None = None
) -> list[str]:
    """Names of the columns that an array becomes: `name[0]`, or `name[knee]`.

    Args:
        shape: of one row of it; () of a number, which keeps the name.
        names: of the elements of a vector where the log states as many.
    """
    if names is not None and list(shape) == [len(names)]:
        return [f"{name}[{n}]" for n in names]
    places = product(*(range(n) for n in shape))
    return [name + "".join(f"[{k}]" for k in place) for place in places]


def check_wanted(log: Log, wanted: Mapping[str, Sequence[str]]) -> None:
    """Refuse names of streams and columns that a log does not have.

    Raises:
        InputError: names the first.
    """
    streams = {stream.name: stream for stream in log.streams}
    for name, columns in wanted.items():
        if name not in streams:
            raise InputError(f"{log.path}: it has no stream {shorten_value(name)}")
        for column in columns:
            if column not in streams[name].columns:
                raise InputError(
                    f"{log.path}: it has no column {shorten_value(column)}"
                )


def convert_cells(cells: Sequence[object]) -> Values:
    """Cells of a column (n) as numbers; as texts, where one of them is a text."""
    if any(isinstance(cell, str) for cell in cells):
        texts = np.empty(len(cells), dtype=object)
        texts[:] = ["" if cell is None else str(cell) for cell in cells]
        return texts
    try:
        return np.array(cells, dtype=float).reshape(len(cells))
    except (TypeError, ValueError, OverflowError):
        return np.array([convert_number(cell) for cell in cells], dtype=float)


def convert_number(cell: object) -> float:
    """A cell as a number; NaN where it is none."""
    try:
        return float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        return np.nan


def pad_rows(rows: Sequence[Sequence[object]]) -> Floats:
    """Rows (n) of numbers as (n, d), NaN where one has fewer than the longest."""
    found = np.full((len(rows), max(map(len, rows), default=0)), np.nan)
    for padded, row in zip(found, rows, strict=True):
        padded[: len(row)] = [convert_number(cell) for cell in row]
    return found
