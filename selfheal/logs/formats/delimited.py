"""Tables as text: takes CSV, TSV and their like, gives one stream."""

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
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
from .text_blocks import GZIP, Block, cut_blocks, map_in_order, open_text

_SAMPLE = 262_144  # bytes that tell the dialect; chosen: a thousand rows, or nearly
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
        suffixes = path.suffixes[-2:] if start.startswith(GZIP) else path.suffixes[-1:]
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
    with open_text(path) as file:
        sample = file.read(_SAMPLE)
        return find_dialect(sample, whole=not file.read(1)) if sample else None


def _read_cut_line(path: Path, encoding: str) -> str:
    """What follows the last end of a line; "" of a file that is packed."""
    if read_start(path).startswith(GZIP):
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
        self.losses = []
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
        columns, rows = wanted.get("", ()), 0
        cells = sorted({self._places[column][0] for column in columns})
        if not cells:
            return
        with explain_damage(self.path, "table"):
            blocks = cut_blocks(self.path, self.dialect.encoding)
            for part in map_in_order(partial(self._parse, columns, cells), blocks):
                if part.error:
                    raise InputError(part.explain(rows))
                rows += part.count
                if part.rows:
                    yield "", part.rows
                if report:
                    report(part.share)

    def _parse(
        self, columns: Sequence[str], cells: Sequence[int], block: Block
    ) -> "_Part":
        """Columns of a block of lines.

        Args:
            columns: that are wanted.
            cells: numbers of the cells that they are in, which increase.
            block: of the file.
        """
        import pyarrow as pa
        from pyarrow import csv

        lines = self._clean(block.lines)
        if not lines or lines.isspace():
            return _Part(share=block.share)
        cut = list[str]()
        options = self._make_options(cells, block, len(lines), cut)
        try:
            table = csv.read_csv(pa.BufferReader(lines), **options)
        except pa.ArrowInvalid as error:
            return _Part(error=str(error))
        if cut:
            self.losses = [CUT_LINE]
        by_cell = dict(zip(cells, table.columns, strict=True))
        rows = {
            column: self._convert(by_cell[cell].combine_chunks(), cell, element)
            for column in columns
            for cell, element in (self._places[column],)
        }
        return _Part(rows if len(table) else {}, len(table), block.share)

    def _clean(self, lines: bytes) -> bytes:
        """Lines without comments, in which one blank stands for any run of them."""
        if self.dialect.has_comments and any(m.encode() in lines for m in COMMENTS):
            lines = _COMMENT.sub(b"", lines)
        if self.dialect.delimiter == " ":
            lines = _OUTER_BLANK.sub(b"", _BLANKS.sub(b" ", lines))
        return lines

    def _make_options(
        self, cells: Sequence[int], block: Block, size: int, cut: list[str]
    ) -> dict[str, Any]:
        """What pyarrow is told.

        Args:
            cells: that are wanted.
            block: of lines that are to be read.
            size: of them without comments [B].
            cut: gets the last line, where it is left out for it is a part of one.
        """
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
                use_threads=False, block_size=size + 1, column_names=names,
                skip_rows=dialect.skip if block.is_first else 0,
            ),
            "parse_options": csv.ParseOptions(
                delimiter=dialect.delimiter,
                invalid_row_handler=partial(self._judge_row, block.is_last, cut),
            ),
            "convert_options": csv.ConvertOptions(
                include_columns=list(types), column_types=types,
                null_values=list(MISSING), strings_can_be_null=True,
                decimal_point=dialect.decimal,
            ),
        }  # fmt: skip

    def _judge_row(self, is_end: bool, cut: list[str], row: Any) -> str:
        """What becomes of a row with another number of cells.

        A comment is left out, and the last line of a logger that was killed.

        Args:
            is_end: whether the row is in the last block.
            cut: gets the last line.
            row: as pyarrow has it.
        """
        line = row.text.strip()
        if line.startswith(COMMENTS):
            return "skip"
        if is_end and line == self._cut and not cut:  # what is like it is no last one
            cut.append(line)
            return "skip"
        return "error"

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


@dataclass(frozen=True)
class _Part:
    """What was made of a block.

    Attributes:
        rows: its columns; none where it has no row.
        count: of its rows.
        share: of the file that was read, from 0 to 1.
        error: what pyarrow says is wrong with it; "" if nothing.
    """

    rows: Rows = field(default_factory=dict)
    count: int = 0
    share: float = 0.0
    error: str = ""

    def explain(self, before: int) -> str:
        """The error, the number of a row counted from the start of the file.

        Args:
            before: rows in the blocks before this one.
        """
        return re.sub(
            r"Row #(\d+)", lambda m: f"row {int(m[1]) + before}", clean_text(self.error)
        )


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
