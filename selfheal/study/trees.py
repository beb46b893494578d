"""Self-modeling runs as studies do them: settings in, how right a body was, tables out.

Shared by the studies that identify attachment trees, and compare methods.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import isfinite
from pathlib import Path
from typing import Annotated

from pydantic import Field

from ..body.body import compute_edge_f1, measure_center_distance
from ..body.genome import build_bodies
from ..robot.base import Robot
from ..robot.open_robot import open_robot
from ..schema import Count, Number
from ..selfmodel.loop import identify_body
from ..selfmodel.run import Run, Settings
from .calibration import make_reliability_table
from .columns import extract_column
from .plan import Boxes, Outcome, Pairs, Record, RunSettings, Table, select_records
from .statistics import (
    format_pooled_correlation,
    format_rank_correlation,
    run_fisher_test,
    run_permutation_test,
)

REAL, HIDDEN = "starfish-2006", "starfish"
ROBOT_LABELS = {REAL: "real readings", HIDDEN: "hidden robot"}
METHODS = {
    "random-batch": "baseline 1",
    "random-alternate": "baseline 2",
    "paper": "2006 rule",
    "disagreement": "2006, plain disagreement",
    "ours, random": "ours, random actions",
    "ours": "ours",
}
OURS = ("ours", "ours, random")

Series = Annotated[list[Number], Field(min_length=1)]  # a number a cycle


@dataclass(frozen=True)
class TreeSettings:
    """Settings of a run that identifies a tree, as tables read them."""

    robot: str
    method: str


@dataclass(frozen=True)
class TreeOutcome:
    """What `evaluate_identification` gives, as tables read it."""

    success: bool
    error: Series
    disagreement: Series
    edge_f1: Number
    actions: list[Count]
    evaluations: Count
    stated: list[Number]
    right: list[bool]

    def __post_init__(self) -> None:
        """Refuse lists that are not as long as each other."""
        if len(self.error) != len(self.disagreement):
            raise ValueError("with lists error and disagreement of unlike lengths")
        if len(self.stated) != len(self.right):
            raise ValueError("with lists stated and right of unlike lengths")


def open_study_robot(settings: RunSettings, file: str = "intact.h5") -> Robot:
    """The robot of a run: the readings of 2006, or a hidden one of the run's seed."""
    name, seed = settings["robot"], settings["seed"]
    recordings = Path(settings["recordings"]) / file if name == REAL else None
    return open_robot(name, seed=seed, recordings=recordings)


def evaluate_identification(robot: Robot, settings: Settings) -> Outcome:
    """How right a whole run was, in the terms of papers.md 1.6.

    `disagreement` [deg] and `error` [cm] have a number a cycle; `stated` and `right`
    one an attachment.
    """
    *_, run = identify_body(robot, settings)
    truth = robot.truth
    assert truth is not None
    last = run.cycles[-1]
    best = build_bodies(run.anatomy, last.genomes[:1])
    right = best.parent[0] == truth.parent[0]
    return {
        "success": bool(right.all()),
        "error": _measure_errors(run, robot),
        "disagreement": [round(c.disagreement, 4) for c in run.cycles],
        "edge_f1": float(compute_edge_f1(best, truth)[0]),
        "actions": [cycle.action for cycle in run.cycles],
        "evaluations": _count_searched(run.counts),
        "choice": run.counts["choice"],
        "stated": last.sureness.round(4).tolist(),
        "right": right.tolist(),
        "tilt_error": float(run.result["tilt_error"]),
    }


def _measure_errors(run: Run, robot: Robot) -> list[float]:
    """Distance of the best body to the true one after each cycle [cm]."""
    assert robot.truth is not None
    bodies = [build_bodies(run.anatomy, cycle.genomes[:1]) for cycle in run.cycles]
    return [round(float(measure_center_distance(b, robot.truth)[0]), 4) for b in bodies]


