"""Study `actions`: with few actions, does it pay to choose them, and by which score?"""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

from ..errors import InputError
from .calibration import diagram, reliability
from .methods import METHODS, OURS, by_method, played, tests
from .plan import Asked, Outcome, Picture, Record, Study, Table, Task
from .statistics import share, spread
from .trees import REAL, WHERE, column, gauge, statements

CYCLES, BUDGET = 8, 80_000  # those of docs/results/identify-few-actions.md
# the batch of 2006 asks the same as its other baseline: random actions, no score
_METHODS = tuple(method for method in METHODS if method != "random-batch")


def _tasks(asked: Asked) -> list[Task]:
    if asked.recordings is None:
        raise InputError(
            "study 'actions' asks the robot of 2006; give --recordings FOLDER"
        )
    return [
        Task(f"{method} {seed}", {"robot": REAL, "method": method, "seed": seed,
                                  "recordings": str(asked.recordings)})
        for seed in asked.seeds for method in _METHODS
    ]  # fmt: skip


def _play(settings: Mapping[str, Any]) -> Outcome:
    return played(settings, cycles=CYCLES, budget=BUDGET)


def _tables(records: Sequence[Record]) -> list[Table]:
    found = by_method(records)
    rows = [
        (METHODS[method], f"{len(rs):,}", spread(column(rs, "evaluations"), 0),
         share(sum(column(rs, "success")), len(rs)), spread(column(rs, "error")),
         spread(column(rs, "edge_f1")), f"{median(r['seconds'] for r in rs):.1f}")
        for method, rs in found.items()
    ]  # fmt: skip
    text = (
        f"{WHERE[REAL].capitalize()}, {CYCLES} actions, attachments looked for "
        "anywhere. Baseline 2 is the search of 2006 with random actions: it, the 2006 "
        "rule and plain disagreement differ in their actions alone, and so do ours "
        "with random actions and ours. Success: every part on its true parent. Error: "
        "mean distance of the parts' centers from the true ones. Evaluations are "
        "simulations of the search, without those for choosing actions. Seconds: "
        "median of a run, on a core that others may have used too."
    )
    head = ("method", "runs", "evaluations", "successes (95 %)",
            "error [cm]", "edge F1", "seconds")  # fmt: skip
    told = (
        "Our runs, with chosen and with random actions: the stated probability of each "
        "attachment but part 1's, which cannot be wrong."
    )
    ours = [record for m in OURS for record in found.get(m, ())]
    return [
        Table(f"Chosen against random actions, {CYCLES} of them", text, head, rows),
        tests("Tests", found),
        gauge("Disagreement and error", [(METHODS[m], rs) for m, rs in found.items()]),
        reliability("How sure, stated against true", told, statements(ours)),
    ]


def _pictures(records: Sequence[Record]) -> list[Picture]:
    found = by_method(records)
    errors = {METHODS[m]: column(rs, "error") for m, rs in found.items()}
    boxes = [Picture("Error", "box", errors, "error [cm]")] if errors else []
    told = {METHODS[m]: statements(found.get(m, ())) for m in OURS}
    return [*boxes, diagram("How sure, stated against true", told)]


STUDY = Study(
    about=f"Do chosen actions beat random ones, and by which score? {CYCLES} actions, "
    "the methods of Table 3, the readings of 2006.",
    tasks=_tasks,
    play=_play,
    tables=_tables,
    pictures=_pictures,
    given=("recordings",),
)
