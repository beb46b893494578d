"""The page of a heal: what happened, how it was found, and how the robot walks now."""

from collections.abc import Sequence

import numpy as np

from ..body.body import Bodies, concatenate_bodies
from ..damage.apply import apply_damages
from ..engine.plant import build_rated_plant
from ..engine.walk import SAMPLE
from ..gait.pattern import SECONDS
from ..gait.synthesis import project_on_heading
from ..printable import make_printable
from ..recovery.phased_run import Phase
from ..recovery.phases import describe_belief, read_damage
from ..recovery.record import HealRun, read_gait
from .draw import NEUTRAL, draw_body, look_from_behind, measure_window
from .motion import Lane
from .page import Html, Section, make_page, make_paragraph, make_table
from .picture import (
    BLUE,
    COLORS,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    draw_paths,
    embed_figure,
    make_canvas,
    make_plot,
    place_legend,
    use_page_style,
)
from .render import make_film

_ROWS = round(SECONDS / SAMPLE)
_SAID = 0.01  # of a hypothesis's probability, to be named after an action


def make_heal_page(run: HealRun, models: Bodies) -> str:
    """The page of a finished heal.

    Args:
        models: the self-models (K) that it started from, best first.
    """
    found = run.phases["verdict"]["believed"]
    before = models[[0]]
    after = apply_damages(build_rated_plant(before), read_damage(found[0])).body
    with use_page_style():
        sections = [
            _make_walks_section(run, before, after),
            _make_bodies_section(run, before, after),
            _make_alarm_section(run),
            _make_hypotheses_section(run),
            _make_gaits_section(run),
        ]
    return make_page(
        f"Healing of {run.result['robot']}", sections, lead=_write_lead(run)
    )


def _write_lead(run: HealRun) -> str:
    """All of it in two sentences."""
    distance, alarm = run.result["distance"], run.result["alarm"]
    best = run.phases["verdict"]["believed"][0]
    happened = ", ".join(str(d) for d in run.settings.damage)
    if alarm is None:
        return f"What happened ({happened}) did not change the walk: no alarm."
    count = run.result["actions"]
    noticed = describe_alarm(alarm, run.settings.onset)
    return (
        f"What happened: {happened}. The robot raised an {noticed}, and after {count} "
        f"action{'s' * (count != 1)} said: {read_damage(best)} "
        f"({100 * best['probability']:.0f} % sure). It walked "
        f"{distance['intact']:.2f} m whole, {distance['damaged']:.2f} m broken with "
        f"its old gait, and {distance['healed']:.2f} m with a new one."
    )


def describe_alarm(alarm: Phase, onset: float | None) -> str:
    """When an alarm came, by which sensor, and how long after the damage.

    Args:
        alarm: of a phase or a result; both have the same time.
        onset: of the damage [s]; None where that is said elsewhere.
    """
    said = f"alarm at {alarm['time']:.1f} s by {alarm['sensor'].replace('_', ' ')}"
    if onset is None:
        return said
    late = alarm["time"] - onset
    if late < 0:
        return f"{said}, before anything had happened (a false alarm)"
    return f"{said}, {late:.1f} s after it broke"


def _list_lanes(run: HealRun, before: Bodies, after: Bodies) -> list[Lane]:
    """The three walks."""
    whole, walked = run.phases["whole"], run.phases["walked"]
    keys = ("position", "orientation", "angles")
    old, new = ([walked[f"{n}_{k}"] for k in keys] for n in ("damaged", "healed"))
    return [
        Lane("whole", BLUE, before, *(whole[k][:_ROWS] for k in keys)),
        Lane("broken, with the old gait", ORANGE, after, *old),
        Lane("broken, with the new gait", GREEN, after, *new),
    ]


def _make_walks_section(run: HealRun, before: Bodies, after: Bodies) -> Section:
    """Distances, paths, the animation."""
    lanes, heading = _list_lanes(run, before, after), run.settings.heading
    d, p = run.result["distance"], run.result["predicted"]
    titles = {
        "intact": "whole",
        "damaged": "broken, with the old gait",
        "healed": "broken, with the new gait",
        "best_known": "broken, a gait made knowing the damage",
    }
    rows = [
        (title, _format_meters(d[key]), _format_meters(p[key]) if key in p else "")
        for key, title in titles.items()
    ]
    head = ("walk of 10 s", "walked [m]", "predicted [m]")
    caption = (
        "The three walks as a camera tracked the torso and encoders measured the "
        "joints, shown on the body that the robot believes in; twice as fast as they "
        "were."
    )
    moving = make_film(lanes, heading, caption, sample=SAMPLE)
    paths = [
        (a.title, a.color, *project_on_heading(a.position, heading)) for a in lanes
    ]
    note = "Paths of the torso from above, 10 s each; they begin at the dot."
    drawn = draw_paths(paths, "along the heading", note)
    return Section("Walks", (make_table(head, rows, "lrr"), moving, drawn))


def _format_meters(value: float | None) -> str:
    """A distance in words."""
    return "unknown" if value is None else f"{value:.2f}"


def _make_bodies_section(run: HealRun, before: Bodies, after: Bodies) -> Section:
    """The body before and after."""
    both = concatenate_bodies(before, after)
    camera = look_from_behind(both)
    x, y = measure_window(both, camera)
    fig, ax = make_canvas(4 * x, 2 * y)
    whole = [NEUTRAL] * before.anatomy.size
    draw_body(ax, before, camera=camera.move(x, -y), colors=whole)
    draw_body(
        ax, after, camera=camera.move(3 * x, -y), colors=_choose_colors(run, after)
    )
    for left, title in ((0.05 * x, "before"), (2.05 * x, "after")):
        ax.text(left, -0.08 * y, title, color=INK, fontsize=10)
    caption = "The body that the robot believes in; what the damage touches is orange."
    best = run.phases["verdict"]["believed"][0]
    words = make_paragraph(
        f"It believes: {read_damage(best)}, {100 * best['probability']:.0f} % sure."
    )
    return Section("Body before and after", (words, embed_figure(fig, caption)))


