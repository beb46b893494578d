"""Tables as text: takes CSV, TSV and their like, gives one stream."""

import codecs
import csv
import gzip
import io
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import InputError
from ..base import Log, LogFormat, Values
from .arrow import convert_array
from .common import (
    CUT_LINE,
    clean_text,
    explain_damage,
    get_size,
    pad_rows,
    read_start,
)
from .dialect import COMMENTS, MISSING, Dialect, find_dialect, part_list
from .tables import Blocks, Cell, Table, TableLog

if TYPE_CHECKING:
    import pyarrow as pa

_SAMPLE = (
    262_144  # bytes from which the dialect is found; chosen: a thousand rows, or nearly
)
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
        columns = found.columns.values() if found else ()
        return any(column.kind == "number" for column in columns)

    def open(self, path: Path) -> Log:
        """Open a table."""
        with explain_damage(path, "table"):
            dialect = _sniff(path)
        if dialect is None:
            raise InputError(
                f"{path}: no table: its first lines are not rows of equally many "
                "cells that a comma, a semicolon, a tab or a blank separates"
            )
        return TableLog(path, [_make_table(path, dialect)], "table")


def _open_text(path: Path) -> gzip.GzipFile | io.BufferedReader:
    """Open a text file to read its bytes, which gzip may have packed."""
    packed = read_start(path).startswith(_GZIP)
    return gzip.open(path) if packed else path.open("rb")


def _sniff(path: Path) -> Dialect | None:
    """The dialect of a file by its first bytes."""
    with _open_text(path) as file:
        sample = file.read(_SAMPLE)
        return find_dialect(sample, whole=not file.read(1)) if sample else None


class _RowText(io.BufferedIOBase):
    """The text of a table as pyarrow reads it.

    It is UTF-8, without comments where there are some. One blank stands for any run
    of them that delimits cells. A last line that has no end and another number of
    cells is left out, for a logger that was killed writes such.

    Attributes:
        is_cut: whether it was left out.
    """

    def __init__(self, file: io.BufferedIOBase, dialect: Dialect) -> None:
        self.is_cut = self._is_last = False
        self._file, self._dialect = file, dialect
        self._decode = codecs.getincrementaldecoder(dialect.encoding)().decode
        self._rest, self._ready = b"", b""

    def readable(self) -> bool:
        """True."""
        return True

    def read(self, size: int | None = _BLOCK, /) -> bytes:
        """Whole lines of the file, but for where the size ends [B]."""
        size = size or 0
        while len(self._ready) < size and not self._is_last:
            read = self._file.read(_BLOCK)
            self._is_last = not read
            if self._dialect.encoding != "utf-8":
                read = self._decode(read, self._is_last).encode()
            read = self._rest + read
            end = self._find_last_line(read) if self._is_last else _find_end(read)
            lines, self._rest = read[:end], read[end:] * (not self._is_last)
            if len(self._rest) > _BLOCK:
                raise InputError("a line is too long")
            self._ready += self._clean(lines)
        found, self._ready = self._ready[:size], self._ready[size:]
        return found

    def _find_last_line(self, text: bytes) -> int:
        """Where the last line ends that is whole."""
        start = max(text.rfind(b"\n"), text.rfind(b"\r")) + 1
        line = self._clean(text[start:]).decode(errors="replace").strip()
        if not line or line.startswith(COMMENTS):
            return len(text)
        cells = next(csv.reader([line], delimiter=self._dialect.delimiter))
        self.is_cut = len(cells) != len(self._dialect.columns)
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


def _make_table(path: Path, dialect: Dialect) -> Table:
    """The table of a text file."""
    columns = dialect.columns.items()
    cells = {n: Cell(c.width, "s" if c.kind == "time" else c.unit) for n, c in columns}
    times = [name for name, column in columns if column.kind == "time"]
    losses = list[str]()
    read = partial(_read_rows, path, dialect, losses)
    return Table(cells, read, losses, time=times[0] if len(times) == 1 else "")


def _read_rows(
    path: Path, dialect: Dialect, losses: list[str], cells: Collection[str]
) -> Blocks:
    """Blocks of a file; says in `losses` whether the last line was left out."""
    size, kinds = get_size(path), {n: c.kind for n, c in dialect.columns.items()}
    with _open_text(path) as file:
        place = getattr(file, "fileobj", file)  # of gzip, where the packed file is
        text = _RowText(file, dialect)
        for batch in _parse(text, dialect, cells):
            columns = zip(cells, batch.columns, strict=True)
            block = {name: _CONVERT[kinds[name]](array) for name, array in columns}
            yield place.tell() / size, block
        losses[:] = [CUT_LINE] * text.is_cut


def _parse(
    text: _RowText, dialect: Dialect, cells: Collection[str]
) -> "Iterator[pa.RecordBatch]":
    """Batches of some cells of all rows."""
    import pyarrow as pa
    from pyarrow import csv

    types = {
        name: pa.float64() if dialect.columns[name].kind == "number" else pa.string()
        for name in cells
    }
    try:
        yield from csv.open_csv(
            text,
            csv.ReadOptions(
                use_threads=False,  # with threads no row has a number
                block_size=_BLOCK,
                column_names=list(dialect.columns),
                skip_rows=dialect.skip,
            ),
            csv.ParseOptions(
                delimiter=dialect.delimiter, invalid_row_handler=_judge_row
            ),
            csv.ConvertOptions(
                include_columns=list(types),
                column_types=types,
                null_values=list(MISSING),
                strings_can_be_null=True,
                decimal_point=dialect.decimal,
            ),
        )
    except pa.ArrowInvalid as error:
        said = clean_text(error).replace("Row #", "row ")
        is_long = "straddles" in said
        raise InputError("a line is too long" if is_long else said) from error


def _judge_row(row: "pa.csv.InvalidRow") -> str:
    """What becomes of a row with another number of cells: a comment is left out."""
    return "skip" if row.text.strip().startswith(COMMENTS) else "error"


def _convert_words(array: "pa.Array") -> Values:
    """Words (n) for true and false as 1 and 0."""
    values = {"true": 1.0, "false": 0.0}
    words = [str(word).strip().lower() for word in array.to_pylist()]
    return np.array([values.get(word, np.nan) for word in words])


def _convert_times(array: "pa.Array") -> Values:
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


def _convert_lists(array: "pa.Array") -> Values:
    """Lists in cells as (n, d)."""
    return pad_rows([part_list(cell or "") for cell in array.to_pylist()])


_CONVERT: Mapping[str, "Callable[[pa.Array], Values]"] = {
    "number": convert_array,
    "text": convert_array,
    "bool": _convert_words,
    "time": _convert_times,
    "list": _convert_lists,
}
