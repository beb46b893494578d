"""What a notebook shows of a result: columns by name in; HTML, a frame, axes out."""

import html
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from .extras import import_extra
from .printable import make_printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Columns = Mapping[str, Sequence[Any]]  # of a table, all as long


def format_columns(title: str, columns: Columns) -> str:
    """A table below its title, as HTML; names are escaped, numbers of three digits."""
    head = "".join(f"<th>{_escape(name)}</th>" for name in columns)
    rows = "".join(
        f"<tr>{''.join(f'<td>{_escape(cell)}</td>' for cell in row)}</tr>"
        for row in zip(*columns.values(), strict=True)
    )
    table = f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody>"
    return f"<p><b>{_escape(title)}</b></p><table>{table}</table>"


def _escape(cell: object) -> str:
    """A cell as markup; nothing where there is no value."""
    if cell is None:
        return ""
    return html.escape(
        make_printable(f"{cell:.3g}" if isinstance(cell, float) else str(cell))
    )


def make_frame(columns: Columns) -> Any:
    """A data frame of pandas.

    Raises:
        InputError: pandas is not installed.
    """
    return import_extra("pandas", "pandas", "a data frame").DataFrame(dict(columns))


def open_axes(ax: "Axes | None") -> "Axes":
    """The axes that were given, or those of a new figure of matplotlib's pyplot."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]
