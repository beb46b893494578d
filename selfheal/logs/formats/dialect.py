"""How a text file holds a table: its first lines in, the rules of reading it out."""

import codecs
import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from .common import MAX_COLUMNS, make_unique

COMMENTS = ("#", "%")
# words for a number that is missing, as loggers and pandas write them
MISSING = (
    *("", "nan", "NaN", "NAN", "-nan", "NA", "N/A", "n/a"),
    *("null", "NULL", "None", "none", "-"),
)
_DELIMITERS = ("\t", ";", ",", "|", " ")  # those first that stand in no number or text
_MAX_LINES = 1_000  # of a sample; chosen: enough to tell a text from a number
_MAX_NAME = 200  # characters of a name in which a unit is looked for; chosen
_NUMBER = re.compile(
    r"[+-]?(\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?|[+-]?(inf|nan)", re.ASCII | re.IGNORECASE
)
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_TIME = re.compile(  # ISO 8601
    r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d([.,]\d{1,9})?)? ?(Z|[+-]\d\d(:?\d\d)?)?",
    re.ASCII,
)
_UNIT = re.compile(r"[^\[\]()]+[\[(]\s*([^\[\]()]{1,20}?)\s*[\])]\s*")


class TextColumn(NamedTuple):
    """What a text file says of a column.

    Attributes:
        kind: "number", "bool", "time", "list" or "text".
        unit: "" where the file states none.
        width: elements of the longest list in a cell; 0 of any other kind.
    """

    kind: str
    unit: str
    width: int


@dataclass(frozen=True)
class Dialect:
    """How a text file holds a table.

    Attributes:
        delimiter: between the cells of a row; a blank stands for any run of them.
        skip: lines before the first row of data; comments are not counted.
        decimal: the character before the fraction of a number.
        has_comments: whether there are some in the first lines.
    """

    delimiter: str
    encoding: str
    skip: int
    columns: Mapping[str, TextColumn]
    decimal: str
    has_comments: bool


def find_dialect(sample: bytes, whole: bool) -> Dialect | None:
    """The dialect of a text file; None where it is no table.

    Args:
        whole: whether that is all.
    """
    encoding = _find_encoding(sample)
    text = sample.decode(encoding, errors="ignore").lstrip("\ufeff")
    if not encoding.startswith("utf-16") and b"\0" in sample:
        return None
    lines = re.split(r"\r\n|\n|\r", text)[: None if whole else -1]
    start, comment = 0, ""
    while start < len(lines) and _is_no_row(lines[start]):
        comment = lines[start].strip() or comment
        start += 1
    body = [line for line in lines[start:] if not _is_no_row(line)]
    is_cut = whole and bool(lines[-1])  # the last line may be a part of a row
    for delimiter in _DELIMITERS:
        rows = _part_lines(body[:_MAX_LINES], delimiter)
        if not rows and is_cut and len(body) <= _MAX_LINES:
            rows = _part_lines(body[:-1], delimiter)
        if rows and len(rows[0]) > 1:
            break
    else:  # a column of numbers alone is a table, any other text is none
        delimiter, rows = ",", [[line.strip()] for line in body[:_MAX_LINES]]
        if len(rows) < 2 or not all(_is_number(row[0], ".") for row in rows[1:]):
            return None
    return _make_dialect(rows, lines, comment, delimiter, encoding)


def _find_encoding(sample: bytes) -> str:
    """The encoding of a text: by its mark, else UTF-8 if that fits."""
    if sample.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(sample)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def _is_no_row(line: str) -> bool:
    line = line.strip()
    return not line or line.startswith(COMMENTS) or line.lower().startswith("sep=")


