"""What commands print: lines, tables or one JSON object; no other module here prints.

Text is made printable. So a newline is none: lines are several calls, and a cell of
several lines is a sequence of them.
"""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from selfheal.printable import make_printable

from ._streams import unwrap

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text

Cell = str | Sequence[str]


def print_json(result: Mapping[str, Any]) -> None:
    """Print one JSON object, and refuse what JSON has no word for (NaN)."""
    print(json.dumps(result, allow_nan=False), flush=True)


def print_line(line: str, *, is_error: bool = False) -> None:
    """Print a line, perhaps to standard error."""
    stream = sys.stderr if is_error else sys.stdout
    print(make_printable(line), file=stream, flush=True)


def print_text(text: str, style: str = "", *, is_wrapped: bool = True) -> None:
    """Print a text.

    Args:
        text: of one paragraph.
        style: of rich, "bold" say.
        is_wrapped: whether it is broken into lines as wide as the terminal.
    """
    _make_console().print(_make_text(text, style), soft_wrap=not is_wrapped)


def print_table(
    head: Sequence[str],
    rows: Iterable[Sequence[Cell]],
    *,
    title: str = "",
    whole: int = 0,
) -> None:
    """Print a table.

    Args:
        head: names of the columns.
        rows: cells, a row as long as `head`.
        title: above it.
        whole: number of first columns whose cells are never broken.
    """
    from rich.table import Table

    above = _make_text(title, "table.title") if title else None
    table = Table(title=above, title_justify="left")
    for column, name in enumerate(head):
        table.add_column(_make_text(name), overflow="fold", no_wrap=column < whole)
    for row in rows:
        table.add_row(*map(_make_cell, row))
    _make_console().print(table)


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
