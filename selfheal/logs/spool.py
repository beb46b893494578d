"""Columns of a log on the disk: rows in as they are read; single columns out."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..files import make_write_error
from .base import Rows, Values

Floats = NDArray[np.float64]


class Spool:
    """Columns in a file that has no name: it is gone when the process ends.

    A log is read once, row by row, and used column by column; it may be larger than
    the memory.

    Attributes:
        rows: how many of each stream.
    """

    def __init__(self, folder: Path) -> None:
        """Open the file.

        Args:
            folder: on whose disk it is.

        Raises:
            InputError: nothing can be written there.
        """
        self.rows: dict[str, int] = {}
        self._pieces: dict[tuple[str, str], list[tuple[int, int]]] = {}
        self._labels: dict[tuple[str, str], dict[str, int]] = {}
        self._folder = folder
        try:
            self._file: Any = tempfile.TemporaryFile(dir=folder)
        except OSError as error:
            raise make_write_error(f"into {folder}", error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def append(self, stream: str, rows: Rows) -> None:
        """Take some rows of a stream.

        Raises:
            SelfhealError: the disk is full.
        """
        count = 0
        for name, values in rows.items():
            count = len(values)
            key = stream, name
            numbers = np.ascontiguousarray(self._encode(key, values))
            try:
                start = self._file.seek(0, 2)
                self._file.write(numbers.data)
                self._file.flush()
            except OSError as error:
                raise make_write_error(f"into {self._folder}", error) from error
            self._pieces.setdefault(key, []).append((start, count))
        self.rows[stream] = self.rows.get(stream, 0) + count

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
            stream: that it is in.
            column: its name.
            start: first row.
            end: row behind the last one; -1: all that there are.
        """
        end = self.rows.get(stream, 0) if end < 0 else end
        parts, row = [np.empty(0)], 0
        for place, count in self._pieces.get((stream, column), ()):
            low, high = max(start - row, 0), min(end - row, count)
            if low < high:
                self._file.seek(place + 8 * low)
                content = self._file.read(8 * (high - low))
                parts.append(np.frombuffer(content, dtype=np.float64))
            row += count
        return np.concatenate(parts)

    def get_labels(self, stream: str, column: str) -> Mapping[int, str]:
        """Texts of a column by the numbers that stand for them; none: of numbers."""
        known = self._labels.get((stream, column), {})
        return {number: text for text, number in known.items()}
