"""The page of hours of walking and healing: what broke when, and how far it came."""

import numpy as np

from ..body.body import Bodies
from ..damage.apply import apply_damages
from ..engine.plant import build_rated_plant
from ..engine.walk import SAMPLE
from ..gait.pattern import SECONDS
from ..recovery.hours import list_believed, list_first_speeds, list_walks
from ..recovery.phased_run import Phase
from ..recovery.phases import read_damage
from ..recovery.record import HealRun
from .facts import format_percent
from .heal import describe_alarm
from .motion import Lane
from .page import Section, make_page, make_paragraph, make_table
from .picture import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    embed_figure,
    make_plot,
    place_legend,
    use_page_style,
)
from .render import make_film

_MOST_LANES = 8  # of the film, each about 0.15 MB and 2 s; chosen
EVENT_HEAD = (
    "struck",
    "what happened",
    "alarm",
    "after",
    "believed",
    "before",
    "damaged",
    "healed",
    "kept",
    "first gait",
)


def make_hours_page(run: HealRun, models: Bodies) -> str:
    """The page of finished hours.

    Args:
        models: the self-models (K) that it started from, best first.
    """
    head = make_paragraph(
        "Speeds along the heading in m/min, of walks of 10 s from rest: before the "
        "damage, after it with the same gait, with the gait found for it. Kept: the "
        "share of the whole robot's speed; first gait: that share had it kept the gait "
        "that it began with. An alarm is for the last damage before it."
    )
    table = make_table(EVENT_HEAD, format_events(run.result), "rlrrlrrrrr")
    with use_page_style():
        sections = [
            Section("What happened", (table, head)),
            Section("Speed", (_draw_speeds(run),)),
            Section("Walks", (_make_walks(run, models),)),
        ]
    title = f"{run.result['hours']:.2f} hours of {run.result['robot']}"
    return make_page(title, sections, lead=describe_hours(run.result))


def describe_hours(result: Phase) -> str:
    """All of it in a few sentences."""
    events = result["events"]
    struck = [event for event in events if event["damage"]]
    noticed = [event for event in struck if event["alarm"]]
    right, false = sum(e["right"] for e in noticed), result["false_alarms"]
    return (
        f"It walked {result['distance']:.1f} m in {result['hours']:.2f} hours, "
        f"{format_percent(result['kept'])} of what it would have walked whole; with "
        f"its first gait it would have kept {format_percent(result['kept_first'])}. Of "
        f"{len(struck)} damage{'s' * (len(struck) != 1)} it noticed {len(noticed)} and "
        f"named {right} rightly; "
        f"{false} false alarm{'s' * (false != 1)}."
    )


def format_events(result: Phase) -> list[tuple[str, ...]]:
    """Rows of the table of damages and alarms; see `EVENT_HEAD`."""
    return [_format_event(event, result["intact"]) for event in result["events"]]


def _format_event(event: Phase, intact: float) -> tuple[str, ...]:
    """A row of the table, with the whole robot's speed [m/min]."""
    alarm, believed, delay = event["alarm"], event["believed"], event["delay"]
    happened = read_damage(event["damage"]) if event["damage"] else "nothing"
    said = ""
    if believed:
        wrong = "" if event["right"] else ", wrong"
        sure = format_percent(believed["probability"])
        said = f"{read_damage(believed)} ({sure}{wrong})"
    speeds = [event[key] for key in ("before", "damaged", "healed")]
    shares = [event[key] for key in ("healed", "first")]
    return (
        f"{event['time']:.1f} s" if event["damage"] else "",
        str(happened),
        f"{alarm['time']:.1f} s" if alarm else "none",
        "" if delay is None else f"{delay:.1f} s",
        said,
        *("" if v is None else f"{v:.2f}" for v in speeds),
        *("" if v is None else format_percent(v / intact) for v in shares),
    )


def _draw_speeds(run: HealRun) -> str:
    """Speed of each walk over time, damages and alarms."""
    box = (0.07, 0.16, 0.72, 0.78)
    fig, ax = make_plot(3.2, box, "time [min]", "speed [m/min]")
    walks = list_walks(run)
    for start, seconds, distance in walks:
        ends = np.array([start, start + seconds]) / 60
        ax.plot(ends, [60 * distance / seconds] * 2, color=BLUE, lw=2)
    end = sum(walks[-1][:2])
    times, speeds = np.array([*list_first_speeds(run), (end, np.nan)]).T
    ax.plot([], [], color=BLUE, lw=2, label="each walk")
    (steps,) = ax.step(times / 60, [*speeds[:-1], speeds[-2]], where="post")
    steps.set(color=MUTED, lw=1.0, ls=(0, (4, 3)), label="with the first gait")
    for event in run.result["events"]:
        if event["damage"]:
            ax.axvline(event["time"] / 60, color=ORANGE, lw=1.0)
        if event["alarm"]:
            at = event["alarm"]["time"] / 60
            ax.plot(at, 0, "^", color=GREEN if event["damage"] else INK, ms=6)
    ax.plot([], [], color=ORANGE, lw=1.0, label="damage")
    ax.plot([], [], "^", color=GREEN, ms=6, label="alarm")
    ax.plot([], [], "^", color=INK, ms=6, label="false alarm")
    place_legend(ax)
    caption = (
        "Mean speed of each walk along the heading, as the robot faces at each 10 s "
        "anew. Time stands still while "
        "the robot acts to find out what happened, and while it makes a gait."
    )
    return embed_figure(fig, caption)


def _make_walks(run: HealRun, models: Bodies) -> str:
    """The film: whole, after each new gait, and the first gait at the end."""
    heals, plant = run.heals, build_rated_plant(models[[0]])
    keys, whole = ("position", "orientation", "angles"), heals[0].phases["whole"]
    rows = round(SECONDS / SAMPLE)
    lanes = [Lane("whole", BLUE, plant.body, *(whole[key][:rows] for key in keys))]
    done = [k for k, heal in enumerate(heals) if "first" in heal.phases]
    for k in [k for k in done if not heals[k].phases["healed"]["kept"]]:
        walked, alarm = (heals[k].phases[name] for name in ("walked", "alarm"))
        believed = list_believed(heals[: k + 1])
        body = apply_damages(plant, *believed).body
        paths = (walked[f"healed_{key}"] for key in keys)
        title = f"{describe_alarm(alarm['alarm'], None)}: {believed[-1]}"
        lanes.append(Lane(title, GREEN, body, *paths))
    if done:
        first = heals[done[-1]].phases["first"]
        body = apply_damages(plant, *list_believed([heals[k] for k in done])).body
        title, paths = "at the end, with its first gait", (first[key] for key in keys)
        lanes = [*lanes[: _MOST_LANES - 1], Lane(title, ORANGE, body, *paths)]
    caption = (
        "Walks of 10 s as a camera tracked the torso and encoders measured the joints, "
        "shown on the body that the robot believes in; twice as fast as they were."
    )
    return make_film(lanes, run.settings.heading, caption, sample=SAMPLE)
