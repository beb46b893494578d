"""Curves that zoom and show their values: traces in, markup and scripts out.

Bokeh draws them, where it is installed, all in the page. Elsewhere, in print and
without scripts there is the static figure.
"""

import json
from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Floats
from ..diagnosis.output.result import Trace
from .page import Html, join_markup
from .picture import CURVES, INK

if TYPE_CHECKING:
    from bokeh.models import ColumnDataSource, GridPlot
    from bokeh.plotting import figure
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

EXTRA = "interactive"  # of pyproject.toml
_POINTS = 2000  # most of a curve; chosen: zoomed to a third it still fills a screen
_HIGH, _LOW = 220, 120  # [px] of a curve, and of what it is off by; chosen
_TICK = 40  # [px] from one number on an axis to the next, about; chosen
_WIDER = 0.2  # [px] than the static curves; chosen


def is_live_available() -> bool:
    """Whether the library that draws them is installed."""
    return find_spec("bokeh") is not None


def make_live_curves(traces: Sequence[Trace], fig: "Figure") -> tuple[Html, list[str]]:
    """Places for the curves of traces, and the scripts that draw them there.

    Args:
        fig: as `figures.draw_traces` draws them, whose titles and limits these have.
    """
    from bokeh.embed import json_item
    from bokeh.resources import Resources

    library, *_ = Resources(mode="inline", components=["bokeh"]).js_raw
    places, calls = [], ["Bokeh.set_log_level('warn');"]
    pairs = zip(fig.axes[::2], fig.axes[1::2], strict=True)
    for k, (trace, axes) in enumerate(zip(traces, pairs, strict=True)):
        item = _escape(json.dumps(json_item(_draw_trace(trace, *axes))))
        calls.append(f"Bokeh.embed.embed_item({item}, 'live-{k}');")
        place = '<div><p>{}</p><div class="curves" id="live-{}"></div></div>'
        places.append(Html(place).format(axes[0].get_title(loc="left"), k))
    live = Html('<div class="live">{}</div>').format(join_markup(*places))
    return live, [library, "\n".join(calls)]


def _escape(text: str) -> str:
    """JSON that no name in it can end the script with."""
    return text.replace("<", "\\u003c")


def _draw_trace(trace: Trace, upper: "Axes", lower: "Axes") -> "GridPlot":
    """One stretch, what the predictions are off by below it, on one axis of time."""
    from bokeh.layouts import gridplot
    from bokeh.models import HoverTool

    source = _make_source(trace)
    top, below = _make_plot(upper, _HIGH), _make_plot(lower, _LOW)
    below.x_range, below.xaxis.axis_label = top.x_range, lower.get_xlabel()
    read = top.line("time", "measured", source=source, legend_label="measured")
    read.glyph.update(line_color=INK, line_alpha=0.45, line_width=4)
    for name, (color, width) in CURVES.items():
        curve = top.line("time", name, source=source, legend_label=name)
        error = below.line("time", f"{name}_off", source=source)
        dash = "dashed" if name == "given" else "solid"
        for glyph in (curve.glyph, error.glyph):
            glyph.update(line_color=color, line_width=width + _WIDER, line_dash=dash)
    names = ["time", "measured", *CURVES]
    hover = HoverTool(mode="vline", renderers=[read])
    hover.tooltips = [(name, f"@{name}{{%.5g}}") for name in names]
    hover.formatters = {f"@{name}": "printf" for name in names}
    top.add_tools(hover)
    top.legend.orientation, top.legend.click_policy = "horizontal", "hide"
    top.add_layout(top.legend[0], "above")
    return gridplot(
        [[top], [below]], sizing_mode="stretch_width", toolbar_options={"logo": None}
    )


def _make_source(trace: Trace) -> "ColumnDataSource":
    """The columns that are drawn: time, readings, predictions, and their errors."""
    from bokeh.models import ColumnDataSource

    size = len(trace.time)
    at = np.unique(np.linspace(0, size - 1, min(size, _POINTS)).astype(int))
    columns: dict[str, Floats] = {"measured": trace.read[at]}
    for name in CURVES:
        columns[name] = getattr(trace, name)[at]
        columns[f"{name}_off"] = columns[name] - columns["measured"]
    small = {name: values.astype(np.float32) for name, values in columns.items()}
    return ColumnDataSource({"time": trace.time[at], **small})


def _make_plot(axes: "Axes", height: int) -> "figure":
    """An empty plot with the limits and the label of axes."""
    from bokeh.models import BasicTicker, PlainText, Range1d
    from bokeh.plotting import figure

    low, high = axes.get_ylim()
    plot = figure(
        height=height,
        y_range=Range1d(start=low, end=high),
        active_drag="xbox_zoom",
        tools="xbox_zoom,xwheel_zoom,xpan,reset",
    )
    # a name from a file is no formula
    plot.yaxis.axis_label = PlainText(text=axes.get_ylabel())
    plot.yaxis.minor_tick_line_color = plot.xaxis.minor_tick_line_color = None
    plot.yaxis.ticker = BasicTicker(desired_num_ticks=height // _TICK)
    plot.background_fill_color = plot.border_fill_color = None
    return plot
