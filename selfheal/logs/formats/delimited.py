"""Tables as text: takes CSV, TSV and their like, gives one stream."""

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ..base import Log, LogFormat, Report, Rows, Stream, Values
from .arrow import convert_array
from .common import (
    check_wanted,
    explain_damage,
    get_size,
    import_extra,
    name_elements,
    read_start,
)
from .dialect import COMMENTS, MISSING, Dialect, find_dialect, part_list

_SAMPLE = 262_144  # bytes that tell the dialect; chosen: a thousand rows, or nearly
_BLOCK = 1_000_000  # bytes that are parsed at once; chosen: a row has fewer
_GZIP = b"\x1f\x8b"
_SUFFIXES = (".csv", ".tsv", ".tab", ".txt", ".dat", ".asc", ".log")
_JSON = (".json", ".jsonl", ".ndjson")


class DelimitedFormat(LogFormat):
    """CSV, TSV and other tables as text, plain or as gzip packs them."""

    name = "CSV or TSV (also .gz)"
    extra = "logs"

    def recognizes(self, path: Path) -> bool:
        """Whether its name says so, or it is text that holds a table."""
        start = read_start(path)
        suffixes = path.suffixes[-2:] if start.startswith(_GZIP) else path.suffixes[-1:]
        is_json = any(suffix.lower() in _JSON for suffix in suffixes)
        if not start or start.lstrip()[:1] in (b"{", b"<") or is_json:
            return False
        if any(suffix.lower() in _SUFFIXES for suffix in suffixes):
            return True
        if start.lstrip()[:1] == b"[":
            return False
        try:
            found = _sniff(path)
        except (OSError, EOFError, ValueError):
            return False
        return found is not None and "number" in found.kinds

    def open(self, path: Path) -> Log:
        """Open a table."""
        with explain_damage(path, "table"):
            dialect = _sniff(path)
        if dialect is None:
            raise InputError(
                f"{path}: no table: its first lines are not rows of equally many "
                "cells that a comma, a semicolon, a tab or a blank separates"
            )
        return DelimitedLog(path, dialect)


def _sniff(path: Path) -> Dialect | None:
    """The dialect of a file by its first bytes."""
    import gzip

    packed = read_start(path).startswith(_GZIP)
    with gzip.open(path) if packed else path.open("rb") as file:
        sample = file.read(_SAMPLE)
        return find_dialect(sample, whole=not file.read(1)) if sample else None


def _read_cut_line(path: Path, encoding: str) -> str:
    """What follows the last end of a line; "" of a file that is packed."""
    if read_start(path).startswith(_GZIP):
        return ""
    with path.open("rb") as file:
        file.seek(-min(get_size(path), _SAMPLE), io.SEEK_END)
        end = file.read().decode(encoding, errors="ignore")
    return end.rpartition("\n")[2].strip()


