"""The page of healing: records of its suites in, docs/results/heal.md out."""

import csv
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.heal.figures import (
    LEG,
    LOWER,
    Records,
    format_named_share,
    format_quantiles,
    is_named,
    list_broken_walks,
    list_delays,
    list_healed_ratios,
    tabulate_targets,
)
from benchmarks.writer import INTACT, Section, publish_results

_COUNTS = (3, 4, 5, 6, 8, 10)  # actions after which naming is looked at


def write_page(root: Path, known: Mapping[str, Records], remarks: str) -> None:
    """Publish the page of all suites of gaits, alarms and healing."""
    sections = [
        Section(
            "What was reached",
            "",
            ("figure", "target", "measured"),
            tabulate_targets(known),
        ),
        _make_real_section(known["real"]),
        _make_gaits_section(known["gaits"]),
        _make_random_gaits_section(known["gaits"]),
        _make_alarms_section(known),
        _make_heals_section(known["heals"]),
        _make_verdicts_section(known["verdicts"], "More verdicts", _MORE),
        _make_verdicts_section(known["worlds"], "Changes of the ground", _GROUND),
        Section("What is not reached, and why", remarks),
    ]
    note = " (timings: one core that other work shared; CPU seconds are of this work)"
    data = {suite: list(records.values()) for suite, records in known.items()}
    publish_results(
        root, "heal", "Gaits, alarms, healing", sections, data, hardware=note
    )


def _make_real_section(real: Records) -> Section:
    """The robot of 2006."""
    rows = [
        (what, how, *(format_named_share(real, chosen, names, n) for n in _COUNTS))
        for what, names in (("right leg", LEG), ("right lower part", LOWER))
        for how, chosen in (("chosen", True), ("random", False))
    ]
    text = (
        "Readings of the physical robot, replayed; actions are chosen or drawn. Named: "
        "the summed probability has passed 0.9 within that many actions. Each reading "
        "is compared with the reading when whole plus the predicted change. Every "
        "other leg passed 0.9 at any time in "
        f"{sum(map(_names_whole_leg, real.values()))} of {len(real)} repeats."
    )
    head = ("named", "actions", *(f"<= {n}" for n in _COUNTS))
    return Section("The damaged robot of 2006", text, head, rows)


def _names_whole_leg(record: Mapping[str, Any]) -> bool:
    """Whether a leg that is whole was ever named."""
    legs = [(f"{leg}_upper", f"{leg}_lower") for leg in ("left", "forward", "back")]
    return any(is_named(record, leg, 10) for leg in legs)


def _make_gaits_section(gaits: Records) -> Section:
    """Synthesized gaits."""
    rows = []
    for key, r in gaits.items():
        if "gait" not in r:
            continue
        along = [f"{w[0]:.2f}" for w in r["walked"]]
        rows.append((key.split()[0], r["gait"], f"{np.degrees(r['heading']):.0f}",
                     f"{r['predicted']:.2f}", ", ".join(along),
                     f"{r['simulations']:,}", r["failed"],
                     f"{r['cpu_seconds']:.0f}"))  # fmt: skip
    head = ("seed", "pattern", "heading [deg]", "predicted [m]", "walked [m]",
            "simulations", "failed", "CPU [s]")  # fmt: skip
    text = (
        "One synthesis a seed, on the true body with rated servos; each gait then "
        "walked once on three hidden robots whose limits, delay, play, masses, "
        "friction and servo zeros are others. Distance along the heading after 10 s."
    )
    return Section("Gaits", text, head, rows)


def _make_random_gaits_section(gaits: Records) -> Section:
    """Random gaits beside those of 2006."""
    rows = []
    file = INTACT.with_name("gaits_2006.csv")
    if file.is_file():
        with file.open() as lines:
            table = [r for r in csv.DictReader(lines) if r["set"] == "physical_random"]
        real = np.array([[float(r["x"]), float(r["y"])] for r in table]) / 1000
        rows.append(("2006, physical, paper A's poses", *_summarize_ends(real)))
    for name, said in (("poses", "hidden robots, paper A's poses"),
                       ("waves", "hidden robots, random waves")):  # fmt: skip
        rows.append((said, *_summarize_ends(np.array(gaits["random"][name]))))
    head = ("30 random gaits", "mean x [mm]", "mean y [mm]", "distance, mean [mm]",
            "its deviation [mm]", "x > 0")  # fmt: skip
    text = (
        "The gaits themselves of 2006 are not published, so distributions are "
        "compared: end of 30 random gaits, uniform in +-70 degrees."
    )
    return Section("Random gaits", text, head, rows)


def _summarize_ends(ends: np.ndarray) -> tuple[str, ...]:
    """Mean, mean distance, deviation and direction of ends (N, 2) [m]."""
    far = 1000 * np.linalg.norm(ends, axis=1)
    x, y = 1000 * ends.mean(axis=0)
    return (f"{x:.0f}", f"{y:.0f}", f"{far.mean():.0f}", f"{far.std(ddof=1):.0f}",
            f"{(ends[:, 0] > 0).sum()} of {len(ends)}")  # fmt: skip


