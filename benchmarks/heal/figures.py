"""Figures of the walking suites: takes records, gives the table of targets."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from selfheal.study.statistics import format_share

Records = Mapping[str, Mapping[str, Any]]
Row = tuple[str, str, str]
WATCHED = ("heals", "verdicts", "worlds")  # suites that go by an alarm


def format_quantiles(values: Sequence[float], *at: float) -> str:
    """Quantiles of values as text, "none" where there are no values."""
    if not len(values):
        return "none"
    return ", ".join(f"{q:.2f}" for q in np.quantile(values, at))


def is_named(record: Mapping[str, Any], names: Sequence[str], most: int) -> bool:
    """Whether parts were named: their summed probability has passed 0.9 in time.

    Args:
        record: of a run of suite `real`.
        most: actions within which it must happen.
    """
    steps = record["steps"][:most]
    return any(sum(step[n] for n in names) > 0.9 for step in steps)


LEG, LOWER = ("right_upper", "right_lower"), ("right_lower",)


def format_named_share(
    real: Records, chosen: bool, names: Sequence[str], most: int
) -> str:
    """Share of the repeats of suite `real` that named some parts in time.

    Args:
        chosen: True for chosen actions, False for random ones.
        most: actions within which they must be named.
    """
    rows = [r for r in real.values() if r["chosen"] is chosen]
    return format_share(sum(is_named(r, names, most) for r in rows), len(rows))


def list_walk_ratios(records: Records) -> list[float]:
    """Walked over predicted distance of every walk of pattern `waves`."""
    rows = [r for r in records.values() if r.get("gait") == "waves"]
    return [w[0] / r["predicted"] for r in rows for w in r["walked"]]


def list_healed_ratios(heals: Records) -> tuple[list[float], list[float], list[float]]:
    """Distances healed, damaged and intact, over a gait that knows the damage."""
    rows = [r for r in heals.values() if r["best_known"]]
    parts = ("healed", "damaged", "intact")
    return tuple([r[p] / r["best_known"] for r in rows] for p in parts)  # type: ignore


def list_delays(broken: Sequence[Mapping[str, Any]]) -> list[float]:
    """Delays [cycles] of the alarms that came after their damage."""
    return [b["delay"] for b in broken if b["delay"] is not None]


def list_broken_walks(known: Mapping[str, Records]) -> list[Mapping[str, Any]]:
    """Every walk of any suite in which something broke, with its delay and cost."""
    found = [b for r in known["alarms"].values() for b in r["broken"]]
    for r in (r for suite in WATCHED for r in known[suite].values()):
        early = r["delay"] is not None and r["delay"] < 0
        found.append({"damage": r["damage"], "early": early,
                      "delay": None if early else r["delay"],
                      "cost": 1 - r["damaged"] / r["intact"]})  # fmt: skip
    return found


def leaves_body_whole(found: Mapping[str, Any]) -> bool:
    """Whether a verdict leaves the body whole: nothing or the ground changed."""
    return found["world"] or found["nothing"]


def tabulate_targets(known: Mapping[str, Records]) -> list[Row]:
    """The figures that were to be reached: name, target and what was measured."""
    return [
        *_tabulate_gaits(known["gaits"]),
        *_tabulate_verdicts(known),
        *_tabulate_alarms(known),
        *_tabulate_times(known),
    ]


def _tabulate_gaits(gaits: Records) -> list[Row]:
    """How far gaits of the true body's self-model carry hidden robots."""
    ratios = list_walk_ratios(gaits)
    walked = [w[0] for r in gaits.values() if r.get("gait") == "waves"
              for w in r["walked"]]  # fmt: skip
    random = np.linalg.norm(gaits["random"]["poses"], axis=1)
    return [
        ("walked / predicted on the hidden robot, median", ">= 0.8 (2006: 0.45)",
         f"{format_quantiles(ratios, 0.5)} of {len(ratios)}"),
        ("walked, synthesized : random poses", ">= 4 : 1 (2006: 3 : 1)",
         f"{np.median(walked) / np.mean(random):.1f} : 1"),
    ]  # fmt: skip


def _tabulate_verdicts(known: Mapping[str, Records]) -> list[Row]:
    """How well damage is found, and how far the healed robot walks."""
    real, heals = known["real"], known["heals"]
    bodies = [*heals.values(), *known["verdicts"].values()]
    good = [r for r in bodies if r["right"] and r["actions"] <= 8]
    errors = [r["length_error"] for r in bodies]
    healed, _, _ = list_healed_ratios(heals)
    return [
        ("real robot, right leg named, <= 6 chosen actions", ">= 95 %",
         format_named_share(real, True, LEG, 6)),
        ("the same, <= 4", ">= 95 %", format_named_share(real, True, LEG, 4)),
        ("the same, <= 3", ">= 70 %", format_named_share(real, True, LEG, 3)),
        ("the same, the lower part, <= 10", "named",
         format_named_share(real, True, LOWER, 10)),
        ("hidden damage, part and kind right with <= 8 actions", ">= 85 %",
         format_share(len(good), len(bodies))),
        ("length error, mean over parts, mean over damages", "<= 0.5 cm (2006: 2.17)",
         f"{np.mean(errors):.2f} cm, worst {np.max(errors):.2f}"),
        ("healed / gait made for the true damaged body, median", ">= 0.9",
         f"{format_quantiles(healed, 0.5)} of {len(healed)}"),
        ("the same, 10th percentile", ">= 0.9", format_quantiles(healed, 0.1)),
    ]  # fmt: skip


def _tabulate_alarms(known: Mapping[str, Records]) -> list[Row]:
    """Missed damages, false and late alarms, and changes of the ground."""
    alarms, worlds = known["alarms"], known["worlds"]
    bodies = [*known["heals"].values(), *known["verdicts"].values()]
    broken = list_broken_walks(known)
    costly = [b for b in broken if b["cost"] > 0.2]
    missed = [b for b in costly if b["delay"] is None and not b["early"]]
    delays = list_delays(broken)
    hours = sum(r["seconds"] for r in alarms.values()) / 3600
    false, fallen = (sum(r[k] for r in alarms.values()) for k in ("false", "fallen"))
    damaged = [r for r in bodies if not leaves_body_whole(r)]
    whole = [r for r in worlds.values() if leaves_body_whole(r)]
    return [
        ("missed damages that cost more than 20 %", "0 of 30",
         f"{len(missed)} of {len(costly)}"),
        ("false alarms", "<= 1 an hour",
         f"{false} in {hours:.2f} hours, {fallen} of a whole robot that fell"),
        ("delay of the alarm, median", "<= 2 cycles",
         f"{format_quantiles(delays, 0.5)} cycles of {len(delays)}"),
        ("environment told from body", ">= 85 %",
         format_share(len(damaged) + len(whole), len(bodies) + len(worlds))),
    ]  # fmt: skip


def _tabulate_times(known: Mapping[str, Records]) -> list[Row]:
    """CPU time of a gait and of a heal."""
    synthesis = [r["cpu_seconds"] for r in known["gaits"].values() if "gait" in r]
    whole = [r["cpu_seconds"] for r in known["heals"].values()]
    return [
        ("one gait", "<= 90 s on 2 cores", f"{np.median(synthesis):.0f} s of CPU"),
        ("one heal, its comparison with the known truth included",
         "<= 6 min on 2 cores",
         f"median {np.median(whole):.0f} s, worst {np.max(whole):.0f} s of CPU, of "
         "which about 27 s are the comparison; the first gait is made once for each "
         "robot and adds 22 s"),
    ]  # fmt: skip
