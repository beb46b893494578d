"""All cases scored: takes judged cases, gives the figures, the tables and the page."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.diagnosis_runs import prove
from benchmarks.sealed.judge import read_case
from benchmarks.writer import Section
from selfheal.study.statistics import share

Judged = dict[str, Any]


def rate(flags: Iterable[bool]) -> dict[str, Any]:
    """A share with its 95 % Wilson interval."""
    flags = list(flags)
    count, hits = len(flags), sum(map(bool, flags))
    if not count:
        return {"hits": 0, "n": 0, "rate": None, "low": None, "high": None}
    low, high = binomtest(hits, count).proportion_ci(method="wilson")
    return {"hits": hits, "n": count, "rate": hits / count, "low": low, "high": high}


def _of(cases: Sequence[Judged], kind: str) -> list[Judged]:
    return [c for c in cases if c["kind"] == kind]


def figures(cases: Sequence[Judged]) -> dict[str, Any]:
    """Every figure of the issue's table.

    Args:
        cases: judged by `read_case`.
    """
    single, null = _of(cases, "single"), _of(cases, "null")
    odd, double = _of(cases, "unlisted"), _of(cases, "double")
    covered = [p for c in single + double for p in c["covered"]]
    removed = [c["removed"] for c in single + double if _explained(c)]
    return {
        "exact name first": rate(c["exact"] for c in single),
        "name or class first": rate(c["class"] for c in single),
        "joint or body right": rate(c["place"] for c in single),
        "named anywhere": rate(c["listed"] for c in single),
        "singles with a further, wrong name": rate(c["extra"] > 0 for c in single),
        "false names on nulls": rate(c["false_name"] for c in null),
        "nulls with verdict nothing": rate(c["quiet"] for c in null),
        "unlisted without a wrong name": rate(c["no_wrong_name"] for c in odd),
        "unlisted, at most a related name and not explained": rate(
            c["related_only"] for c in odd
        ),
        "unlisted noticed": rate(c["noticed"] for c in odd),
        "set F1": {k: f1(double, k) for k in ("exact", "class", "class and place")},
        "explainable removed, median over explained": median(removed),
        "of what the effect costs on the test, removed, median": median(
            removed_on_test(c) for c in single + double if c["verdict"] == "explained"
        ),
        "explained with a figure": len([r for r in removed if r is not None]),
        "intervals that hold the truth": rate(p["inside"] for p in covered),
        "parameter error, median": median([p["error"] for p in covered]),
        "failed": rate(c["verdict"] == "failed" for c in cases),
        "seconds": spread([c["run"].get("seconds") for c in cases]),
        "megabytes": spread([c["run"].get("megabytes") for c in cases]),
    }


def _explained(case: Judged) -> bool:
    return case["verdict"] == "explained" and case["removed"] is not None


def removed_on_test(case: Judged) -> float | None:
    """(stated - patched) / (stated - floor), by `selfheal replay` on the sealed test.

    stated is the score of the true values without the effects, floor that of the truth.
    """
    test, patched = case["test"], case.get("patched")
    stated, floor = test.get("stated"), test.get("floor")
    if None in (stated, floor, patched) or stated - floor < 0.05 * stated:
        return None
    return (stated - patched) / (stated - floor)


def f1(cases: Sequence[Judged], how: str) -> float | None:
    """F1 of all cases' sets taken together."""
    total = sum(c["truths"] + c["findings"] for c in cases)
    return 2 * sum(c["hits"][how] for c in cases) / total if total else None


def median(values: Iterable[float | None]) -> float | None:
    """The median of those that are there."""
    known = [v for v in values if v is not None]
    return float(np.median(known)) if known else None


def spread(values: Iterable[float | None]) -> dict[str, float | None]:
    """Median and largest."""
    known = [v for v in values if v is not None]
    return {"median": median(known), "largest": max(known, default=None)}


def confusion(cases: Sequence[Judged]) -> dict[str, Counter[str]]:
    """First finding (or the verdict, where there is none) by true effect."""
    rows: dict[str, Counter[str]] = defaultdict(Counter)
    for case in _of(cases, "single"):
        rows[case["truth"][0].split()[0]][case["first"]] += 1
    for case in _of(cases, "null") + _of(cases, "unlisted"):
        truth = case["truth"][0].split()[0] if case["truth"] else "(nothing missing)"
        found = [f.split()[0] for f in case["found"]]
        rows[truth][found[0] if found else case["verdict"]] += 1
    return dict(rows)