def _make_alarms_section(known: Mapping[str, Records]) -> Section:
    """The monitor."""
    rows = []
    kinds = dict.fromkeys(b["damage"]["kind"] for b in list_broken_walks(known))
    for kind in kinds:
        here = [b for b in list_broken_walks(known) if b["damage"]["kind"] == kind]
        costly = [b for b in here if b["cost"] > 0.2]
        caught = sum(b["delay"] is not None for b in here)
        rows.append((kind, len(here), caught, sum(b["early"] for b in here),
                     sum(b["delay"] is None and not b["early"] for b in costly),
                     format_quantiles(list_delays(here), 0.5, 0.9)))  # fmt: skip
    head = ("kind", "walks", "noticed", "alarm before it", "missed, cost > 20 %",
            "delay, median and 90 % [cycles]")  # fmt: skip
    text = (
        "Hidden robots walk whole (eight walks of 40 s each, 30 s of another to learn "
        "from) and break between 8 and 20 s into a walk of 40 s; walks of the heals "
        "and of the changes of the ground below are in the table too. Cost: share of "
        "the distance along the heading in 10 s that the damage takes, one walk each."
    )
    return Section("Alarms", text, head, rows)


def _make_heals_section(heals: Records) -> Section:
    """Whole heals."""
    rows = []
    for key, r in heals.items():
        rows.append((key, _describe_damage(r["damage"]), _describe_damage(r["found"]),
                     f"{r['found']['probability']:.2f}", r["actions"],
                     *(_format_meters(r[k]) for k in ("intact", "damaged", "healed",
                                               "best_known")),
                     f"{r['length_error']:.2f} / {r['part_error']:.1f}",
                     f"{r['cpu_seconds']:.0f}"))  # fmt: skip
    head = ("seed", "damage", "found", "sure", "actions", "whole [m]", "old gait [m]",
            "healed [m]", "known [m]", "length error, mean / worst part [cm]",
            "CPU [s]")  # fmt: skip
    healed, old, intact = list_healed_ratios(heals)
    wrong = Counter(r["damage"]["kind"] for r in heals.values() if not r["right"])
    far = [format_quantiles(r, 0.1, 0.5, 0.9) for r in (healed, old, intact)]
    kept = [format_quantiles(_list_walked_over_predicted(heals, name), 0.5)
            for name in ("intact", "healed")]  # fmt: skip
    text = (
        "From `identify` on: hidden robots with their own physics, a self-model found "
        "by the default run of 16 actions, a gait, a damage, the alarm, actions, a new "
        "gait. Known is the gait made knowing the true damaged body, by the same "
        "searches and the same trials on the broken robot as the healed one. Over it, "
        f"10th percentile, median, 90th: healed {far[0]}; the old gait on the damaged "
        f"body {far[1]}; the whole robot {far[2]}. Walked over predicted, median: "
        f"whole {kept[0]}, healed {kept[1]}. Wrong kind or part: "
        f"{dict(wrong) or 'none'}."
    )
    return Section("Heals", text, head, rows)


def _list_walked_over_predicted(heals: Records, name: str) -> list[float]:
    """Walked over predicted distance of a heal's gaits."""
    rows = [r for r in heals.values() if r["predicted"]]
    return [r[name] / r["predicted"][name] for r in rows]


def _describe_damage(damage: Mapping[str, Any]) -> str:
    """A damage in words."""
    value = f" {damage['value']:.2f}" if damage["value"] else ""
    words = f"{damage['kind']} {damage['target'].partition(':')[2]}".strip()
    return f"{words}{value}"


def _format_meters(value: float | None) -> str:
    """A distance."""
    return "" if value is None else f"{value:.2f}"


_MORE = (
    "Alarm and actions on further damages of the same robots, without a new gait. A "
    "damage that raises no alarm is not asked for."
)
_GROUND = (
    "Changes of the ground; the body stays whole. Nothing and a change of the ground "
    "both count as told from damage."
)


def _make_verdicts_section(records: Records, title: str, text: str) -> Section:
    """Damages or changes that were found, and not walked with."""
    rows = [
        (
            key,
            _describe_damage(r["damage"]),
            _describe_damage(r["found"]),
            f"{r['found']['probability']:.2f}",
            r["actions"],
            "no" if r["alarm"] is None else "yes",
            _format_meters(r["intact"]),
            _format_meters(r["damaged"]),
            f"{r['part_error']:.1f}",
        )
        for key, r in records.items()
    ]
    head = ("seed", "what happened", "found", "sure", "actions", "alarm", "before [m]",
            "after [m]", "length error of the worst part [cm]")  # fmt: skip
    return Section(title, text, head, rows)
