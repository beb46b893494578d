"""Study `eea`: the table of 2004, two robots by ten scenarios, as recoveries."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.legged import LEGGED, load_legged_robot
from ..recovery.record import Distances
from ..recovery.recover import recover_robot
from ..recovery.recover_run import RecoverSettings, is_damage_named
from ..robot.scenarios import SCENARIOS, TABLE, draw_scenario
from ..robot.simulated_legs import SimulatedLegs
from ..schema import Count
from .columns import Column, average, count_runs, tabulate
from .plan import (
    Boxes,
    Outcome,
    Picture,
    Record,
    RunSettings,
    Study,
    StudyRequest,
    Table,
    Task,
    make_task,
    select_records,
)
from .statistics import format_mean_std, format_share

RECOVERED_SHARE = 0.9  # of the distance when whole; chosen


@dataclass(frozen=True)
class _Settings:
    robot: str
    scenario: int


@dataclass(frozen=True)
class _Outcome:
    named: bool | None
    actions: Count
    distance: Distances


def _list_tasks(request: StudyRequest) -> list[Task]:
    return [
        make_task({"robot": robot, "scenario": number, "seed": seed})
        for seed in request.seeds
        for robot in LEGGED
        for number in TABLE
    ]


def _run_task(settings: RunSettings) -> Outcome:
    robot, number, seed = (settings[k] for k in ("robot", "scenario", "seed"))
    body = load_legged_robot(robot)
    run_settings = RecoverSettings(
        robot, number, draw_scenario(number, body, seed), seed=seed
    )
    *_, run = recover_robot(SimulatedLegs(body, seed), run_settings)
    kept = ("damage", "hypotheses", "actions", "distance")
    return {"named": is_damage_named(run), **{key: run.result[key] for key in kept}}


def _compute_recovered_share(record: Record) -> float:
    """Share of the distance when whole that was recovered; 0 of none."""
    distance = record["outcome"]["distance"]
    whole = distance["intact"]
    return (distance["healed"] or 0.0) / whole if whole else 0.0


def _average_way(name: str) -> Column:
    """Mean and standard deviation of a distance; 0 where it could not be measured."""
    return lambda rs: format_mean_std(
        [r["outcome"]["distance"][name] or 0.0 for r in rs]
    )


def _share_recovered(rs: Sequence[Record]) -> str:
    """How many recovered."""
    good = [_compute_recovered_share(r) >= RECOVERED_SHARE for r in rs]
    return format_share(sum(good), len(rs))


def _share_named(rs: Sequence[Record]) -> str:
    """How many named the damage, of those that could."""
    named = [r["outcome"]["named"] for r in rs if r["outcome"]["named"] is not None]
    return format_share(sum(named), len(named)) if named else ""


_COLUMNS = {
    "runs": count_runs,
    "whole [m]": _average_way("intact"),
    "broken [m]": _average_way("damaged"),
    "recovered [m]": _average_way("healed"),
    "recovered (95 %)": _share_recovered,
    "named (95 %)": _share_named,
    "trials": average("actions", 1),
}


def _make_tables(records: Sequence[Record]) -> list[Table]:
    groups = [
        ((robot, f"{number}: {SCENARIOS[number]}"), rs)
        for robot in LEGGED
        for number in TABLE
        if (rs := select_records(records, robot=robot, scenario=number))
    ]
    shares = [_compute_recovered_share(r) for r in records]
    text = (
        "Distances after 1,000 steps by our method: whole, broken with the same "
        "controller, and after three trials. Recovered: at least "
        f"{100 * RECOVERED_SHARE:.0f} % of the distance when whole. Named: the "
        "believed damage is of the true kinds and places; not said of hidden neurons, "
        "which no hypothesis has."
    )
    if shares:
        text += (
            f" All: recovered / whole, median {np.median(shares):.2f}, 10th percentile "
            f"{np.percentile(shares, 10):.2f}."
        )
    return [tabulate("Recoveries", text, groups, ("robot", "scenario"), _COLUMNS)]


def _make_pictures(records: Sequence[Record]) -> list[Picture]:
    series = {
        robot: list(map(_compute_recovered_share, rs))
        for robot in LEGGED
        if (rs := select_records(records, robot=robot))
    }
    axis = "distance recovered / distance when whole"
    return [Boxes("How far again", series, axis)] if series else []


STUDY = Study(
    about="The table of 2004: two legged robots, ten scenarios, our recoveries.",
    list_tasks=_list_tasks,
    run_task=_run_task,
    make_tables=_make_tables,
    make_pictures=_make_pictures,
    settings=_Settings,
    find_outcome=lambda settings: _Outcome,
)
