"""Study `diagnose`: diagnoses of many robots or logs, and what differs among them.

A robot is a folder with model.xml and recording.h5, whose diagnosis is written beside
them; or, of a fleet of one model, a recording beside model.xml.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..api import diagnose
from ..diagnosis.output.schema import Finding
from ..errors import InputError
from ..schema import Count, Number
from .plan import (
    JsonObject,
    Outcome,
    Record,
    RunSettings,
    Study,
    StudyRequest,
    Table,
    Task,
    make_task,
)
from .statistics import format_mean_std, format_share, run_homogeneity_test

_COLUMNS = ("given", "refit", "patched", "explainable_removed")
GIVEN = ("model.xml", "recording.h5")  # files of a case
FOUND = "diagnosis"  # folder of its diagnosis, beside them; of a fleet, of them all
MOST_NAMED = 4  # robots that a cell lists; chosen


@dataclass(frozen=True)
class _Settings:
    robot: str
    seed: Count


@dataclass(frozen=True)
class _Fit:
    given: Number | None
    refit: Number | None
    patched: Number | None
    explainable_removed: Number | None


@dataclass(frozen=True)
class _Finding:
    """A finding with its first parameter that is a number, if it has one."""

    effect: str
    target: str
    name: str
    value: Number | None
    low: Number | None
    high: Number | None
    unit: str


@dataclass(frozen=True)
class _Outcome:
    verdict: str
    findings: list[_Finding]
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
        raise InputError(
            f"{folder}: {what}; would fit: folders with {' and '.join(GIVEN)} each, or "
            f"one {GIVEN[0]} with several recordings NAME.h5"
        )
    return found


def _list_robots(folder: Path) -> Iterator[tuple[str, Path, Path, Path]]:
    """Name, model, recording and folder of the diagnosis of each robot."""
    model = folder / GIVEN[0]
    if model.is_file():
        for recording in sorted(folder.glob("*.h5")):
            name = recording.stem
            yield name, model, recording, folder / FOUND / name
    else:
        for case in find_cases(folder):
            yield case.name, case / GIVEN[0], case / GIVEN[1], case / FOUND


def _list_tasks(request: StudyRequest) -> list[Task]:
    if request.cases is None:
        raise InputError(
            "study 'diagnose' needs a FOLDER: of folders with "
            f"{' and '.join(GIVEN)}, or of one {GIVEN[0]} with recordings NAME.h5"
        )
    robots = list(_list_robots(request.cases))
    if not robots:
        raise InputError(f"{request.cases} has {GIVEN[0]} and no recording NAME.h5")
    return [
        make_task(
            {"robot": name, "seed": seed},
            model=str(model),
            recording=str(recording),
            out=str(out),
        )
        for seed in request.seeds
        for name, model, recording, out in robots
    ]


def _run_task(settings: RunSettings) -> Outcome:
    model, recording = settings["model"], settings["recording"]
    found = diagnose(model, recording, seed=settings["seed"])
    Path(settings["out"]).parent.mkdir(exist_ok=True)
    found.save(settings["out"], force=True)
    document = found.document
    return {
        "verdict": document["verdict"],
        "findings": [_shorten_finding(finding) for finding in document["findings"]],
        "fit": {k: document["fit"].get(k) for k in _COLUMNS},
    }


def _shorten_finding(finding: Finding) -> JsonObject:
    """Effect, target, and the first parameter that is a number."""
    scalars = [p for p in finding["parameters"] if not isinstance(p["value"], list)]
    first: JsonObject = dict(scalars[0]) if scalars else {"name": "", "unit": ""}
    keys = ("name", "value", "low", "high", "unit")
    target = {"effect": finding["effect"], "target": finding["target"]}
    return target | {key: first.get(key) for key in keys}


def _make_tables(records: Sequence[Record]) -> list[Table]:
    return [_compare_robots(records), _list_findings(records), _count_verdicts(records)]


def _compare_robots(records: Sequence[Record]) -> Table:
    """A row a robot."""
    rows = []
    for record in records:
        outcome = record["outcome"]
        errors = [_format_number(outcome["fit"][k]) for k in _COLUMNS]
        named = "; ".join(_describe_finding(f) for f in outcome["findings"])
        rows.append((_name(record), outcome["verdict"], *errors, named))
    head = ("robot", "verdict", "given", "refit", "patched", "removed", "findings")
    return Table(
        "Robots",
        "Held-out errors (normalized), the share of the explainable error that was "
        "removed, and what was found.",
        head,
        rows,
    )


def _list_findings(records: Sequence[Record]) -> Table:
    """A row an effect at a place: in which robots, and whether its values differ."""
    robots = list(dict.fromkeys(_name(record) for record in records))
    found: dict[tuple[str, str], dict[str, JsonObject]] = {}
    for record in records:
        for f in record["outcome"]["findings"]:
            found.setdefault((f["effect"], f["target"]), {})[_name(record)] = f
    rows = []
    for (effect, target), by_robot in sorted(
        found.items(), key=lambda item: (-len(item[1]), item[0])
    ):
        without = [robot for robot in robots if robot not in by_robot]
        few = "only " if len(by_robot) <= len(without) else "all but "
        differing = list(by_robot) if len(by_robot) <= len(without) else without
        values = list(by_robot.values())
        which = f"{few}{_shorten_list(differing)}" if differing else "all"
        count = f"{len(by_robot)}/{len(robots)}"
        rows.append((effect, target, count, which, *_compare_values(values)))
    head = ("effect", "where", "robots", "which", "values", "p of one value")
    return Table(
        "What differs among them",
        "Each effect that was found, the robots that have it, and the p-value that all "
        "of these have the same value (Cochran's Q, by their intervals).",
        head,
        rows,
    )


def _compare_values(findings: Sequence[JsonObject]) -> tuple[str, str]:
    """The range of the values of one finding, and the p-value that they are one."""
    known = [f for f in findings if None not in (f["value"], f["low"], f["high"])]
    if not known:
        return "", ""
    values, low, high = (
        np.array([f[k] for f in known], float) for k in ("value", "low", "high")
    )
    unit = f" {known[0]['unit']}".removesuffix(" 1")
    ends = dict.fromkeys(f"{end:.3g}" for end in (values.min(), values.max()))
    said = f"{known[0]['name']} {' to '.join(ends)}{unit}"
    if len(known) == 1:
        return said, ""
    return said, f"{run_homogeneity_test(values, high - low):.2g}"


def _count_verdicts(records: Sequence[Record]) -> Table:
    """A row a verdict."""
    outcomes = [record["outcome"] for record in records]
    counts = Counter(outcome["verdict"] for outcome in outcomes)
    rows = []
    for verdict, count in counts.most_common():
        fits = [o["fit"] for o in outcomes if o["verdict"] == verdict]
        errors = [[fit[k] for fit in fits if fit[k] is not None] for k in _COLUMNS]
        middles = [f"{np.median(e):.3f}" if e else "" for e in errors]
        rows.append((verdict, format_share(count, len(outcomes)), *middles))
    head = ("verdict", "robots (95 %)", "given", "refit", "patched", "removed")
    text = (
        "Medians of the same errors. Seconds a robot: "
        f"{format_mean_std([record['seconds'] for record in records], 0)}."
    )
    return Table("Verdicts", text, head, rows)


def _name(record: Record) -> str:
    """A robot's name; with its seed where that is not the first."""
    settings = record["settings"]
    seed = settings["seed"]
    return f"{settings['robot']} {seed}" if seed else settings["robot"]


def _describe_finding(finding: JsonObject) -> str:
    """An effect, its place and its value."""
    value = finding["value"]
    unit = f" {finding['unit']}".removesuffix(" 1")
    said = "" if value is None else f" {value:.3g}{unit}"
    return f"{finding['effect']} {finding['target']}{said}"


def _format_number(value: float | None) -> str:
    """A number in three digits; empty where there is none."""
    return "" if value is None else f"{value:.3g}"


def _shorten_list(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    more = len(names) - MOST_NAMED
    shown = ", ".join(names[:MOST_NAMED])
    return f"{shown} and {more} more" if more > 0 else shown


STUDY = Study(
    about="Diagnoses of many robots or logs: a model and a recording each.",
    list_tasks=_list_tasks,
    run_task=_run_task,
    make_tables=_make_tables,
    inputs=("cases",),
    settings=_Settings,
    find_outcome=lambda settings: _Outcome,
)