def _choose_colors(run: HealRun, body: Bodies) -> list[str]:
    """A color for each part: orange where the damage is."""
    name = read_damage(run.phases["verdict"]["believed"][0]).name
    a = body.anatomy
    hit = [
        name in (part, joint, f"{joint}_servo", f"{joint}_position", f"{part}_touch")
        for part, joint in zip(a.parts, a.joints, strict=True)
    ]
    return [ORANGE if h else NEUTRAL for h in hit]


def _make_alarm_section(run: HealRun) -> Section:
    """The monitor's sums over time."""
    phase = run.phases["alarm"]
    time, sums, limit = phase["time"], phase["sums"], phase["threshold"]
    fig, ax = make_plot(3.0, (0.07, 0.16, 0.68, 0.78), "time [s]", "misfit [nats]")
    ax.plot(time, sums[:, :-1], color=MUTED, lw=0.7, alpha=0.6)
    ax.plot(time, sums[:, -1], color=BLUE, lw=1.6, label="all channels together")
    ax.plot([], [], color=MUTED, lw=0.7, label="each channel")
    ax.axhline(limit, color=INK, lw=0.9, ls=(0, (4, 3)), label="alarm")
    if time[0] <= run.settings.onset <= time[-1]:
        ax.axvline(run.settings.onset, color=ORANGE, lw=1.2, label="it broke")
    alarm = phase["alarm"]
    if alarm:
        ax.axvline(alarm["time"], color=GREEN, lw=1.2, label="it noticed")
    ax.set_ylim(0, 3 * limit)
    place_legend(ax)
    words = "No sum passed the threshold."
    if alarm:
        words = (
            f"There was an {describe_alarm(alarm, run.settings.onset)}; a whole robot "
            f"would raise one as clear by then with a chance of {alarm['p_value']:.1g}."
        )
    caption = (
        "How badly sensing fits what is predicted, summed up over time (CUSUM). The "
        "threshold keeps false alarms at one an hour of walking. What comes after the "
        "alarm is drawn, but was not waited for."
    )
    return Section("When it noticed", (words, embed_figure(fig, caption)))


def _make_hypotheses_section(run: HealRun) -> Section:
    """Which action ruled out what."""
    actions = run.actions
    if not actions:
        return Section("Damage hypotheses", ("No action was needed.",))
    rows = []
    for k, phase in enumerate(actions, 1):
        believed = [
            describe_belief(b) for b in phase["believed"] if b["probability"] >= _SAID
        ]
        rows.append((str(k), phase["why"], ", ".join(believed)))
    head = ("", "action", "believed after it")
    final = [
        (str(read_damage(b)), _format_percent(b["probability"]))
        for b in run.phases["verdict"]["believed"]
    ]
    end = make_table(("in the end", "sure"), final, "lr")
    taken = make_table(head, rows, "rll")
    return Section("Damage hypotheses", (taken, _draw_beliefs(actions), end))


def _format_percent(share: float) -> str:
    """A probability in words; one that is next to none is not said to be none."""
    return "< 0.1 %" if share < 0.001 else f"{100 * share:.1f} %"


def _draw_beliefs(actions: Sequence[Phase]) -> Html:
    """Probability of the hypotheses that were ever likely, after each action."""
    chances = [
        {(b["kind"], b["target"]): b["probability"] for b in phase["believed"]}
        for phase in actions
    ]
    keys = dict.fromkeys(key for after in chances for key in after)
    # one that is not listed has next to none
    curves = {key: [after.get(key, 0.0) for after in chances] for key in keys}
    top = sorted(keys, key=lambda key: -max(curves[key]))
    fig, ax = make_plot(2.8, (0.07, 0.17, 0.6, 0.78), "actions", "probability")
    steps = np.arange(1, len(chances) + 1)
    for key, color in zip(top[: len(COLORS)], COLORS, strict=False):
        said = " ".join((key[0], key[1].partition(":")[2])).replace("_", " ")
        label = make_printable(said)
        ax.plot(steps, curves[key], "o-", color=color, lw=1.4, ms=4, label=label)
    ax.set_xticks(steps)
    ax.set_ylim(-0.03, 1.03)
    place_legend(ax)
    caption = "How likely each kind and place of damage was after each action."
    return embed_figure(fig, caption)


def _make_gaits_section(run: HealRun) -> Section:
    """The gaits in numbers."""
    rows = []
    for name, title in (("gait", "whole"), ("healed", "healed")):
        gait = read_gait(run.phases[name])
        cells: dict[str, object] = {
            "gait": title,
            "pattern": gait.pattern,
            "cycle [s]": f"{gait.cycle:.2f}",
            "predicted [m]": f"{gait.predicted:.2f}",
            "80 % of robots": f"{gait.low:.2f} to {gait.high:.2f}",
            "simulations": f"{gait.simulations:,}",
            "failed": f"{gait.failed:,}",
            "time [s]": f"{run.phases[name]['seconds']:.0f}",
        }
        rows.append(list(cells.values()))
    kept = "The old gait was kept: no better one was found."
    body = [kept] if run.phases["healed"]["kept"] else []
    return Section("Gaits", (make_table(list(cells), rows, "llrrrrrr"), *body))
