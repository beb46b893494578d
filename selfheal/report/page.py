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

from ..files import write_text
from ..printable import make_printable


class Html(str):
    """Text that is markup already; any other text is escaped."""


@dataclass(frozen=True)
class Section:
    """A part of the page.

    Attributes:
        title: its heading.
        body: what stands below it; plain strings become paragraphs.
    """

    title: str
    body: tuple[str, ...]


def escape_text(value: object) -> Html:
    """Any value as markup: escaped, unless it is `Html`."""
    if isinstance(value, Html):
        return value
    shown = make_printable(str(value), keep=SPACES, most=_LONGEST_TEXT)
    return Html(html.escape(shown))


def join_markup(*pieces: object) -> Html:
    """Pieces one after the other."""
    return Html("".join(map(escape_text, pieces)))


def mark_text(value: object, kind: str) -> Html:
    """A piece of text in the color of a kind: "right", "wrong" or "soft"."""
    return Html(f'<span class="{kind}">{escape_text(value)}</span>')


def make_paragraph(*pieces: object) -> Html:
    """A paragraph of pieces."""
    return Html(f"<p>{join_markup(*pieces)}</p>")


def make_table(
    head: Sequence[str], rows: Iterable[Sequence[object]], align: str
) -> Html:
    """A table.

    Args:
        head: the columns' names.
        rows: cells, a row as long as `head`.
        align: one letter a column: l left, r right (numbers).
    """
    side = {"l": "", "r": ' class="n"'}

    def line(tag: str, cells: Sequence[object]) -> str:
        pairs = zip(cells, align, strict=True)
        inner = "".join(f"<{tag}{side[a]}>{escape_text(c)}</{tag}>" for c, a in pairs)
        return f"<tr>{inner}</tr>"

    body = "\n".join(line("td", row) for row in rows)
    return Html(
        f'<div class="wide"><table><thead>{line("th", head)}</thead>\n'
        f"<tbody>{body}</tbody></table></div>"
    )


def place_beside(*pieces: object) -> Html:
    """Pieces side by side, one below the other where the page is narrow."""
    inner = "".join(f"<div>{escape_text(piece)}</div>" for piece in pieces)
    return Html(f'<div class="beside">{inner}</div>')


def make_details(summary: str, *pieces: object) -> Html:
    """Something that a click opens."""
    return Html(
        f"<details><summary>{escape_text(summary)}</summary>{join_markup(*pieces)}</details>"
    )


def make_bullets(items: Iterable[object]) -> Html:
    """A list, an item a line."""
    inner = "".join(f"<li>{escape_text(item)}</li>" for item in items)
    return Html(f"<ul>{inner}</ul>" if inner else "")


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

    inner = "".join(
        f"<div><span>{escape_text(label)}</span><b>{escape_text(written)}</b>"
        f'<i><i style="width:{100 * share(number):.1f}%"></i></i></div>'
        for label, written, number in rows
    )
    return Html(f'<div class="bars">{inner}</div>')