class DelimitedLog(Log):
    """A table as text.

    Attributes:
        path: of the file.
        streams: one.
        dialect: how it is written.
    """

    def __init__(self, path: Path, dialect: Dialect) -> None:
        self.path, self.dialect = path, dialect
        self._cut = _read_cut_line(path, dialect.encoding)
        self._places = dict[str, tuple[int, int]]()  # cell and element of each column
        units = dict[str, str]()
        for cell, name in enumerate(dialect.names):
            shape = (dialect.widths[cell],) if dialect.widths[cell] else ()
            for element, column in enumerate(name_elements(name, shape)):
                self._places[column] = cell, element
                is_time = dialect.kinds[cell] == "time"
                units[column] = "s" if is_time else dialect.units[cell]
        times = [n for n, k in zip(dialect.names, dialect.kinds, strict=True)
                 if k == "time"]  # fmt: skip
        self.streams = [Stream("", units, time=times[0] if len(times) == 1 else "")]

    def read(
        self, wanted: Mapping[str, Sequence[str]], report: Report | None = None
    ) -> Iterator[tuple[str, Rows]]:
        """Read columns; a piece is a block of the file."""
        check_wanted(self, wanted)
        csv, pyarrow = (
            import_extra("pyarrow.csv", "CSV"),
            import_extra("pyarrow", "CSV"),
        )
        size, columns = get_size(self.path), wanted.get("", ())
        cells = sorted({self._places[column][0] for column in columns})
        if not cells:
            return
        with explain_damage(self.path, "table"), pyarrow.OSFile(str(self.path)) as raw:
            for batch in csv.open_csv(
                self._open_text(raw), **self._make_options(cells)
            ):
                by_cell = dict(zip(cells, batch.columns, strict=True))
                yield (
                    "",
                    {
                        column: self._convert(by_cell[cell], cell, element)
                        for column in columns
                        for cell, element in (self._places[column],)
                    },
                )
                if report:
                    report(min(1.0, raw.tell() / size))

    def _open_text(self, raw: Any) -> Any:
        """The text of an open file as pyarrow reads it."""
        import pyarrow as pa

        dialect, packed = self.dialect, read_start(self.path).startswith(_GZIP)
        text = pa.CompressedInputStream(raw, "gzip") if packed else raw
        blanks = dialect.delimiter == " "
        if dialect.encoding != "utf-16" and (blanks or dialect.has_comments):
            return io.BufferedReader(_Rows(text, blanks), _BLOCK)
        return text

    def _make_options(self, cells: Sequence[int]) -> dict[str, Any]:
        """What pyarrow is told of the dialect and the cells that are wanted."""
        import pyarrow as pa
        from pyarrow import csv

        dialect = self.dialect
        names = [str(k) for k in range(len(dialect.names))]
        types = {
            names[k]: pa.float64() if dialect.kinds[k] == "number" else pa.string()
            for k in cells
        }
        return {
            "read_options": csv.ReadOptions(
                block_size=_BLOCK, skip_rows=dialect.skip, column_names=names,
                encoding=dialect.encoding,
            ),
            "parse_options": csv.ParseOptions(
                delimiter=dialect.delimiter, invalid_row_handler=self._judge_row
            ),
            "convert_options": csv.ConvertOptions(
                include_columns=list(types), column_types=types,
                null_values=list(MISSING), strings_can_be_null=True,
                decimal_point=dialect.decimal,
            ),
        }  # fmt: skip

    def _judge_row(self, row: Any) -> str:
        """What becomes of a row with another number of cells.

        A comment is left out, and the last line of a logger that was killed.
        """
        line = row.text.strip()
        return "skip" if line.startswith(COMMENTS) or line == self._cut else "error"

    def _convert(self, array: Any, cell: int, element: int) -> Values:
        """One column of a block, (n)."""
        kind = self.dialect.kinds[cell]
        if kind == "bool":
            return _convert_words(array)
        if kind == "time":
            return _convert_times(array)
        if kind == "list":
            return _pick_elements(array.to_pylist(), element)
        return convert_array(array)


def _convert_words(array: Any) -> Values:
    """Words (n) for true and false as 1 and 0."""
    values = {"true": 1.0, "false": 0.0}
    words = [str(word).strip().lower() for word in array.to_pylist()]
    return np.array([values.get(word, np.nan) for word in words])


def _convert_times(array: Any) -> Values:
    """Times of day (n) as ISO 8601 writes them, as seconds since 1970 UTC.

    One that states no zone is taken as UTC.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    words = pc.utf8_trim_whitespace(array)
    words = pc.replace_substring(words, ",", ".")
    words = pc.replace_substring_regex(words, r" ?(Z|[+-]\d\d:?\d\d)$", r"\1")
    zoned = pc.match_substring_regex(words, r"(Z|:.*[+-]\d\d(:?\d\d)?)$")
    words = pc.if_else(zoned, words, pc.binary_join_element_wise(words, "Z", ""))
    return convert_array(pc.cast(words, pa.timestamp("ns", "UTC")))


def _pick_elements(cells: Sequence[str | None], element: int) -> Values:
    """One element of the lists in cells, (n); NaN where a list lacks it."""
    lists = (part_list(cell or "") for cell in cells)
    return np.array([x[element] if len(x) > element else np.nan for x in lists])


class _Rows(io.RawIOBase):
    """A text without its comments, in which one blank stands for any run of them."""

    def __init__(self, text: Any, blanks: bool) -> None:
        self._text, self._blanks = text, blanks
        self._rest = b""  # of the last line that was read
        self._ready = memoryview(b"")

    def readable(self) -> bool:
        """True."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer with what follows."""
        view = memoryview(buffer).cast("B")
        while not self._ready:
            block = self._text.read(len(view))
            text = self._rest + block
            end = text.rfind(b"\n") + 1 if block else len(text)
            self._rest = text[end:]
            if not block and not end:
                return 0
            if len(self._rest) > _BLOCK:
                raise InputError("a line is too long")
            self._ready = memoryview(self._clean(text[:end]))
        count = min(len(view), len(self._ready))
        view[:count] = self._ready[:count]
        self._ready = self._ready[count:]
        return count

    def _clean(self, lines: bytes) -> bytes:
        if any(mark.encode() in lines for mark in COMMENTS):
            lines = re.sub(rb"(?m)^[ \t]*[#%].*\n?", b"", lines)
        if self._blanks:
            lines = re.sub(rb"[ \t]+", b" ", lines)
            lines = re.sub(rb"(?m)^ | (?=\r?$)", b"", lines)
        return lines
