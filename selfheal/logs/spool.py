"""Columns of a log on the disk: rows in as they are read; single columns out."""

import io
import tempfile
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..files import make_write_error
from .base import Floats, Rows, Values
from .formats.common import convert_number


class _Piece(NamedTuple):
    """Rows of a column that follow each other in the file.

    Attributes:
        first: of the rows.
        place: in the file [B].
    """

    first: int
    rows: int
    place: int


@contextmanager
def open_spool(folder: Path) -> "Iterator[Spool]":
    """A spool in a file that has no name: it is gone when the process ends.

    Raises:
        InputError: nothing can be written there.
    """
    with ExitStack() as stack:
        try:
            file = stack.enter_context(tempfile.TemporaryFile(dir=folder, buffering=0))
        except OSError as error:
            raise make_write_error(f"into {folder}", error) from error
        yield Spool(file, folder)


class Spool:
    """Columns of a log in a file; see `open_spool`.

    A log is read once, row by row, and used column by column; it may be larger than
    the memory.
    """

    def __init__(self, file: io.FileIO, folder: Path) -> None:
        self.rows: dict[str, int] = {}
        self._pieces: dict[tuple[str, str], list[_Piece]] = {}
        self._labels: dict[tuple[str, str], dict[str, int]] = {}
        self._folder, self._file = folder, file

    def append(self, stream: str, rows: Rows) -> None:
        """Take some rows of a stream.

        Raises:
            SelfhealError: the disk is full.
        """
        count, first = 0, self.rows.get(stream, 0)
        for name, values in rows.items():
            count = len(values)
            key = stream, name
            numbers = np.ascontiguousarray(self._encode(key, values))
            try:
                place = self._file.seek(0, 2)
                left = numbers.data.cast("B") if count else b""
                while left:
                    left = left[self._file.write(left) :]
            except OSError as error:
                raise make_write_error(f"into {self._folder}", error) from error
            self._pieces.setdefault(key, []).append(_Piece(first, count, place))
        self.rows[stream] = first + count

    def _encode(self, key: tuple[str, str], values: Values) -> Floats:
        """Values as numbers: texts by their number in order of appearance."""
        if values.dtype.kind != "O":
            return values.astype(np.float64, copy=False)
        known = self._labels.setdefault(key, {})
        texts = (str(value) for value in values)
        return np.array([known.setdefault(text, len(known)) for text in texts], float)

    def read(self, stream: str, column: str, start: int = 0, end: int = -1) -> Floats:
        """Rows of a column, (n).

        Args:
            end: row behind the last one; -1: all that there are.
        """
        count = self.rows.get(stream, 0)
        end = count if end < 0 else min(end, count)
        pieces = self._pieces.get((stream, column), [])
        found, done = np.empty(max(end - start, 0)), 0
        k = max(bisect_right(pieces, start, key=lambda piece: piece.first) - 1, 0)
        while k < len(pieces) and done < found.size:
            skipped = start + done - pieces[k].first
            part = found[done:][: pieces[k].rows - skipped]
            self._file.seek(pieces[k].place + 8 * skipped)
            self._file.readinto(part.data.cast("B") if part.size else b"")
            done, k = done + part.size, k + 1
        return found[:done]

    def find_text(self, stream: str, column: str) -> str | None:
        """A text of a column, one that is no number if there is; None: of numbers."""
        texts = self._labels.get((stream, column), {})
        others = (t for t in texts if t and np.isnan(convert_number(t)))
        return next(others, next(iter(texts), None))

    def get_labels(self, stream: str, column: str) -> Mapping[int, str]:
        """Texts of a column by the numbers that stand for them; none: of numbers."""
        known = self._labels.get((stream, column), {})
        return {number: text for text, number in known.items()}