def format_diff(change: str) -> Html:
    """A unified diff, what is added and what is taken away in two colors."""
    lines = change.splitlines()
    shown = "\n".join(
        f"<span "
        f'class="{_classify_line(line, at)}">{escape_text(_shorten_line(line))}</span>'
        for at, line in enumerate(lines[:_MOST_LINES])
    )
    left = len(lines) - _MOST_LINES
    more = make_paragraph(mark_text(f"{left} more lines.", "soft")) if left > 0 else ""
    return join_markup(Html(f'<pre class="diff">{shown}</pre>'), more)


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
        title: of the page.
        sections: in order.
        lead: a few sentences below the title.
        scripts: that it runs in the end, and no others: its policy has their digests.
    """
    body = "\n".join(map(_format_section, sections))
    policy = _make_policy(scripts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape_text(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f"<header><h1>{escape_text(title)}</h1><p "
        f'class="lead">{escape_text(lead)}</p></header>\n'
        f"<main>\n{body}\n</main>\n"
        + "".join(f"<script>{script}</script>\n" for script in scripts)
        + "</body>\n</html>\n"
    )


def _make_policy(scripts: Sequence[str]) -> str:
    """What the page may load: nothing, and run: these scripts."""
    if not scripts:
        return _POLICY
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    allowed = " ".join(f"'sha256-{base64.b64encode(d).decode()}'" for d in digests)
    return f"{_POLICY}; script-src {allowed}"


def _format_section(section: Section) -> str:
    """A section's markup."""
    pieces = (p if isinstance(p, Html) else make_paragraph(p) for p in section.body)
    return (
        f"<section><h2>{escape_text(section.title)}</h2>\n"
        + "\n".join(pieces)
        + "</section>"
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

# `picture.py` draws in these variables' light values
_STYLE = """
:root { color-scheme: light dark; --ink: #1b1f24; --muted: #5b6470; --line: #d5dae0;
  --paper: #fdfdfc; --card: #ffffff; --right: #005b8f; --wrong: #a84300; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e7eb; --muted: #9aa4b0;
  --line: #3a424c; --paper: #15181c; --card: #1c2026; --right: #6cb8ea;
  --wrong: #ff9a5c; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 68rem; padding: 2.5rem 1.25rem 4rem;
  background: var(--paper); color: var(--ink); line-height: 1.55;
  font-family: system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0 0 .6rem; letter-spacing: -.01em; }
h2 { font-size: 1.25rem; margin: 0 0 .5rem; }
.lead { font-size: 1.1rem; margin: 0; max-width: 48rem; }
section { margin-top: 2.75rem; }
p { max-width: 48rem; margin: .5rem 0; }
figure { margin: 1rem 0; padding: .9rem; background: var(--card);
  border: 1px solid var(--line); border-radius: 8px; }
figure svg, figure img { display: block; width: 100%; height: auto; }
@media (max-width: 45rem) { figure { overflow-x: auto; }
  figure svg, figure img { min-width: 42rem; } }
.live { background: #ffffff; display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fit, minmax(min(27rem, 100%), 1fr)); }
.live > div { min-width: 0; }
.live p { margin: .3rem 0 0; color: #1b1f24; font-weight: 600; }
@media screen { .live:has(.curves > *) ~ :is(svg, img) { display: none; }
  .live:not(:has(.curves > *)) { display: none; } }
@media print { .live { display: none; } }
figure svg text { font-family: inherit !important; }
figcaption { color: var(--muted); font-size: .875rem; margin-top: .6rem;
  max-width: 52rem; }
.beside { display: flex; flex-wrap: wrap; gap: 0 4rem; }
.wide { overflow-x: auto; margin: .9rem 0; }
table { border-collapse: collapse; font-size: .92rem; }
th, td { text-align: left; padding: .32rem 1rem .32rem 0; vertical-align: top;
  border-bottom: 1px solid var(--line); }
th { color: var(--muted); font-weight: 600; vertical-align: bottom; }
.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
th.n { white-space: normal; }
.right { color: var(--right); font-weight: 600; }
.wrong { color: var(--wrong); font-weight: 600; }
.soft, details > summary { color: var(--muted); }
details > summary { cursor: pointer; margin: .6rem 0; }
h3 { font-size: 1.05rem; margin: 1.4rem 0 .2rem; }
ul { max-width: 48rem; margin: .5rem 0; padding-left: 1.2rem; }
.bars { display: grid; gap: .35rem; max-width: 48rem; margin: .9rem 0; }
.bars > div { display: grid; grid-template-columns: 13rem 5.5rem 1fr; gap: .8rem;
  align-items: center; }
.bars b { text-align: right; font-variant-numeric: tabular-nums; }
.bars > div > i { display: block; }
.bars i > i { display: block; height: .8rem; min-width: 2px; border-radius: 2px;
  background: var(--right); }
@media (max-width: 45rem) { .bars > div { grid-template-columns: 8rem 5.5rem 1fr; } }
.diff { background: var(--card); border: 1px solid var(--line); border-radius: 8px;
  padding: .7rem .9rem; white-space: pre-wrap; overflow-wrap: anywhere;
  font-size: .82rem; line-height: 1.45; }
.diff .right, .diff .wrong { font-weight: 400; }
@media print { body { max-width: none; padding: 0; } h2, h3 { break-after: avoid; }
  figure, tr, .bars { break-inside: avoid; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; } }
"""
