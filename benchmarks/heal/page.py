"""Figures of the page of healing: records of its suites in, what page.md shows out."""

import csv
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from benchmarks.suites import Record
from benchmarks.writer import INTACT, format_hits

Known = Mapping[str, Mapping[str, Record]]
COUNTS = (3, 4, 5, 6, 8, 10)  # actions after which naming is looked at
LEG, LOWER = ("right_upper", "right_lower"), ("right_lower",)
COSTLY = 0.2  # share of the distance that a damage takes, which must not be missed


def compute_figures(known: Known) -> dict[str, object]:
    """What the page shows besides the records themselves."""
    heals, gaits = known["heals"], known["gaits"]
    bodies = [*heals.values(), *known["verdicts"].values()]
    broken = _list_broken_walks(known)
    healed = [r for r in heals.values() if r["best_known"]]
    waves = [r for r in gaits.values() if r.get("gait") == "waves"]
    return {
        "counts": COUNTS,
        "bodies": bodies,
        "broken": broken,
        "by_kind": _group_by_kind(broken),
        "missed": [b for b in broken if b["cost"] > COSTLY and _is_missed(b)],
        "named": _tabulate_named_shares(known["real"]),
        "whole_leg_named": sum(map(_names_whole_leg, known["real"].values())),
        "synthesized": {k: r for k, r in gaits.items() if "gait" in r},
        "walked": [w[0] for r in waves for w in r["walked"]],
        "ratios": [w[0] / r["predicted"] for r in waves for w in r["walked"]],
        "random_walked": np.linalg.norm(gaits["random"]["poses"], axis=1).tolist(),
        "ends": _summarize_random_gaits(gaits["random"]),
        "over_known": {
            part: [r[part] / r["best_known"] for r in healed]
            for part in ("healed", "damaged", "intact")
        },
        "over_predicted": {
            part: [r[part] / r["predicted"][part] for r in healed if r["predicted"]]
            for part in ("healed", "intact")
        },
        "wrong": dict(
            Counter(r["damage"]["kind"] for r in heals.values() if not r["right"])
        ),
        "told_apart": [
            *(not _leaves_body_whole(r) for r in bodies),
            *(_leaves_body_whole(r) for r in known["worlds"].values()),
        ],
    }


def _is_named(record: Record, names: Sequence[str], most: int) -> bool:
    """Whether the summed probability of parts passed 0.9 within `most` actions."""
    steps = record["steps"][:most]
    return any(sum(step[n] for n in names) > 0.9 for step in steps)


def _tabulate_named_shares(real: Mapping[str, Record]) -> dict[str, dict[int, str]]:
    """Shares of the repeats that named some parts, by row and count of actions."""
    return {
        f"{what} | {how}": {
            n: format_hits(
                _is_named(r, names, n) for r in real.values() if r["chosen"] is chosen
            )
            for n in COUNTS
        }
        for what, names in (("right leg", LEG), ("right lower part", LOWER))
        for how, chosen in (("chosen", True), ("random", False))
    }


def _names_whole_leg(record: Record) -> bool:
    """Whether a leg that is whole was ever named."""
    legs = [(f"{leg}_upper", f"{leg}_lower") for leg in ("left", "forward", "back")]
    return any(_is_named(record, leg, 10) for leg in legs)


def _summarize_random_gaits(random: Record) -> dict[str, tuple[str, ...]]:
    """Mean, mean distance, deviation and direction of ends of random gaits."""
    found, file = dict[str, np.ndarray](), INTACT.with_name("gaits_2006.csv")
    if file.is_file():
        with file.open() as lines:
            table = [r for r in csv.DictReader(lines) if r["set"] == "physical_random"]
        real = [[float(r["x"]), float(r["y"])] for r in table]
        found["2006, physical, paper A's poses"] = np.array(real) / 1000
    found["hidden robots, paper A's poses"] = np.array(random["poses"])
    found["hidden robots, random waves"] = np.array(random["waves"])
    return {name: _summarize_ends(ends) for name, ends in found.items()}


def _summarize_ends(ends: np.ndarray) -> tuple[str, ...]:
    """Cells of a row, of ends (N, 2) [m]."""
    far = 1000 * np.linalg.norm(ends, axis=1)
    numbers = (*1000 * ends.mean(axis=0), far.mean(), far.std(ddof=1))
    return (*(f"{x:.0f}" for x in numbers), f"{(ends[:, 0] > 0).sum()} of {len(ends)}")


def _list_broken_walks(known: Known) -> list[Record]:
    """Every walk of any suite in which something broke, with its delay and cost."""
    found = [b for r in known["alarms"].values() for b in r["broken"]]
    for suite in ("heals", "verdicts", "worlds"):
        for r in known[suite].values():
            early = r["delay"] is not None and r["delay"] < 0
            delay, cost = None if early else r["delay"], 1 - r["damaged"] / r["intact"]
            broken = {"damage": r["damage"], "early": early}
            found.append({**broken, "delay": delay, "cost": cost})
    return found


def _is_missed(walk: Record) -> bool:
    return walk["delay"] is None and not walk["early"]


def _group_by_kind(broken: Sequence[Record]) -> dict[str, list[Record]]:
    kinds = dict.fromkeys(b["damage"]["kind"] for b in broken)
    return {k: [b for b in broken if b["damage"]["kind"] == k] for k in kinds}


def _leaves_body_whole(found: Record) -> bool:
    """Whether a verdict leaves the body whole: nothing or the ground changed."""
    return bool(found["world"] or found["nothing"])
