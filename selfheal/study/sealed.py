"""Study `sealed`: diagnoses of a folder of cases, whose truth it is not told.

A case is a folder with model.xml and recording.h5; its diagnosis is written beside
them. Who has the keys scores them: `python -m benchmarks.sealed` makes and scores such.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..api import diagnose
from ..errors import InputError
from ..schema import Number
from .plan import Outcome, Record, Study, StudyRequest, Table, Task
from .statistics import format_mean_std, format_share

_COLUMNS = ("given", "refit", "patched", "explainable_removed")
GIVEN = ("model.xml", "recording.h5")  # files of a case
FOUND = "diagnosis"  # folder of its diagnosis, beside them


@dataclass(frozen=True)
class _Fit:
    given: Number | None
    refit: Number | None
    patched: Number | None
    explainable_removed: Number | None


@dataclass(frozen=True)
class _Outcome:
    verdict: str
    named: list[tuple[str, str]]
    fit: _Fit


def find_cases(folder: Path) -> list[Path]:
    """The cases of a folder, by name: its folders with a model and a recording.

    Raises:
        InputError: there is no case, or one lacks its recording.
    """
    found = sorted(file.parent for file in folder.glob(f"*/{GIVEN[0]}"))
    lacking = [case for case in found if not (case / GIVEN[1]).is_file()]
    if lacking or not found:
        what = f"{lacking[0]} has no {GIVEN[1]}" if lacking else "no case there"
        raise InputError(f"--cases {folder}: {what}")
    return found


def _list_tasks(asked: StudyRequest) -> list[Task]:
    if asked.cases is None:
        raise InputError(
            "study 'sealed' needs --cases FOLDER, of folders with "
            f"{' and '.join(GIVEN)}"
        )
    found = find_cases(asked.cases)
    return [
        Task(f"{case.name} {seed}", {"case": str(case), "seed": seed})
        for seed in asked.seeds for case in found
    ]  # fmt: skip


def _run_task(settings: Mapping[str, Any]) -> Outcome:
    case = Path(settings["case"])
    found = diagnose(*(case / name for name in GIVEN), seed=settings["seed"])
    found.save(case / FOUND, force=True)
    told = found.document
    return {
        "verdict": told["verdict"],
        "named": [[f["effect"], f["target"]] for f in told["findings"]],
        "fit": {k: v for k, v in told["fit"].items() if k != "held_out"},
    }


def _make_tables(records: Sequence[Record]) -> list[Table]:
    outcomes = [record["outcome"] for record in records]
    counts = Counter(outcome["verdict"] for outcome in outcomes)
    rows = []
    for verdict, count in counts.most_common():
        fits = [o["fit"] for o in outcomes if o["verdict"] == verdict]
        errors = [[fit[k] for fit in fits if fit[k] is not None] for k in _COLUMNS]
        middles = [f"{np.median(e):.3f}" if e else "" for e in errors]
        rows.append((verdict, format_share(count, len(outcomes)), *middles))
    head = ("verdict", "cases (95 %)", "given", "refit", "patched", "removed")
    text = (
        "Held-out errors (normalized) and explainable error removed, medians. Whether "
        "what was named is true is not known here: `python -m benchmarks.sealed score` "
        f"tells it who has the keys. Seconds a case: "
        f"{format_mean_std([record['seconds'] for record in records], 0)}."
    )
    effects = Counter(effect for o in outcomes for effect, _ in o["named"])
    named = [(effect, f"{count:,}") for effect, count in effects.most_common()]
    return [
        Table("Verdicts", text, head, rows),
        Table("Effects that were named", "In all cases.", ("effect", "times"), named),
    ]


STUDY = Study(
    about="Sealed cases of diagnose: a model and a recording each.",
    list_tasks=_list_tasks,
    run_task=_run_task,
    make_tables=_make_tables,
    inputs=("cases",),
    find_outcome=lambda settings: _Outcome,
)