def read_all(folder: Path, keys: Path, replay: tuple[str, ...] = ()) -> list[Judged]:
    """Every case that has a key, judged.

    Args:
        folder: of the cases.
        keys: of what is concealed.
        replay: words that start a replay; empty: the test is not replayed.
    """
    names = sorted(p.parent.name for p in keys.glob("*/key.json"))
    found = [read_case(folder / n, keys) for n in names if (folder / n).is_dir()]
    for case in found if replay else ():
        name = case["case"]
        case["patched"] = prove(folder / name, keys / name, replay)
    return found


# ---------------------------------------------------------------- the page

TARGETS = {
    "exact name first": ">= 80 %",
    "name or class first": ">= 92 %",
    "joint or body right": ">= 95 %",
    "false names on nulls": "<= 2 of 200",
    "unlisted without a wrong name": ">= 85 %",
    "set F1": ">= 0.75",
    "explainable removed, median over explained": ">= 0.90",
    "intervals that hold the truth": "80 to 97 %",
}


def _text(value: Any) -> str:
    """A figure as the page shows it."""
    if value is None:
        return "-"
    if isinstance(value, dict) and "hits" in value:
        return share(value["hits"], value["n"])
    if isinstance(value, dict):
        return ", ".join(f"{k} {_text(v)}" for k, v in value.items())
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def sections(cases: Sequence[Judged]) -> list[Section]:
    """The page of a scored benchmark."""
    found = figures(cases)
    counts = Counter(c["kind"] for c in cases)
    told = ", ".join(f"{n} {kind}" for kind, n in sorted(counts.items()))
    rows = [(k, _text(v), TARGETS.get(k, "")) for k, v in found.items()]
    return [
        Section(
            "Figures",
            f"{len(cases)} cases: {told}. Shares with their 95 % Wilson interval. The "
            "key of each case was opened after all diagnoses were written.",
            ("figure", "value", "target"),
            rows,
        ),
        _by("By robot", cases, lambda c: c["robot"]),
        _by("By effect", _of(cases, "single"), lambda c: c["truth"][0].split()[0]),
        _confusion_section(cases),
        _parameters(cases),
        _wrong(cases),
    ]


def _by(title: str, cases: Sequence[Judged], label: Callable) -> Section:
    header = ("", "exact", "class", "place", "false on null", "unlisted kept", "s")
    groups: dict[str, list[Judged]] = defaultdict(list)
    for case in cases:
        groups[label(case)].append(case)
    return Section(title, "", header, [_row(k, v) for k, v in sorted(groups.items())])


def _row(name: str, cases: Sequence[Judged]) -> list[str]:
    single, null, odd = (_of(cases, k) for k in ("single", "null", "unlisted"))

    def count(some: Sequence[Judged], key: str) -> str:
        return f"{sum(bool(c[key]) for c in some)}/{len(some)}" if some else "-"

    seconds = median([c["run"].get("seconds") for c in cases])
    return [
        name,
        *(count(single, key) for key in ("exact", "class", "place")),
        count(null, "false_name"),
        count(odd, "no_wrong_name"),
        _text(seconds),
    ]


def _confusion_section(cases: Sequence[Judged]) -> Section:
    rows = [
        (truth, sum(row.values()), ", ".join(f"{k} {n}" for k, n in row.most_common()))
        for truth, row in sorted(confusion(cases).items())
    ]
    text = "What was named first, or the verdict where nothing was named."
    return Section("Confusions", text, ("truth", "n", "first"), rows)


def _parameters(cases: Sequence[Judged]) -> Section:
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for case in cases:
        for parameter in case.get("covered", ()):
            groups[parameter["parameter"]].append(parameter)
    rows = [
        (name, share(sum(p["inside"] for p in some), len(some)), _text(_middle(some)))
        for name, some in sorted(groups.items())
    ]
    text = "Of effects named exactly, at the right place. Error: |stated/true - 1|."
    return Section("Parameters", text, ("parameter", "covered", "median error"), rows)


def _middle(parameters: Sequence[dict[str, Any]]) -> float | None:
    return median([p["error"] for p in parameters])


def _wrong(cases: Sequence[Judged]) -> Section:
    header = ("case", "robot", "truth", "verdict", "found")
    rows = [
        (
            c["case"],
            c["robot"],
            "; ".join(c["truth"]) or "(nothing missing)",
            c["verdict"],
            "; ".join(c["found"]) or "-",
        )
        for c in cases
        if not _good(c)
    ]
    return Section("Cases that went wrong", "", header, rows)


def _good(case: Judged) -> bool:
    if case["kind"] == "double":
        return case["hits"]["class"] == case["truths"] == case["findings"]
    flag = {"single": "class", "null": "false_name", "unlisted": "no_wrong_name"}
    return bool(case[flag[case["kind"]]]) != (case["kind"] == "null")
