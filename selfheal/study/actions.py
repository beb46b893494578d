"""Study `actions`: with few actions, does it pay to choose them, and by which score?"""

from collections.abc import Sequence
from statistics import median

from ..errors import InputError
from .calibration import make_reliability_picture
from .methods import (
    METHODS,
    OURS,
    group_by_method,
    make_error_picture,
    make_test_table,
    run_method,
)
from .plan import (
    Outcome,
    Picture,
    Record,
    RunSettings,
    Study,
    StudyRequest,
    Table,
    Task,
)
from .statistics import format_mean_std, format_share
from .trees import (
    REAL,
    ROBOT_LABELS,
    TreeOutcome,
    TreeSettings,
    extract_column,
    list_statements,
    make_attachment_table,
    make_correlation_table,
)

CYCLES, BUDGET = 8, 80_000  # those of docs/results/identify.md
# the batch of 2006 asks the same as its other baseline: random actions, no score
_METHODS = tuple(method for method in METHODS if method != "random-batch")


def _list_tasks(request: StudyRequest) -> list[Task]:
    if request.recordings is None:
        raise InputError(
            "study 'actions' asks the robot of 2006; give --recordings FOLDER"
        )
    return [
        Task(f"{method} {seed}", {"robot": REAL, "method": method, "seed": seed,
                                  "recordings": str(request.recordings)})
        for seed in request.seeds for method in _METHODS
    ]  # fmt: skip


def _run_task(settings: RunSettings) -> Outcome:
    return run_method(settings, cycles=CYCLES, budget=BUDGET)


def _make_tables(records: Sequence[Record]) -> list[Table]:
    found = group_by_method(records)
    rows = [
        (
            METHODS[method],
            f"{len(rs):,}",
            format_mean_std(extract_column(rs, "evaluations"), 0),
            format_share(sum(extract_column(rs, "success")), len(rs)),
            format_mean_std(extract_column(rs, "error")),
            format_mean_std(extract_column(rs, "edge_f1")),
            f"{median(r['seconds'] for r in rs):.1f}",
        )
        for method, rs in found.items()
    ]
    text = (
        f"{ROBOT_LABELS[REAL].capitalize()}, {CYCLES} actions, attachments looked for "
        "anywhere. Baseline 2 is the search of 2006 with random actions: it, the 2006 "
        "rule and plain disagreement differ in their actions alone, and so do ours "
        "with random actions and ours. Success: every part on its true parent. Error: "
        "mean distance of the parts' centers from the true ones. Evaluations are "
        "simulations of the search, without those for choosing actions. Seconds: "
        "median of a run, on a core that others may have used too."
    )
    head = ("method", "runs", "evaluations", "successes (95 %)",
            "error [cm]", "edge F1", "seconds")  # fmt: skip
    ours = [record for m in OURS for record in found.get(m, ())]
    return [
        Table(f"Chosen against random actions, {CYCLES} of them", text, head, rows),
        make_test_table("Tests", found),
        make_correlation_table(
            "Disagreement and error", [(METHODS[m], rs) for m, rs in found.items()]
        ),
        make_attachment_table("How sure, stated against true", list_statements(ours)),
    ]


def _make_pictures(records: Sequence[Record]) -> list[Picture]:
    found = group_by_method(records)
    boxes = [make_error_picture("Error", found)] if found else []
    stated = {METHODS[m]: list_statements(found.get(m, ())) for m in OURS}
    return [*boxes, make_reliability_picture("How sure, stated against true", stated)]


STUDY = Study(
    about=f"Do chosen actions beat random ones, and by which score? {CYCLES} actions, "
    "the methods of Table 3, the readings of 2006.",
    list_tasks=_list_tasks,
    run_task=_run_task,
    make_tables=_make_tables,
    make_pictures=_make_pictures,
    inputs=("recordings",),
    settings=TreeSettings,
    find_outcome=lambda settings: TreeOutcome,
)
