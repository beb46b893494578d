"""The page of a recovery: fitness over generations, what was believed, the gaits."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Floats
from ..damage.words import describe_damages
from ..engine.reflex import SAMPLE
from ..recovery.phased_run import Phase
from ..recovery.recover_run import (
    METHODS,
    RecoverRun,
    read_hypotheses,
    summarize_beliefs,
)
from .page import Html, Section, make_page, make_paragraph, make_table
from .picture import (
    BLUE,
    COLORS,
    GREEN,
    INK,
    LINE,
    MUTED,
    ORANGE,
    WIDTH,
    draw_paths,
    embed_figure,
    make_plot,
    use_page_style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SHOWN = 5  # hypotheses of each estimation; chosen


def make_recover_page(run: RecoverRun) -> str:
    """The page of a finished recovery."""
    with use_page_style():
        sections = [
            _make_fitness_section(run),
            _make_paths_section(run),
            _make_footfalls_section(run),
        ]
        if any("estimate" in name for name in run.phases):
            sections.insert(1, _make_beliefs_section(run))
    s = run.settings
    title = f"Recovery of the {s.robot}, scenario {s.scenario}"
    return make_page(title, sections, lead=_write_lead(run))


def _write_lead(run: RecoverRun) -> str:
    """All of it in a few sentences."""
    s, spent, d = run.settings, run.result["actions"], run.result["distance"]
    end = ""
    if s.method != "hardware-only":
        last = describe_damages(read_hypotheses(run.estimates[-1])[0])
        end = f" In the end it believes: {last}."
    if run.unlisted:
        end = (
            " No damage in its list explains what it sensed in the trials; the nearest "
            f"is: {last}."
        )
    return (
        f"What happened: {describe_damages(s.damage)}. Method: {s.method} "
        f"({METHODS[s.method]}). "
        f"The robot went {_format_meters(d['intact'])} whole, "
        f"{_format_meters(d['damaged'])} broken "
        f"with its first controller, and {_format_meters(d['healed'])} after "
        f"{spent:,} trial{'s' * (spent != 1)}."
        f"{end}"
    )


def _format_meters(distance: float | None) -> str:
    """A distance in words."""
    return "nowhere that could be measured" if distance is None else f"{distance:.2f} m"


def _list_runs(run: RecoverRun) -> Iterator[tuple[str, Phase]]:
    """Title and phase of each run of the robot."""
    titles = {
        "original": "whole",
        "failure": "broken, the same controller",
        "hardware": "broken, evolved on it",
    }
    for name, phase in run.phases.items():
        if "path" in phase:
            kind, _, turn = name.partition("-")
            yield titles.get(kind, f"trial {turn}"), phase


def _make_fitness_section(run: RecoverRun) -> Section:
    """Best fitness over the generations of all controller searches, and the trials."""
    box = (0.07, 0.16, 0.9, 0.78)
    fig, ax = make_plot(3.2, box, "generation", "forward displacement [m]")
    at, broke = 0, 0
    for name, phase in run.phases.items():
        if "pool" in phase:
            best = phase["best"]
            color = {"original": BLUE, "hardware": ORANGE}.get(name, GREEN)
            ax.plot(at + np.arange(1, len(best) + 1), best, color=color, lw=1.5)
            at += len(best)
        if name == "original":
            broke = at
        if "way" in phase:
            ax.plot(at + 0.5, phase["way"], "o", color=INK, ms=5)
    ax.axvline(broke + 0.5, color=MUTED, lw=0.9, ls=(0, (4, 3)))
    for color, label in (
        (BLUE, "simulated, whole"),
        (GREEN, "simulated, as believed"),
        (ORANGE, "on the broken robot"),
    ):
        ax.plot([], [], color=color, label=label)
    ax.plot([], [], "o", color=INK, ms=5, label="the robot itself")
    ax.legend()
    ax.grid(True)
    caption = (
        "The best controller of each generation; dots are runs of the robot itself. It "
        "broke at the dashed line, where its first controller was run twice: whole and "
        "broken."
    )
    rows = [(title, f"{phase['way']:.2f}") for title, phase in _list_runs(run)]
    head = ("run of the robot, 1,000 steps", "forward [m]")
    return Section(
        "Fitness over the generations",
        (embed_figure(fig, caption), make_table(head, rows, "lr")),
    )


def _make_beliefs_section(run: RecoverRun) -> Section:
    """What was believed after each estimation."""
    rows = []
    for name, phase in run.phases.items():
        if not name.startswith("estimate"):
            continue
        turn = name.partition("-")[2]
        for k, (said, chance) in enumerate(
            list(summarize_beliefs(phase).items())[:_SHOWN]
        ):
            sure = f"{100 * chance:.1f} %" if len(phase["probability"]) > 1 else ""
            rows.append((turn if k == 0 else "", said, sure))
        if phase.get("unlisted"):
            rows.append(("", "no listed damage explains the trials", ""))
        if tried := run.phases.get(f"explore-{turn}"):
            rows.append(("", f"tried then: {tried['why']}", ""))
    true = make_paragraph("What is true: ", describe_damages(run.settings.damage), ".")
    return Section(
        "Damage hypotheses",
        (true, make_table(("before trial", "believed", "sure"), rows, "llr")),
    )


def _make_paths_section(run: RecoverRun) -> Section:
    """The paths of the torso from above."""
    paths = [
        (title, color, *phase["path"].T[:2])
        for (title, phase), color in zip(_list_runs(run), COLORS, strict=False)
    ]
    caption = "Paths of the torso from above, 10 s each; they begin at the black dot."
    return Section("Paths", (draw_paths(paths, "forward", caption),))


def _make_footfalls_section(run: RecoverRun) -> Section:
    """When each lower leg says that it touches the ground."""
    shown = list(_list_runs(run))
    shown = shown[:2] + shown[2:][-1:]  # whole, broken, and what came of it
    return Section("Footfalls", (_draw_footfalls(run, shown),))


def _draw_footfalls(run: RecoverRun, shown: list[tuple[str, Phase]]) -> Html:
    """One diagram below the other."""
    from matplotlib.figure import Figure

    robot = run.settings.legged_robot
    names = [
        s.removesuffix("_lower_touch").replace("_", " ")
        for s in robot.sensors[: robot.feet]
    ]
    fig = Figure(figsize=(WIDTH, 0.6 + len(shown) * 0.24 * (len(names) + 2)))
    axes = fig.subplots(len(shown), 1, squeeze=False, sharex=True)[:, 0]
    fig.subplots_adjust(0.12, 0.5 / fig.get_figheight(), 0.98, 0.95, hspace=0.35)
    for ax, (title, phase) in zip(axes, shown, strict=True):
        _draw_stripes(ax, phase["sensed"][:, : robot.feet], names)
        ax.set_title(title, loc="left", color=INK)
    axes[-1].set_xlabel("time [s]")
    caption = (
        "Dark where a lower leg's touch sensor says that it touches the ground; a dead "
        "sensor says nothing (the thin line), a lost leg touches nothing."
    )
    return embed_figure(fig, caption)


def _draw_stripes(ax: "Axes", touch: Floats, names: list[str]) -> None:
    """A row a foot; touch (T, F) in [-1, 1]."""
    for row, series in enumerate(touch.T):
        ax.axhline(row, color=LINE, lw=0.8, zorder=0)
        down = np.flatnonzero(series > 0.0)
        pieces = [(k * SAMPLE, SAMPLE) for k in down]
        ax.broken_barh(pieces, (row - 0.35, 0.7), color=INK, lw=0)
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.set_xlim(0, len(touch) * SAMPLE)
