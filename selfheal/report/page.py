"""One self-contained HTML page: sections of text, tables and pictures in, text out.

A string is made printable and escaped wherever it is put in, unless it is `Html`, which
only the functions here make. The page asks for nothing from anywhere: its policy
forbids it.
"""

import base64
import hashlib
import html
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Self

from markupsafe import Markup

from ..files import write_text
from ..printable import make_printable


class Html(Markup):
    """Text that is markup already; any other that `format` or `join` puts in is not."""

    @classmethod
    def escape(cls, value: object, /) -> Self:
        """Any value as markup: printable and escaped, unless it is `Html`."""
        if isinstance(value, Markup):
            return cls(value)
        shown = make_printable(str(value), keep=SPACES, most=_LONGEST_TEXT)
        return cls(html.escape(shown))


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        title: its heading.
        body: what stands below it; plain strings become paragraphs.
    """

    title: str
    body: tuple[str, ...]


def join_markup(*pieces: object) -> Html:
    """Pieces one after the other."""
    return NOTHING.join(map(Html.escape, pieces))


def mark_text(value: object, kind: str) -> Html:
    """A piece of text in the color of a kind: "right", "wrong" or "soft"."""
    return Html('<span class="{}">{}</span>').format(kind, value)


def make_paragraph(*pieces: object) -> Html:
    """A paragraph of pieces."""
    return Html("<p>{}</p>").format(join_markup(*pieces))


def make_note(*pieces: object) -> Html:
    """A paragraph in soft color."""
    return make_paragraph(mark_text(join_markup(*pieces), "soft"))


def make_table(
    head: Sequence[str], rows: Iterable[Sequence[object]], align: str
) -> Html:
    """A table.

    Args:
        rows: cells, a row as long as `head`.
        align: one letter a column: l left, r right (numbers).
    """
    side = {"l": "", "r": ' class="n"'}

    def line(tag: str, cells: Sequence[object]) -> Html:
        pairs = zip(cells, align, strict=True)
        made = (f"<{tag}{side[a]}>{Html.escape(c)}</{tag}>" for c, a in pairs)
        return Html(f"<tr>{''.join(made)}</tr>")

    body = Html("\n".join(line("td", row) for row in rows))
    return Html(
        '<div class="wide"><table><thead>{}</thead>\n<tbody>{}</tbody></table></div>'
    ).format(line("th", head), body)


def place_beside(*pieces: object) -> Html:
    """Pieces side by side, one below the other where the page is narrow."""
    inner = join_markup(*map(Html("<div>{}</div>").format, pieces))
    return Html('<div class="beside">{}</div>').format(inner)


def make_details(summary: str, *pieces: object) -> Html:
    """Something that a click opens."""
    return Html("<details><summary>{}</summary>{}</details>").format(
        summary, join_markup(*pieces)
    )


def make_bullets(items: Iterable[object]) -> Html:
    """A list, an item a line."""
    inner = join_markup(*map(Html("<li>{}</li>").format, items))
    return Html("<ul>{}</ul>").format(inner) if inner else NOTHING


def make_figure(*pieces: object, caption: str) -> Html:
    """Pictures, and what they show below them."""
    return Html("<figure>{}<figcaption>{}</figcaption></figure>").format(
        join_markup(*pieces), caption
    )


def make_bars(rows: Iterable[tuple[str, str, float]]) -> Html:
    """Numbers one below the other, each with a bar; the longest at most 3 others long.

    Args:
        rows: a label, the number as it is written, the number; NaN has no bar.
    """
    rows = list(rows)
    second, first = [0.0, 0.0, *sorted(x for _, _, x in rows if isfinite(x))][-2:]
    full = (min(first, 3 * second) or first) if first > 0 else 1.0

    def share(number: float) -> float:
        return min(max(number / full, 0.0), 1.0) if isfinite(number) else 0.0

    bar = Html(
        '<div><span>{}</span><b>{}</b><i><i style="width:{:.1f}%"></i></i></div>'
    )
    inner = (bar.format(label, text, 100 * share(x)) for label, text, x in rows)
    return Html('<div class="bars">{}</div>').format(join_markup(*inner))


def format_diff(change: str) -> Html:
    """A unified diff, what is added and what is taken away in two colors."""
    lines = change.splitlines()
    shown = Html("\n").join(
        mark_text(_shorten_line(line), _classify_line(line, at))
        for at, line in enumerate(lines[:_MOST_LINES])
    )
    left = len(lines) - _MOST_LINES
    more = make_paragraph(mark_text(f"{left} more lines.", "soft")) if left > 0 else ""
    return Html('<pre class="diff">{}</pre>{}').format(shown, more)


def _classify_line(line: str, at: int) -> str:
    """The class of a diff's line number `at`, from 0."""
    if line[:2] == "@@" or (at < 2 and line[:3] in ("---", "+++")):
        return "soft"
    return {"+": "right", "-": "wrong"}.get(line[:1], "same")


def _shorten_line(line: str) -> str:
    """A line, without its end where that is far away."""
    if len(line) <= _LONGEST_LINE:
        return line
    return line[: _LONGEST_LINE - 1] + "\N{HORIZONTAL ELLIPSIS}"


def make_page(
    title: str,
    sections: Iterable[Section],
    *,
    lead: str,
    scripts: Sequence[str] = (),
) -> str:
    """The whole page.

    Args:
        lead: a few sentences below the title.
        scripts: that it runs in the end, and no others: its policy has their digests.
    """
    policy, style = _make_policy(scripts), _STYLE_FILE.read_text(encoding="utf-8")
    run = join_markup(*(Html(f"<script>{script}</script>\n") for script in scripts))
    return _PAGE.format(
        policy=Html(policy),
        title=title,
        style=Html(style),
        lead=lead,
        body=Html("\n").join(map(_format_section, sections)),
        scripts=run,
    )


def _make_policy(scripts: Sequence[str]) -> str:
    """What the page may load: nothing, and run: these scripts."""
    if not scripts:
        return _POLICY
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    allowed = " ".join(f"'sha256-{base64.b64encode(d).decode()}'" for d in digests)
    return f"{_POLICY}; script-src {allowed}"


def _format_section(section: Section) -> Html:
    """A section's markup."""
    pieces = (p if isinstance(p, Html) else make_paragraph(p) for p in section.body)
    return Html("<section><h2>{}</h2>\n{}</section>").format(
        section.title, Html("\n").join(pieces)
    )


def write_page(page: str, path: str | os.PathLike[str]) -> None:
    """Write a page whole or not at all.

    Raises:
        InputError: nothing can be written there.
    """
    write_text(path, page)


NOTHING = Html("")
SPACES = "\n\t"  # that may stand in markup
_LONGEST_TEXT = 20_000  # of one piece of text; chosen: a list of some hundred files
_MOST_LINES, _LONGEST_LINE = 400, 300  # of a diff; chosen

_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
# `picture.py` draws in the light values of its variables
_STYLE_FILE = Path(__file__).with_name("page.css")
_PAGE = Html("""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<header><h1>{title}</h1><p class="lead">{lead}</p></header>
<main>
{body}
</main>
{scripts}</body>
</html>
""")
