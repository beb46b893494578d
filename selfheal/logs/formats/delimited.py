"""Tables as text: takes CSV, TSV and their like, gives one stream."""

import codecs
import csv
import gzip
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
    CUT_LINE,
    check_wanted,
    clean_text,
    explain_damage,
    get_size,
    name_elements,
    read_start,
)
from .dialect import COMMENTS, MISSING, Dialect, find_dialect, part_list

_SAMPLE = 262_144  # bytes that tell the dialect; chosen: a thousand rows, or nearly
_BLOCK = 1_000_000  # bytes that are parsed at once; chosen: a line has fewer
_GZIP = b"\x1f\x8b"  # at the start of what gzip packed
# a line that is a comment, with its end; a run of blanks; one at an end of a line
_COMMENT = re.compile(rb"(?:(?<=[\r\n])|\A)[ \t]*[#%][^\r\n]*(?:\r\n?|\n)?")
_BLANKS, _OUTER_BLANK = (
    re.compile(rb"[ \t]+"),
    re.compile(rb" (?=[\r\n]|\Z)|(?<=[\r\n]) |\A "),
)
_SUFFIXES = (".csv", ".tsv", ".tab", ".txt", ".dat", ".asc", ".log")
_JSON = (".json", ".jsonl", ".ndjson")


class DelimitedFormat(LogFormat):
    """CSV, TSV and other tables as text, plain or as gzip packs them."""

    name = "CSV or TSV (also .gz)"

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


def _open_text(path: Path) -> Any:
    """Open a text file to read its bytes, which gzip may have packed."""
    packed = read_start(path).startswith(_GZIP)
    return gzip.open(path) if packed else path.open("rb")


def _sniff(path: Path) -> Dialect | None:
    """The dialect of a file by its first bytes."""
    with _open_text(path) as file:
        sample = file.read(_SAMPLE)
        return find_dialect(sample, whole=not file.read(1)) if sample else None


class _RowText(io.RawIOBase):
    """The text of a table as pyarrow reads it.

    It is UTF-8, without comments where there are some. One blank stands for any run
    of them that delimits cells. A last line that has no end and another number of
    cells is left out, for a logger that was killed writes such.

    Attributes:
        is_cut: whether it was left out.
    """

    def __init__(self, file: Any, dialect: Dialect) -> None:
        self.is_cut = False
        self._file, self._dialect = file, dialect
        self._decode = codecs.getincrementaldecoder(dialect.encoding)().decode
        self._rest, self._ready = b"", b""

    def readable(self) -> bool:
        """True."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer with whole lines of the file, as far as they go."""
        is_last = False
        while not self._ready and not is_last:
            read = self._file.read(_BLOCK)
            is_last = not read
            if self._dialect.encoding != "utf-8":
                read = self._decode(read, is_last).encode()
            read = self._rest + read
            end = self._find_last_line(read) if is_last else _find_end(read)
            lines, self._rest = read[:end], read[end:] * (not is_last)
            if len(self._rest) > _BLOCK:
                raise InputError("a line is too long")
            self._ready = self._clean(lines)
        count = min(len(buffer), len(self._ready))
        buffer[:count], self._ready = self._ready[:count], self._ready[count:]
        return count

    def _find_last_line(self, text: bytes) -> int:
        """Where the last line ends that is whole."""
        start = max(text.rfind(b"\n"), text.rfind(b"\r")) + 1
        line = self._clean(text[start:]).decode(errors="replace").strip()
        if not line or line.startswith(COMMENTS):
            return len(text)
        cells = next(csv.reader([line], delimiter=self._dialect.delimiter))
        self.is_cut = len(cells) != len(self._dialect.names)
        return start if self.is_cut else len(text)

    def _clean(self, lines: bytes) -> bytes:
        """Lines without comments, in which one blank stands for any run of them."""
        if self._dialect.has_comments and any(m.encode() in lines for m in COMMENTS):
            lines = _COMMENT.sub(b"", lines)
        if self._dialect.delimiter == " ":
            lines = _OUTER_BLANK.sub(b"", _BLANKS.sub(b" ", lines))
        return lines


def _find_end(text: bytes) -> int:
    """Where the last whole line ends; a return at the very end may go on."""
    end = text.rfind(b"\n") + 1
    return end or text.rfind(b"\r", 0, len(text) - 1) + 1


class DelimitedLog(Log):
    """A table as text.

    Attributes:
        path: of the file.
        streams: one.
        dialect: how it is written.
    """

    def __init__(self, path: Path, dialect: Dialect) -> None:
        self.path, self.dialect = path, dialect
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
        columns = wanted.get("", ())
        cells = sorted({self._places[column][0] for column in columns})
        if not cells:
            return
        size = get_size(self.path)
        with explain_damage(self.path, "table"), _open_text(self.path) as file:
            place = getattr(file, "fileobj", file)  # of gzip, where the packed file is
            text = _RowText(file, self.dialect)
            for batch in self._parse(text, cells):
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
                    report(min(1.0, place.tell() / size))
            self.losses = [CUT_LINE] * text.is_cut

    def _parse(self, text: _RowText, cells: Sequence[int]) -> Iterator[Any]:
        """Batches of the cells, by number, of all rows."""
        import pyarrow as pa
        from pyarrow import csv

        dialect = self.dialect
        names = [str(k) for k in range(len(dialect.names))]
        types = {
            names[k]: pa.float64() if dialect.kinds[k] == "number" else pa.string()
            for k in cells
        }
        try:
            yield from csv.open_csv(
                io.BufferedReader(text, _BLOCK),
                csv.ReadOptions(
                    use_threads=False,  # with threads no row has a number
                    block_size=_BLOCK, column_names=names, skip_rows=dialect.skip,
                ),
                csv.ParseOptions(
                    delimiter=dialect.delimiter, invalid_row_handler=_judge_row
                ),
                csv.ConvertOptions(
                    include_columns=list(types), column_types=types,
                    null_values=list(MISSING), strings_can_be_null=True,
                    decimal_point=dialect.decimal,
                ),
            )  # fmt: skip
        except pa.ArrowInvalid as error:
            said = clean_text(error).replace("Row #", "row ")
            is_long = "straddles" in said
            raise InputError("a line is too long" if is_long else said) from error

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


def _judge_row(row: Any) -> str:
    """What becomes of a row with another number of cells: a comment is left out."""
    return "skip" if row.text.strip().startswith(COMMENTS) else "error"


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
