"""Matplotlib figures as inline pictures in the page's light and dark colors."""

import base64
import io
import re
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from ..body.body import Floats
from ..printable import escape_unprintable, make_printable
from .page import NOTHING, SPACES, Html, make_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# drawn in the light values of the page's variables, which then take their place
INK, MUTED, LINE, PAPER = "#1b1f24", "#5b6470", "#d5dae0", "#ffffff"
_VARIABLES = {INK: "ink", MUTED: "muted", LINE: "line", PAPER: "card"}
WIDTH = 10.4  # of every figure [in]; chosen
# Okabe and Ito's palette, which color-blind readers can tell apart
BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"
COLORS = (BLUE, ORANGE, GREEN, "#cc79a7", "#e69f00", "#56b4e9")  # in order
# color and width [pt] of what each model predicts; what the given one does is dashed
CURVES = {"given": (MUTED, 1.0), "refit": (ORANGE, 1.2), "patched": (BLUE, 1.4)}
_LARGEST_SVG = 1_500_000  # characters; beyond it a PNG is smaller; chosen
_LONGEST_LABEL = 28  # characters; chosen
_STYLE = {
    "svg.fonttype": "none",
    "svg.hashsalt": "selfheal",
    "font.size": 9.0,
    "text.color": INK,
    "text.parse_math": False,  # a dollar in a name is a dollar
    "axes.edgecolor": MUTED,
    "axes.facecolor": "none",
    "axes.labelcolor": INK,
    "axes.titlesize": 9.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "figure.facecolor": "none",
    "grid.color": LINE,
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}


@contextmanager
def use_page_style() -> Iterator[None]:
    """Figures made and drawn inside look like the page."""
    import matplotlib

    style = matplotlib.rc_context(_STYLE)  # type: ignore[arg-type]  # no plain str
    with style, warnings.catch_warnings():
        # the browser has its own fonts; matplotlib's only measures
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def load_matplotlib() -> None:
    """Import what figures need, which takes longer than to draw one."""
    import matplotlib.backends.backend_svg
    import matplotlib.figure  # noqa: F401


def make_canvas(wide: float, high: float) -> tuple["Figure", "Axes"]:
    """A figure that is one drawing: x from 0 to `wide`, y from `-high` to 0."""
    from matplotlib.figure import Figure

    fig = Figure(figsize=(WIDTH, WIDTH * high / wide))
    ax = fig.add_axes((0, 0, 1, 1))
    ax.set_axis_off()
    ax.set_xlim(0, wide)
    ax.set_ylim(-high, 0)
    return fig, ax


def make_plot(
    height: float, box: tuple[float, float, float, float], x: str, y: str
) -> tuple["Figure", "Axes"]:
    """A figure of a height [in], and axes with labels.

    Args:
        box: of the axes: left, bottom, width and height, of the figure's size.
        x: label of the horizontal axis.
        y: label of the vertical one.
    """
    from matplotlib.figure import Figure

    fig = Figure(figsize=(WIDTH, height))
    ax = fig.add_axes(box)
    ax.set_xlabel(x)
    ax.set_ylabel(y)
    return fig, ax


def place_legend(ax: "Axes") -> None:
    """Put the legend to the right of axes."""
    ax.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))


def shorten_label(value: object) -> str:
    """A name from a file as a figure can carry it: one short line."""
    printable = make_printable(" ".join(str(value).split()))
    if len(printable) > _LONGEST_LABEL:
        printable = printable[: _LONGEST_LABEL - 1] + "\N{HORIZONTAL ELLIPSIS}"
    return printable


def embed_figure(fig: "Figure", caption: str, live: Html = NOTHING) -> Html:
    """A figure with its caption, inline: SVG, or PNG where that is smaller.

    Args:
        fig: made inside `style()`, as is this call.
        caption: below it; also what a screen reader says.
        live: what stands in its place on a screen, once a script has filled it.
    """
    drawn = _encode_svg(fig)
    if len(drawn) > _LARGEST_SVG:
        picture = Html('<img alt="{}" src="data:image/png;base64,{}">').format(
            caption, Html(_encode_png(fig))
        )
    else:
        start = Html('<svg role="img" aria-label="{}" ').format(caption)
        picture = start + Html(drawn.removeprefix("<svg "))
    return make_figure(live, picture, caption=caption)


def draw_paths(
    paths: Iterable[tuple[str, str, Floats, Floats]], forward: str, caption: str
) -> Html:
    """Paths from above, from a dot to dots, a meter as long in both directions.

    Args:
        paths: title, color, and (S) to the right and (S) up [m] of each.
        forward: what is to the right, in words; up is to its left.
    """
    box = (0.07, 0.15, 0.9, 0.8)
    fig, ax = make_plot(3.5, box, f"{forward} [m]", "to the left [m]")
    for title, color, x, y in paths:
        ax.plot(x, y, color=color, lw=1.5, label=title)
        ax.plot(x[-1], y[-1], "o", color=color, ms=5)
    ax.plot(0, 0, "o", color=INK, ms=4)
    ax.set_aspect("equal", adjustable="datalim")
    ax.legend()
    ax.grid(True)
    return embed_figure(fig, caption)


def _encode_svg(fig: "Figure") -> str:
    """A figure as an SVG element without anything that an HTML page has no use for."""
    buffer = io.StringIO()
    fig.savefig(buffer, format="svg", metadata={"Date": None})
    drawn = buffer.getvalue()
    drawn = drawn[drawn.index("<svg ") :]
    drawn = re.sub(r"<metadata>.*?</metadata>", "", drawn, flags=re.DOTALL)
    drawn = re.sub(r"<!--.*?-->", "", drawn, flags=re.DOTALL)
    # names of groups repeat from figure to figure; nothing refers to them
    drawn = re.sub(r'<g id="[^"]*">', "<g>", drawn)
    for color, variable in _VARIABLES.items():
        drawn = drawn.replace(color, f"var(--{variable})")
    return escape_unprintable(drawn, keep=SPACES)


def _encode_png(fig: "Figure") -> str:
    """A figure as base64 of a PNG on white."""
    buffer = io.BytesIO()
    fig.savefig(buffer, format="png", dpi=150, facecolor="white")
    return base64.b64encode(buffer.getvalue()).decode("ascii")
