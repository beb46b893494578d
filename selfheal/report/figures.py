"""Figures of a self-modeling run: a Run in, matplotlib figures out.

All are made inside `picture.style()`.
"""

from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Bodies, Floats, concatenate
from ..body.genome import build
from ..selfmodel.run import Cycle, Run
from .draw import NEUTRAL, RIGHT, WRONG, draw, from_above, from_behind, window
from .facts import TILT_NAMES, action_name, right_edges, thousands
from .picture import BLUE, LINE, MUTED, ORANGE, WIDTH, canvas, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROWS, _COLUMNS = 8, 4  # most cycles, and rivals of each, that are drawn
_MOST_JOINTS = 4  # named beside a cycle; chosen
_TICKS = 9  # most labels on an axis of cycles; chosen


def _figure(height: float) -> "Figure":
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height), layout="constrained")


def colors(run: Run, bodies: Bodies, row: int = 0) -> list[str]:
    """Of each part: right or wrong where the truth is known."""
    right = right_edges(run, bodies[row : row + 1])
    if right is None:
        return [NEUTRAL] * run.anatomy.size
    return [RIGHT if r else WRONG for r in right[0]]


def best_body(run: Run) -> "Figure":
    """The best body from above and in perspective, above the truth if it is known."""
    bodies = build(run.anatomy, run.cycles[-1].genomes[:1])
    if run.truth is not None:
        bodies = concatenate(bodies, run.truth)
    views = {"from above": from_above(bodies), "from behind": from_behind(bodies)}
    halves = np.array([window(bodies, camera) for camera in views.values()])
    # both views as wide as the wider one: what is near looks no larger from behind
    half = halves.max(axis=0)
    head = 0.16 * half[0]  # for a title
    edge = 0.4 * half[0]
    fig, ax = canvas(4 * half[0] + 2 * edge, len(bodies) * (2 * half[1] + head))
    for row, name in zip(range(len(bodies)), ("inferred", "truth"), strict=False):
        top = -row * (2 * half[1] + head)
        for column, (view, camera) in enumerate(views.items()):
            at = (edge + (2 * column + 1) * half[0], top - head - half[1])
            draw(ax, bodies, row, camera=camera, colors=colors(run, bodies, row),
                 at=at, numbers=column == 0)  # fmt: skip
            ax.text(at[0], top - head / 2, f"{name}, {view}", weight="bold",
                    ha="center", va="center")  # fmt: skip
    return fig


def shown_cycles(count: int) -> list[int]:
    """Up to `_ROWS` of the cycles 0..count - 1, evenly, with the first and the last."""
    return sorted({round(k) for k in np.linspace(0, count - 1, min(count, _ROWS))})


def candidates(run: Run) -> "Figure":
    """The best rivals of several cycles: a row a cycle, the best first."""
    chosen = shown_cycles(len(run.cycles))
    shown = [run.cycles[k].genomes[:_COLUMNS] for k in chosen]
    batches = [build(run.anatomy, genomes) for genomes in shown]
    camera = from_behind(concatenate(*batches))
    half = window(concatenate(*batches), camera)
    side, head = 0.84 * half[0], 0.22 * half[0]  # for cycles and for titles; chosen
    fig, ax = canvas(side + 2 * _COLUMNS * half[0], len(chosen) * (2 * half[1] + head))
    for line, (k, bodies) in enumerate(zip(chosen, batches, strict=True)):
        top = -line * (2 * half[1] + head)
        _row_title(ax, run, k, at=(0.05 * side, top - head - half[1]))
        for row in range(len(bodies)):
            at = (side + (2 * row + 1) * half[0], top - head - half[1])
            paint = colors(run, bodies, row)
            draw(ax, bodies, row, camera=camera, colors=paint, at=at)
            title = _candidate_title(run, run.cycles[k], bodies, row)
            ax.text(at[0], top - head / 2, title, fontsize=8, ha="center", va="center")
    return fig


def _row_title(ax: "Axes", run: Run, k: int, *, at: tuple[float, float]) -> None:
    """A cycle and its action."""
    down = action_name(run, run.cycles[k].action).split(" + ")
    lines = "\n".join(map(label, down[:_MOST_JOINTS]))
    ax.annotate(f"cycle {k + 1}", at, weight="bold", fontsize=9, va="bottom")
    ax.annotate(lines, at, (0, -3), textcoords="offset points", color=MUTED,
                fontsize=7.5, va="top", linespacing=1.3)  # fmt: skip


def _candidate_title(run: Run, cycle: Cycle, bodies: Bodies, row: int) -> str:
    """What stands above a candidate."""
    title = f"loss {cycle.losses[row]:.3g}"
    right = right_edges(run, bodies[row : row + 1])
    if right is not None:
        title += f" \N{MIDDLE DOT} {right.sum()} of {right.size} correct"
    return title


