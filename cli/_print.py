"""What commands print: lines, tables or one JSON object; no other module here prints.

Text is made printable. So a newline is none: lines are several calls, and a cell of
several lines is a sequence of them.
"""

import json
import shutil
import sys
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from selfheal.printable import make_printable

from ._streams import unwrap

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

Cell = str | Sequence[str]


def print_json(result: Mapping[str, object]) -> None:
    """Print one JSON object, and refuse what JSON has no word for (NaN)."""
    print(json.dumps(result, allow_nan=False), flush=True)


def print_document(name: str, /, **members: object) -> None:
    """Print the JSON object of a command, under the format of that name."""
    print_json({"format": f"selfheal-{name}", "version": 1, **members})


def print_line(line: str, style: str = "") -> None:
    """Print a line, perhaps in a style of rich; only the terminal breaks it."""
    if style:
        _make_console().print(_make_text(line, style), soft_wrap=True)
    else:
        print(make_printable(line), flush=True)


def print_error(line: str) -> None:
    """Print a line to standard error."""
    print(make_printable(line), file=sys.stderr, flush=True)


def print_paragraph(text: str, indent: str = "", style: str = "") -> None:
    """Print a text in lines as wide as the terminal, and break no word.

    Args:
        indent: before every line but the first.
        style: of rich, "dim" say.
    """
    width = shutil.get_terminal_size().columns - 1
    wrap = textwrap.TextWrapper(width, subsequent_indent=indent)
    wrap.break_long_words = wrap.break_on_hyphens = False
    for line in wrap.wrap(make_printable(text)):
        print_line(line, style)


def print_table(
    head: Sequence[str],
    rows: Iterable[Sequence[Cell]],
    *,
    title: str = "",
    whole: int = 0,
) -> None:
    """Print a table in which no word is broken; too wide for one, row by row.

    Args:
        rows: cells, a row as long as `head`.
        whole: number of first columns whose cells are never broken.
    """
    from rich.measure import Measurement
    from rich.table import Table

    console = _make_console()
    names, cells = [*map(_make_text, head)], [[*map(_make_cell, row)] for row in rows]
    above = _make_text(title, "table.title") if title else None
    spans = [
        [Measurement.get(console, console.options, text) for text in column]
        for column in zip(names, *cells, strict=True)
    ]
    least = [
        max(s.maximum if k < whole else s.minimum for s in column)
        for k, column in enumerate(spans)
    ]
    most = [max(s.maximum for s in column) for column in spans]
    room = console.width - _BORDER * len(head) - 1
    if sum(least) > room:
        _print_records(console, above, names, cells)
        return
    table = Table(title=above, title_justify="left")
    for name, width in zip(names, _share_room(least, most, room), strict=True):
        table.add_column(name, width=width)
    for row in cells:
        table.add_row(*row)
    console.print(table)


_BORDER = 3  # characters of a column that are none of its text: a line, two blanks


def _share_room(least: Sequence[int], most: Sequence[int], room: int) -> Sequence[int]:
    """Widths of columns in a room that holds the least of all: the widest ones give."""
    for limit in range(max(most), 0, -1):
        widths = [max(a, min(b, limit)) for a, b in zip(least, most, strict=True)]
        if sum(widths) <= room:
            return widths
    return least


def _print_records(
    console: "Console",
    title: "Text | None",
    names: Sequence["Text"],
    cells: Iterable[Sequence["Text"]],
) -> None:
    """Print each row by itself, its first cell above the others."""
    from rich.text import Text

    if title is not None:
        console.print(title)
    for row in cells:
        row[0].stylize("bold")
        console.print(row[0])
        marked = [name + Text(": ") if name.plain else name for name in names[1:]]
        said = Text("; ").join(
            name + Text(", ").join(cell.split())
            for name, cell in zip(marked, row[1:], strict=True)
            if cell.plain
        )
        for line in said.wrap(console, console.width - 2):
            console.print(Text("  ") + line)


def _make_console() -> "Console":
    """A console that writes its own control sequences, of colors, to the terminal."""
    from rich.console import Console

    return Console(file=unwrap(sys.stdout))


def _make_text(text: str, style: str = "") -> "Text":
    """A text of which nothing is markup."""
    from rich.text import Text

    return Text(make_printable(text), style)


def _make_cell(cell: Cell) -> "Text":
    """A cell's text."""
    from rich.text import Text

    lines = [cell] if isinstance(cell, str) else cell
    return Text("\n".join(map(make_printable, lines)))
