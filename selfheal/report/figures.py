"""Figures of a run, and of a diagnosis: either in, matplotlib figures out.

All are made inside `picture.style()`.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Bodies, Floats, concatenate_bodies
from ..body.genome import build_bodies
from ..diagnosis.output.result import Localization, Trace
from ..engine.channels import list_channels
from ..selfmodel.prior import compute_prior_cost
from ..selfmodel.run import Cycle, Run
from ..selfmodel.space import find_space
from .draw import (
    NEUTRAL,
    RIGHT,
    WRONG,
    draw_body,
    draw_pale,
    look_from_above,
    look_from_behind,
    measure_window,
    write_numbers,
)
from .facts import choose_channels, find_right_edges, format_thousands, name_action
from .picture import (
    BLUE,
    CURVES,
    INK,
    LINE,
    MUTED,
    ORANGE,
    WIDTH,
    make_canvas,
    shorten_label,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROWS, _COLUMNS = 8, 4  # most cycles, and rivals of each, that are drawn
_MOST_JOINTS = 4  # named beside a cycle; chosen
_TICKS = 9  # most labels on an axis of cycles; chosen
# of words on a map, whose colors are those of the page at no time of day
_BLACK, _WHITE = "#111111", "#fefefe"
_POINTS = 700  # most of a curve that are drawn; chosen
SIGNALS = 16  # most rows of the map; chosen
_CLEAR = 0.01  # p-value below which a cell of the map is framed; chosen


def _make_figure(height: float) -> "Figure":
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height), layout="constrained")


def choose_colors(run: Run, bodies: Bodies, row: int = 0) -> list[str]:
    """The color of each part: right or wrong where the truth is known."""
    right = find_right_edges(run, bodies[row : row + 1])
    if right is None:
        return [NEUTRAL] * run.anatomy.size
    return [RIGHT if r else WRONG for r in right[0]]


def draw_best_body(run: Run) -> "Figure":
    """The best body from above and in perspective, above the truth if it is known.

    Candidates that are a twentieth as likely or more are drawn pale behind it.
    """
    last = run.cycles[-1]
    bodies = build_bodies(run.anatomy, last.genomes[:1])
    space = find_space(run.settings.space)
    costs = last.losses + compute_prior_cost(run.anatomy, space, last.genomes)
    near = 1 + np.flatnonzero(costs[1:] <= costs[0] + np.log(20))
    pale = build_bodies(run.anatomy, last.genomes[near])
    if run.truth is not None:
        bodies = concatenate_bodies(bodies, run.truth)
    views = {
        "from above": look_from_above(bodies),
        "from behind": look_from_behind(bodies),
    }
    every = concatenate_bodies(bodies, pale)
    halves = np.array([measure_window(every, camera) for camera in views.values()])
    # both views as wide as the wider one: what is near looks no larger from behind
    half = halves.max(axis=0)
    head = 0.16 * half[0]  # for a title
    edge = 0.4 * half[0]
    fig, ax = make_canvas(4 * half[0] + 2 * edge, len(bodies) * (2 * half[1] + head))
    for row, name in zip(range(len(bodies)), ("inferred", "truth"), strict=False):
        top = -row * (2 * half[1] + head)
        for column, (view, camera) in enumerate(views.items()):
            at = (edge + (2 * column + 1) * half[0], top - head - half[1])
            aimed, paint = camera.move(*at), choose_colors(run, bodies, row)
            draw_body(ax, bodies[[row]], camera=aimed, colors=paint)
            if column == 0:
                write_numbers(ax, bodies[[row]], aimed, paint)
            if row == 0:
                draw_pale(ax, pale, bodies[[row]], aimed)
            font = {"weight": "bold", "ha": "center", "va": "center"}
            ax.text(at[0], top - head / 2, f"{name}, {view}", font)
    return fig


def choose_cycles(count: int) -> list[int]:
    """Up to `_ROWS` of the cycles 0..count - 1, evenly, with the first and the last."""
    return sorted({round(k) for k in np.linspace(0, count - 1, min(count, _ROWS))})


def draw_candidates(run: Run) -> "Figure":
    """The best rivals of several cycles: a row a cycle, the best first."""
    chosen = choose_cycles(len(run.cycles))
    shown = [run.cycles[k].genomes[:_COLUMNS] for k in chosen]
    batches = [build_bodies(run.anatomy, genomes) for genomes in shown]
    camera = look_from_behind(concatenate_bodies(*batches))
    half = measure_window(concatenate_bodies(*batches), camera)
    side, head = 0.84 * half[0], 0.22 * half[0]  # for cycles and for titles; chosen
    fig, ax = make_canvas(
        side + 2 * _COLUMNS * half[0], len(chosen) * (2 * half[1] + head)
    )
    for line, (k, bodies) in enumerate(zip(chosen, batches, strict=True)):
        top = -line * (2 * half[1] + head)
        _write_row_title(ax, run, k, at=(0.05 * side, top - head - half[1]))
        for row in range(len(bodies)):
            at = (side + (2 * row + 1) * half[0], top - head - half[1])
            paint = choose_colors(run, bodies, row)
            draw_body(ax, bodies[[row]], camera=camera.move(*at), colors=paint)
            title = _format_candidate_title(run, run.cycles[k], bodies, row)
            ax.text(at[0], top - head / 2, title, fontsize=8, ha="center", va="center")
    return fig


def _write_row_title(ax: "Axes", run: Run, k: int, *, at: tuple[float, float]) -> None:
    """A cycle and its action."""
    down = name_action(run, run.cycles[k].action).split(" + ")
    lines = "\n".join(map(shorten_label, down[:_MOST_JOINTS]))
    ax.annotate(f"cycle {k + 1}", at, weight="bold", fontsize=9, va="bottom")
    below = ax.annotate(lines, at, (0, -3), textcoords="offset points", fontsize=7.5)
    below.set(color=MUTED, va="top", linespacing=1.3)


def _format_candidate_title(run: Run, cycle: Cycle, bodies: Bodies, row: int) -> str:
    """What stands above a candidate."""
    title = f"loss {cycle.losses[row]:.3g}"
    right = find_right_edges(run, bodies[row : row + 1])
    if right is not None:
        title += f" \N{MIDDLE DOT} {right.sum()} of {right.size} correct"
    return title


def _set_cycle_ticks(ax: "Axes", run: Run) -> list[int]:
    """Label an axis with cycles, from 1; returns which, from 0."""
    count = len(run.cycles)
    step = -(-count // _TICKS)
    chosen = list(range((count - 1) % step, count, step))  # the last one is among them
    ax.set_xticks([k + 1 for k in chosen])
    ax.set_xlim(0.5, count + 0.5)
    ax.set_xlabel("cycle")
    return chosen


def draw_progress(run: Run) -> "Figure":
    """The error and disagreement after every cycle, simulations along the top."""
    fig, name = _make_figure(2.9), list_channels(run.anatomy).error_name
    curves = {
        f"{name} error of the best candidate [deg]": [c.tilt_error for c in run.cycles],
        "disagreement among the bodies [deg]": [c.disagreement for c in run.cycles],
    }
    cycle = np.arange(1, len(run.cycles) + 1)
    axes = fig.subplots(1, 2, sharex=True)
    paints = (BLUE, ORANGE)
    for ax, (name, curve), color in zip(axes, curves.items(), paints, strict=True):
        ax.plot(cycle, curve, color=color, marker="o", ms=4, lw=1.6, clip_on=False)
        ax.set_title(name, loc="left", weight="bold", pad=9)
        finite = [v for v in curve if np.isfinite(v)]
        ax.set_ylim(0, 1.08 * max([*finite, 0.1]))
        ax.grid(axis="y")
        chosen = _set_cycle_ticks(ax, run)
        top = ax.secondary_xaxis("top")
        top.set_xticks(
            [k + 1 for k in chosen],
            [format_thousands(run.cycles[k].spent) for k in chosen],
        )
        top.tick_params(length=0, labelsize=7.5, labelcolor=MUTED, pad=1)
        top.spines["top"].set_visible(False)
    axes[0].set_xlabel("cycle (small numbers above: simulations so far)")
    return fig


def draw_readings(run: Run) -> "Figure":
    """Two channels of every action tried, and those of the best candidate."""
    known, channels = list_channels(run.anatomy), choose_channels(run, 2)
    tried = [c.action for c in run.cycles]
    measured = np.array([c.felt for c in run.cycles])
    predicted = run.cycles[-1].tables[0][tried]
    fig = _make_figure(0.9 + 0.24 * len(tried))
    axes = fig.subplots(1, len(channels), sharex=True, sharey=True, squeeze=False)[0]
    place = np.arange(len(tried), dtype=float)
    for ax, k in zip(axes, channels, strict=True):
        _draw_pairs(ax, place, measured[:, k], predicted[:, k])
        ax.set_title(f"{known.names[k]} [{known.units[k]}]", loc="left", weight="bold")
    names = [shorten_label(name_action(run, a)) for a in tried]
    axes[0].set_yticks(place, names)
    axes[0].set_ylim(len(tried) - 0.5, -0.5)
    low, high = axes[0].get_xlim()
    axes[0].set_xlim(min(low, -1), max(high, 1))
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return fig


def _draw_pairs(ax: "Axes", place: Floats, measured: Floats, predicted: Floats) -> None:
    """Two dots a line, and what is between them."""
    ax.axvline(0, color=LINE, lw=0.8)
    ax.hlines(place, measured, predicted, color=MUTED, lw=1.2)
    ax.plot(measured, place, "o", color=BLUE, ms=6.5, label="measured")
    (dots,) = ax.plot(predicted, place, "D", ms=4.5, label="predicted")
    dots.set(mfc="none", mec=ORANGE, mew=1.5)
    ax.grid(axis="y")
    ax.tick_params(axis="y", length=0)


def draw_sureness(run: Run) -> "Figure":
    """How sure each attachment was after every cycle."""
    values = np.array([c.sureness for c in run.cycles]).T
    names = [f"{shorten_label(n)}  {i + 1}" for i, n in enumerate(run.anatomy.parts)]
    fig = _make_figure(1.0 + 0.27 * len(names))
    ax = _draw_map(fig, values, names, "cividis", 1.0)
    _set_cycle_ticks(ax, run)
    for (i, k), value in np.ndenumerate(values):
        if np.isfinite(value) and len(run.cycles) <= 24:
            ink = _BLACK if value > 0.5 else _WHITE
            font = {"fontsize": 7.5, "color": ink, "ha": "center", "va": "center"}
            ax.text(k + 1, i + 1, f"{100 * value:.0f}", font)
    _frame_wrong_cells(ax, run)
    return fig


def _draw_map(
    fig: "Figure", values: Floats, names: Sequence[str], colors: str, most: float
) -> "Axes":
    """A map of shares (N, M) of named rows; cell [i, k] is at (k + 1, i + 1).

    Args:
        colors: name of matplotlib's map of colors from 0 to `most`.
    """
    ax = fig.subplots()
    y, x = (np.arange(count + 1) + 0.5 for count in values.shape)
    mesh = ax.pcolormesh(
        x, y, np.ma.masked_invalid(values), cmap=colors, vmin=0, vmax=most
    )
    mesh.set(edgecolors="face", lw=0.3)
    ax.set_yticks(np.arange(len(names)) + 1, names)
    ax.invert_yaxis()
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    bar = fig.colorbar(mesh, ax=ax, pad=0.01, fraction=0.03, format="{x:.0%}")
    bar.outline.set_visible(False)
    return ax


def _frame_wrong_cells(ax: "Axes", run: Run) -> None:
    """Frame the cells in which the best candidate's attachment was wrong."""
    from matplotlib.patches import Rectangle

    for k, cycle in enumerate(run.cycles):
        right = find_right_edges(run, build_bodies(run.anatomy, cycle.genomes[:1]))
        if right is None:
            return
        for i in np.flatnonzero(~right[0]):
            corner = (k + 0.56, i + 0.56)
            frame = Rectangle(corner, 0.88, 0.88, fill=False, ec=WRONG, lw=1.6)
            ax.add_patch(frame)


