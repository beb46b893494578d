"""The pages of a study: results in, HTML or Markdown out."""

import html
from collections.abc import Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np

from ..printable import make_printable
from ..report.page import Section, make_page, make_paragraph, make_table
from ..report.picture import (
    BLUE,
    INK,
    LINE,
    MUTED,
    WIDTH,
    embed_figure,
    shorten_label,
    use_page_style,
)
from .calibration import bin_statements
from .plan import Boxes, Picture, Reliability, Table, find_study
from .store import Results

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LIBRARIES = ("mujoco", "jax", "numba", "numpy", "scipy", "distributed")


def describe_progress(results: Results) -> str:
    """How much of a study was done, in a sentence."""
    spent = sum(record["seconds"] for record in results.records.values())
    most = max((r["megabytes"] for r in results.records.values()), default=0)
    progress = f"{len(results.records):,} of {len(results.tasks):,} runs done"
    if results.failed:
        progress += f", {len(results.failed):,} of them failed"
    return f"{progress}; {spent:,.0f} s of workers' time, a worker's peak {most:,} MB."


def _describe_versions(results: Results) -> str:
    """What another person needs to make the same."""
    request = ", ".join(f"{k} {v}" for k, v in results.request.items() if v is not None)
    libraries = ", ".join(f"{name} {version(name)}" for name in _LIBRARIES)
    return f"Study {results.study}: {request}; program {results.code}; {libraries}."


def make_study_page(results: Results, tables: Sequence[Table]) -> str:
    """The page of a study: its pictures and tables."""
    study, records = find_study(results.study), results.finished
    with use_page_style():
        drawn = [_draw_picture(picture) for picture in study.make_pictures(records)]
    sections = [Section(t.title, _format_table(t)) for t in tables]
    failed = [(t.key, results.records[t.key]["error"]) for t in results.failed]
    if failed:
        body = make_table(("run", "error"), failed, "ll")
        sections.append(Section("Runs that failed", (body,)))
    made = make_paragraph(describe_progress(results), " ", _describe_versions(results))
    sections.append(Section("How it was made", (made,)))
    every = [*sections[:1], *drawn, *sections[1:]]
    return make_page(f"Study: {results.study}", every, lead=study.about)


def _format_table(shown: Table) -> tuple[str, ...]:
    """What a table shows, and itself."""
    if not shown.rows:
        return (shown.text,)
    align = "l" + "r" * (len(shown.head) - 1)
    return (shown.text, make_table(shown.head, shown.rows, align))


def format_markdown(results: Results, tables: Sequence[Table]) -> str:
    """A study's page in Markdown, without pictures."""
    study = find_study(results.study)
    parts = [f"# Study: {results.study}", study.about, describe_progress(results)]
    for shown in tables:
        parts += [f"## {_escape_markdown(shown.title)}", _escape_markdown(shown.text)]
        if shown.rows:
            lines = [shown.head, ["---"] * len(shown.head), *shown.rows]
            rows = (" | ".join(map(_escape_markdown, line)) for line in lines)
            parts.append("\n".join(f"| {row} |" for row in rows))
    parts.append(_escape_markdown(_describe_versions(results)))
    return "\n\n".join(parts) + "\n"


def _escape_markdown(text: str) -> str:
    """A text that no file can make a line, a cell or a tag of."""
    return html.escape(make_printable(text), quote=False).replace("|", "&#124;")


def _draw_picture(picture: Picture) -> Section:
    """A picture as a section."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    ax = fig.add_subplot()
    if isinstance(picture, Boxes):
        _draw_boxes(ax, picture)
        caption = (
            "A box from the first to the third quartile with the median; whiskers "
            "reach to the farthest run within 1.5 times its length, dots are the "
            "runs beyond."
        )
    else:
        _draw_reliability(ax, picture)
        caption = (
            "Statements in tenths of the stated probability, against the share that "
            "was true; dots larger where there are more of them. On the line they "
            "are as sure as they say."
        )
    ax.grid(True)
    return Section(picture.title, (embed_figure(fig, caption),))


def _draw_boxes(ax: "Axes", picture: Boxes) -> None:
    """A box a series."""
    names = [shorten_label(name) for name in picture.series]
    shown: Sequence = [np.asarray(values, float) for values in picture.series.values()]
    ink = {"color": INK}
    ax.boxplot(
        shown,
        tick_labels=names,
        orientation="horizontal",
        boxprops=ink,
        whiskerprops=ink,
        capprops=ink,
        medianprops={"color": BLUE, "lw": 2},
        flierprops={"marker": ".", "markeredgecolor": MUTED},
    )
    ax.invert_yaxis()
    ax.set_xlabel(picture.axis)


def _draw_reliability(ax: "Axes", picture: Reliability) -> None:
    """Stated against true."""
    ax.plot([0, 1], [0, 1], color=LINE, lw=1.2)
    for name, pairs in picture.series.items():
        _, counts, x, y = zip(*bin_statements(pairs), strict=True)
        sizes = [10 + 90 * count / len(pairs) for count in counts]
        ax.plot(x, y, lw=0.8)
        ax.scatter(x, y, s=sizes, label=shorten_label(name))
    ax.set_xlabel("stated probability")
    ax.set_ylabel("share that is true")
    ax.legend()
