"""Cases of one or two effects scored: takes judged cases, gives figures and tables."""

import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.diagnosis_runs import DOCUMENT, score_diagnosis
from benchmarks.hidden.judge.names import Judged, judge_case, read_places
from selfheal.study.statistics import compute_wilson_interval


def compute_rate(flags: Iterable[bool]) -> Judged:
    """A share of true flags with its 95 % Wilson interval."""
    flags = list(flags)
    return compute_share(sum(map(bool, flags)), len(flags))


def compute_share(hits: int, count: int) -> Judged:
    """So many hits of a count, with the 95 % Wilson interval of their share."""
    if not count:
        return {"hits": 0, "n": 0, "rate": None, "low": None, "high": None}
    low, high = compute_wilson_interval(hits, count)
    return {"hits": hits, "n": count, "rate": hits / count, "low": low, "high": high}


def select_kind(cases: Sequence[Judged], kind: str) -> list[Judged]:
    """The judged cases of one kind."""
    return [c for c in cases if c["kind"] == kind]


def compute_figures(cases: Sequence[Judged]) -> Judged:
    """Every figure of the issue's table."""
    single, null = select_kind(cases, "single"), select_kind(cases, "null")
    odd, double = select_kind(cases, "unlisted"), select_kind(cases, "double")
    covered = [p for c in single + double for p in c["covered"]]
    removed = [c["removed"] for c in single + double if _is_explained(c)]
    return {
        "exact name first": compute_rate(c["exact"] for c in single),
        "name or class first": compute_rate(c["class"] for c in single),
        "joint or body right": compute_rate(c["place"] for c in single),
        "named anywhere": compute_rate(c["listed"] for c in single),
        "singles with a further, wrong name": compute_rate(
            c["extra"] > 0 for c in single
        ),
        "false names on nulls": compute_rate(c["false_name"] for c in null),
        "nulls with verdict nothing": compute_rate(c["quiet"] for c in null),
        "unlisted without a wrong name": compute_rate(c["no_wrong_name"] for c in odd),
        "unlisted, at most a related name and not explained": compute_rate(
            c["related_only"] for c in odd
        ),
        "unlisted noticed": compute_rate(c["noticed"] for c in odd),
        "set F1": {
            k: compute_f1(double, k) for k in ("exact", "class", "class and place")
        },
        "explainable removed, median over explained": compute_median(removed),
        "of what the effect costs on the test, removed, median": compute_median(
            compute_removed_on_test(c)
            for c in single + double
            if c["verdict"] == "explained"
        ),
        "explained with a figure": len([r for r in removed if r is not None]),
        "intervals that hold the truth": compute_rate(p["inside"] for p in covered),
        "parameter error, median": compute_median([p["error"] for p in covered]),
        "failed": compute_rate(c["verdict"] == "failed" for c in cases),
        "seconds": summarize_spread([c["run"].get("seconds") for c in cases]),
        "megabytes": summarize_spread([c["run"].get("megabytes") for c in cases]),
    }


def _is_explained(case: Judged) -> bool:
    return case["verdict"] == "explained" and case["removed"] is not None


def compute_removed_on_test(case: Judged) -> float | None:
    """(stated - patched) / (stated - floor), by `selfheal replay` on the sealed test.

    stated is the score of the true values without the effects, floor that of the truth.
    """
    test, patched = case["test"], case.get("patched")
    stated, floor = test.get("stated"), test.get("floor")
    if None in (stated, floor, patched) or stated - floor < 0.05 * stated:
        return None
    return (stated - patched) / (stated - floor)


def compute_f1(cases: Sequence[Judged], how: str) -> float | None:
    """F1 of all cases' sets taken together; None where there are no sets."""
    total = sum(c["truths"] + c["findings"] for c in cases)
    return 2 * sum(c["hits"][how] for c in cases) / total if total else None


def compute_median(values: Iterable[float | None]) -> float | None:
    """The median of the values that are not None."""
    known = [v for v in values if v is not None]
    return float(np.median(known)) if known else None


def summarize_spread(values: Iterable[float | None]) -> dict[str, float | None]:
    """Median and largest of the values that are not None."""
    known = [v for v in values if v is not None]
    return {"median": compute_median(known), "largest": max(known, default=None)}


def count_confusions(cases: Sequence[Judged]) -> dict[str, Counter[str]]:
    """For each true effect: how often what was named first, or the verdict."""
    rows: dict[str, Counter[str]] = defaultdict(Counter)
    for case in select_kind(cases, "single"):
        rows[case["truth"][0].split()[0]][case["first"]] += 1
    for case in select_kind(cases, "null") + select_kind(cases, "unlisted"):
        truth = case["truth"][0].split()[0] if case["truth"] else "(nothing missing)"
        found = [f.split()[0] for f in case["found"]]
        rows[truth][found[0] if found else case["verdict"]] += 1
    return dict(rows)


def read_case(case: Path, keys: Path, replay: tuple[str, ...] = ()) -> Judged:
    """Judge one case of a folder by its key and its diagnosis, if it has one.

    Args:
        replay: words that start a replay; empty: the test is not replayed.
    """
    key = json.loads((keys / case.name / "key.json").read_text())
    judged = judge_case(key, read_json(case / DOCUMENT), read_places(case))
    run = {k: v for k, v in read_json(case / "run.json").items() if k != "stderr"}
    found = {"case": case.name, **judged, "run": run, "test": key.get("test", {})}
    if replay:
        found["patched"] = score_diagnosis(case, keys / case.name, replay)
    return found


def read_json(file: Path) -> Judged:
    """What a JSON file holds; nothing where there is none."""
    return json.loads(file.read_text()) if file.is_file() else {}