def draw_traces(chosen: Sequence[Trace]) -> "Figure":
    """Stretches read and predicted, what each prediction is off by below it."""
    columns = min(2, len(chosen))
    rows = -(-len(chosen) // columns)
    fig = _make_figure(0.4 + 2.7 * rows)
    grid = fig.add_gridspec(rows, columns)
    for at, trace in enumerate(chosen):
        inner = grid[at // columns, at % columns].subgridspec(
            2, 1, height_ratios=(3, 1.3)
        )
        top = fig.add_subplot(inner[0])
        _draw_trace(top, fig.add_subplot(inner[1], sharex=top), trace)
    handles = top.get_legend_handles_labels()
    fig.legend(*handles, loc="outside upper right", ncols=4)
    return fig


def _draw_trace(top: "Axes", below: "Axes", trace: Trace) -> None:
    """One stretch, on two axes."""
    size = len(trace.time)
    at = np.unique(np.linspace(0, size - 1, min(size, _POINTS)).astype(int))
    time, read = trace.time[at], trace.read[at]
    dot = "" if trace.episode else "o"
    top.plot(time, read, color=INK, lw=3.4, alpha=0.45, label="measured", marker=dot)
    below.axhline(0, color=LINE, lw=0.8)
    curves = {name: getattr(trace, name)[at] for name in CURVES}
    for name, (color, width) in CURVES.items():
        dash = (0, (4, 2)) if name == "given" else "-"
        for ax, curve in ((top, curves[name]), (below, curves[name] - read)):
            (line,) = ax.plot(time, curve, label=name, marker=dot)
            line.set(color=color, lw=width, ls=dash)
    fitted = [curves["refit"], curves["patched"]]
    # a model that is far off leaves the picture instead of flattening the others
    room = _measure_span(read) or _measure_span(np.concatenate(fitted))
    _limit_axis(top, read, fitted, 0.6 * room)
    _limit_axis(below, 0 * read, [curve - read for curve in fitted], 1.2 * room)
    where = f"episode {shorten_label(trace.episode)}"
    if not trace.episode:
        where = "held-out episodes"
    title = f"{shorten_label(trace.signal)}, {where}"
    top.set_title(title, loc="left", weight="bold")
    top.set_ylabel(shorten_label(trace.unit))
    top.tick_params(labelbottom=False)
    below.set_ylabel("off by", fontsize=8)
    below.set_xlabel("time [s]" if trace.episode else "episode")


def _measure_span(values: Floats) -> float:
    """From the lowest to the highest of the values that are numbers, or 0."""
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if known.size else 0.0


def _limit_axis(
    ax: "Axes", read: Floats, curves: Sequence[Floats], room: float
) -> None:
    """Show all of `read`, and of the curves what is at most `room` away from it."""
    known = read[np.isfinite(read)]
    every = np.concatenate([known, *(curve[np.isfinite(curve)] for curve in curves)])
    if not every.size:
        return
    low, high = (known.min(), known.max()) if known.size else (-np.inf, np.inf)
    bottom, top = max(every.min(), low - room), min(every.max(), high + room)
    margin = 0.06 * (top - bottom) or 1e-9 + 0.01 * abs(top)
    ax.set_ylim(bottom - margin, top + margin)


def draw_error_map(located: Localization) -> "Figure":
    """Where the squared error lies: a row a signal, a column a regime."""
    worst = np.argsort(-np.nan_to_num(located.share).sum(axis=1), kind="stable")
    rows = np.sort(worst[:SIGNALS])
    share, p_value = located.share[rows], located.p_value[rows]
    most = max(0.01, float(np.nan_to_num(share).max()))
    names = [shorten_label(located.signals[i]) for i in rows]
    fig = _make_figure(1.0 + 0.3 * len(rows))
    ax = _draw_map(fig, share, names, "Blues", most)
    regimes = [shorten_label(r.replace("_", " ")) for r in located.regimes]
    ax.set_xticks(np.arange(len(regimes)) + 1, regimes)
    ax.xaxis.tick_top()
    for (i, k), value in np.ndenumerate(share):
        clear, dark = bool(p_value[i, k] < _CLEAR), bool(value > 0.55 * most)
        _draw_cell(ax, (k + 1, i + 1), value, dark=dark, clear=clear)
    return fig


def _draw_cell(
    ax: "Axes", at: tuple[float, float], share: float, *, dark: bool, clear: bool
) -> None:
    """What a cell of the map says, and a frame where that is no accident."""
    from matplotlib.patches import Rectangle

    known = bool(np.isfinite(share))
    ink = (_WHITE if dark else _BLACK) if known else MUTED
    words = f"{100 * share:.0f}" if known else "\N{EN DASH}"
    if known and 0 < share < 0.005:
        words = "<1"
    text = ax.text(*at, words, ha="center", va="center", fontsize=8, color=ink)
    if clear:
        text.set_fontweight("bold")
        corner = (at[0] - 0.46, at[1] - 0.44)
        ax.add_patch(Rectangle(corner, 0.92, 0.88, fill=False, ec=WRONG, lw=1.8))