def _cycle_ticks(ax: "Axes", run: Run) -> list[int]:
    """Label an axis with cycles, from 1; returns which, from 0."""
    count = len(run.cycles)
    step = -(-count // _TICKS)
    chosen = list(range((count - 1) % step, count, step))  # the last one is among them
    ax.set_xticks([k + 1 for k in chosen])
    ax.set_xlim(0.5, count + 0.5)
    ax.set_xlabel("cycle")
    return chosen


def progress(run: Run) -> "Figure":
    """Tilt error and disagreement after every cycle, simulations along the top."""
    fig = _figure(2.9)
    curves = {
        "tilt error of the best candidate [deg]": [c.tilt_error for c in run.cycles],
        "disagreement among the rivals [deg]": [c.disagreement for c in run.cycles],
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
        chosen = _cycle_ticks(ax, run)
        top = ax.secondary_xaxis("top")
        top.set_xticks(
            [k + 1 for k in chosen], [thousands(run.cycles[k].spent) for k in chosen]
        )
        top.tick_params(length=0, labelsize=7.5, labelcolor=MUTED, pad=1)
        top.spines["top"].set_visible(False)
    axes[0].set_xlabel("cycle (small numbers above: simulations so far)")
    return fig


def tilts(run: Run) -> "Figure":
    """Measured tilts of every action tried, and those of the best candidate."""
    tried = [c.action for c in run.cycles]
    measured = np.array([c.felt for c in run.cycles])
    predicted = run.cycles[-1].tables[0][tried]
    fig = _figure(0.9 + 0.24 * len(tried))
    axes = fig.subplots(1, 2, sharex=True, sharey=True)
    place = np.arange(len(tried), dtype=float)
    for channel, (ax, name) in enumerate(zip(axes, TILT_NAMES, strict=True)):
        _pairs(ax, place, measured[:, channel], predicted[:, channel])
        ax.set_title(f"{name} tilt [deg]", loc="left", weight="bold")
    names = [label(action_name(run, a)) for a in tried]
    axes[0].set_yticks(place, names)
    axes[0].set_ylim(len(tried) - 0.5, -0.5)
    low, high = axes[0].get_xlim()
    axes[0].set_xlim(min(low, -1), max(high, 1))
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2)
    return fig


def _pairs(ax: "Axes", place: Floats, measured: Floats, predicted: Floats) -> None:
    """Two dots a line, and what is between them."""
    ax.axvline(0, color=LINE, lw=0.8)
    ax.hlines(place, measured, predicted, color=MUTED, lw=1.2)
    ax.plot(measured, place, "o", color=BLUE, ms=6.5, label="measured")
    ax.plot(predicted, place, "D", ms=4.5, mfc="none", mec=ORANGE, mew=1.5,
            label="predicted")  # fmt: skip
    ax.grid(axis="y")
    ax.tick_params(axis="y", length=0)


def sureness(run: Run) -> "Figure":
    """How sure each attachment was after every cycle."""
    values = np.array([c.sureness for c in run.cycles]).T
    parts, count = values.shape
    fig = _figure(1.0 + 0.27 * parts)
    ax = fig.subplots()
    edges = np.arange(count + 1) + 0.5, np.arange(parts + 1) + 0.5
    mesh = ax.pcolormesh(*edges, np.ma.masked_invalid(values), cmap="cividis",
                         vmin=0, vmax=1, edgecolors="face", lw=0.3)  # fmt: skip
    _cycle_ticks(ax, run)
    names = [f"{label(n)}  {i + 1}" for i, n in enumerate(run.anatomy.parts)]
    ax.set_yticks(np.arange(parts) + 1, names)
    ax.invert_yaxis()
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    for (i, k), value in np.ndenumerate(values):
        if np.isfinite(value) and count <= 24:
            ink = "#111111" if value > 0.5 else "#ffffff"
            ax.text(k + 1, i + 1, f"{100 * value:.0f}", ha="center", va="center",
                    fontsize=7.5, color=ink)  # fmt: skip
    _wrong_cells(ax, run)
    bar = fig.colorbar(mesh, ax=ax, pad=0.01, fraction=0.03, format="{x:.0%}")
    bar.outline.set_visible(False)
    return fig


def _wrong_cells(ax: "Axes", run: Run) -> None:
    """Frame the cells in which the best candidate's attachment was wrong."""
    from matplotlib.patches import Rectangle

    for k, cycle in enumerate(run.cycles):
        right = right_edges(run, build(run.anatomy, cycle.genomes[:1]))
        if right is None:
            return
        for i in np.flatnonzero(~right[0]):
            corner = (k + 0.56, i + 0.56)
            frame = Rectangle(corner, 0.88, 0.88, fill=False, ec=WRONG, lw=1.6)
            ax.add_patch(frame)