def _part_lines(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    """Rows of equal length; none where the delimiter does not give such."""
    if delimiter == " ":
        lines = [re.sub(r"[ \t]+", " ", line.strip()) for line in lines]
    try:
        parted = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
        rows = [[cell.strip() for cell in row] for row in parted]
    except csv.Error:
        return []
    return rows if len({len(row) for row in rows}) == 1 else []


def _make_dialect(
    rows: list[list[str]],
    lines: Sequence[str],
    comment: str,
    delimiter: str,
    encoding: str,
) -> Dialect | None:
    """The dialect of rows, the first of which may be a header and one of units.

    None where they have too many columns.
    """
    decimal = _find_decimal(rows, delimiter)
    width, heads = len(rows[0]), 0
    names, units = [str(k) for k in range(width)], [""] * width
    if _is_header(rows, decimal):
        heads = 1
        names = [cell or name for cell, name in zip(rows[0], names, strict=True)]
        if len(rows) > 2 and _are_units(rows[1], rows[2], decimal):
            heads = 2
            units = [cell.strip("[]() ") for cell in rows[1]]
    else:  # as numpy.savetxt writes a header
        said = _part_lines([comment.lstrip("#% \t")], delimiter)
        names = said[0] if said and len(said[0]) == width else names
    units = [unit or _find_unit(name) for unit, name in zip(units, names, strict=True)]
    found = dict[str, TextColumn]()
    cells = list(zip(*rows[heads:], strict=True)) or [()] * width
    for name, unit, column in zip(make_unique(names), units, cells, strict=True):
        kind = _find_kind(column, decimal)
        lists = map(part_list, column) if kind == "list" else ()
        found[name] = TextColumn(kind, unit, max(map(len, lists), default=0))
    if width + sum(column.width for column in found.values()) > MAX_COLUMNS:
        return None
    has_comments = any(line.strip().startswith(COMMENTS) for line in lines)
    skip = _count_lines(lines, heads)
    return Dialect(delimiter, encoding, skip, found, decimal, has_comments)


def _count_lines(lines: Sequence[str], rows: int) -> int:
    """How many lines stand before and in some rows, without the comments."""
    count = 0
    for line in lines:
        if rows == 0 and not line.lower().startswith("sep="):
            break
        count += not line.strip().startswith(COMMENTS)
        rows -= not _is_no_row(line)
    return count


def _find_decimal(rows: Sequence[Sequence[str]], delimiter: str) -> str:
    """A comma if numbers have one; only where it delimits nothing."""
    cells = [cell for row in rows for cell in row]
    if delimiter == ";" and any(_COMMA_NUMBER.fullmatch(cell) for cell in cells):
        return ","
    return "."


def _is_number(cell: str, decimal: str) -> bool:
    if decimal == ",":
        cell = cell.replace(".", " ").replace(",", ".")
    return bool(_NUMBER.fullmatch(cell))


def _is_data(cell: str, decimal: str) -> bool:
    """Whether a cell can stand in no header."""
    return (
        _is_number(cell, decimal)
        or bool(_TIME.fullmatch(cell))
        or bool(part_list(cell))
    )


def _is_header(rows: Sequence[Sequence[str]], decimal: str) -> bool:
    """Whether the first row is one: it has no data, or words above numbers."""
    if not any(_is_data(cell, decimal) for cell in rows[0]):
        return True
    return any(
        not _is_data(cell, decimal) and cell not in MISSING and _is_number(low, decimal)
        for cell, low in zip(rows[0], rows[min(1, len(rows) - 1)], strict=True)
    )


def _are_units(row: Sequence[str], below: Sequence[str], decimal: str) -> bool:
    """Whether a row that is no data stands above one with numbers."""
    numeric = [_is_number(cell, decimal) for cell in below]
    return any(numeric) and not any(
        _is_data(cell, decimal)
        or (number and cell in MISSING and cell not in ("", "-"))
        for cell, number in zip(row, numeric, strict=True)
    )


def _find_unit(name: str) -> str:
    """The unit in brackets at the end of a name; "" of an index."""
    found = _UNIT.fullmatch(name[-_MAX_NAME:])
    return found[1] if found and not found[1].isdigit() else ""


def _find_kind(column: Sequence[str], decimal: str) -> str:
    """What the cells of a column are."""
    cells = [cell for cell in column if cell not in MISSING]
    if all(_is_number(cell, decimal) for cell in cells):
        return "number"
    if all(cell.lower() in ("true", "false") for cell in cells):
        return "bool"
    if all(_TIME.fullmatch(cell) for cell in cells):
        return "time"
    return "list" if all(part_list(cell) for cell in cells) else "text"


def part_list(cell: str) -> list[float]:
    """Numbers of a cell such as "[0.1, 0.2]" or "0.1 0.2"; none where it is no list."""
    inner = cell.strip()
    bare = inner[:1] not in ("[", "(")
    try:
        found = [float(word) for word in re.sub(r"[\[\](),;]", " ", inner).split()]
    except ValueError:
        return []
    return [] if bare and (len(found) < 2 or "," in inner or ";" in inner) else found