def _count_searched(counts: Mapping[str, int]) -> int:
    """Simulations of the search alone: not of choosing, nor of the last check."""
    outside = ("choice", "failed", "mujoco")
    return sum(n for name, n in counts.items() if name not in outside)


def list_statements(records: Sequence[Record]) -> Pairs:
    """What runs said of each attachment: stated probability, whether it is right.

    Part 1 has nothing but the torso as its parent, and is left out; NaN states nothing.
    """
    return [
        pair
        for record in records
        for pair in zip(
            record["outcome"]["stated"][1:], record["outcome"]["right"][1:], strict=True
        )
        if isfinite(pair[0])
    ]


def make_attachment_table(title: str, statements: Pairs) -> Table:
    """Calibration of attachments that our runs stated."""
    text = (
        "Our runs, with chosen and with random actions: the stated probability of each "
        "attachment but part 1's, which cannot be wrong."
    )
    return make_reliability_table(title, text, statements)


def make_correlation_table(
    title: str, rows: Sequence[tuple[str, Sequence[Record]]]
) -> Table:
    """Does disagreement among models tell how wrong they are? Name and runs a row."""
    text = (
        "Spearman's rank correlation of disagreement and the best body's error. "
        "Disagreement: of the bodies that might be right, each counted as far as it is "
        "believed, about the tilts of untried actions. 2006: 0.425, p < 0.02 (n = 30) "
        "at the last cycle. Of the pooled cycles a 95 % interval, of whole runs drawn "
        "again: cycles of one run go together."
    )
    cells = []
    for name, rs in rows:
        last = [extract_column(rs, what) for what in ("disagreement", "error")]
        every = [[r["outcome"][what] for r in rs] for what in ("disagreement", "error")]
        cells.append(
            (name, format_rank_correlation(*last), format_pooled_correlation(*every))
        )
    return Table(title, text, ("runs", "last cycle", "all cycles pooled"), cells)


def run_method(settings: RunSettings, *, cycles: int, budget: int) -> Outcome:
    """A self-modeling by "method" of the settings; attachments are looked for anywhere.

    Args:
        settings: "robot", "method", "seed" and "recordings" of a run.
        budget: simulations of our search; those of 2006 are 15 climbers' in 200
            generations an action.
    """
    method = settings["method"]
    run_settings = Settings(
        settings["robot"],
        method="default" if method in OURS else method,
        random_actions=method == "ours, random",
        engine="statics",
        cycles=cycles,
        budget=budget,
        seed=settings["seed"],
    )
    return evaluate_identification(open_study_robot(settings), run_settings)


def group_by_method(
    records: Sequence[Record], **wanted: str
) -> dict[str, list[Record]]:
    """Method -> its runs with these settings, of methods that have any."""
    found = {m: select_records(records, method=m, **wanted) for m in METHODS}
    return {method: rs for method, rs in found.items() if rs}


def make_error_picture(title: str, found: Mapping[str, Sequence[Record]]) -> Boxes:
    """A box of errors for each method."""
    series = {METHODS[m]: extract_column(rs, "error") for m, rs in found.items()}
    return Boxes(title, series, "error [cm]")


def make_test_table(title: str, found: Mapping[str, Sequence[Record]]) -> Table:
    """Each method against each."""
    rows = []
    wins = {
        m: (int(sum(extract_column(rs, "success"))), len(rs)) for m, rs in found.items()
    }
    errors = {m: extract_column(rs, "error") for m, rs in found.items()}
    for one, other in combinations(found, 2):
        p = (
            run_fisher_test(wins[one], wins[other]),
            run_permutation_test(errors[one], errors[other]),
        )
        rows.append((METHODS[one], METHODS[other], *(f"{each:.2g}" for each in p)))
    text = (
        "p of successes by Fisher's exact test, of errors by a permutation test of the "
        "means (of 9,999 draws: 0.0002 is the least it can say); both two-sided, none "
        "corrected for there being several."
    )
    head = ("method", "against", "successes, p", "errors, p")
    return Table(title, text, head, rows)
