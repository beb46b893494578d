"""Tables of the pages: judged cases in, what sealed.md and drives.md show out."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from benchmarks.hidden.drafts import KINDS
from benchmarks.hidden.drives import HORIZONS
from benchmarks.hidden.judge import drives, sealed
from benchmarks.hidden.judge.names import Judged
from benchmarks.hidden.judge.sealed import compute_median, select_kind
from benchmarks.writer import format_hits
from selfheal.study.statistics import format_share

TARGETS = {
    "error / plain": "<= 1.0",
    "error / true": "<= 1.15",
    "effects named": ">= 85 %",
    "false names": "<= 5 %",
    "verdicts that agree with the errors": "100 %",
    "exact name first": ">= 80 %",
    "name or class first": ">= 92 %",
    "joint or body right": ">= 95 %",
    "false names on nulls": "<= 2 of 200",
    "unlisted without a wrong name": ">= 85 %",
    "set F1": ">= 0.75",
    "explainable removed": ">= 0.90",
    "intervals that hold the truth": "80 to 97 %",
}


def _format_figure(value: Any) -> str:
    """A figure as the page shows it."""
    if value is None:
        return "-"
    if isinstance(value, dict) and "hits" in value:
        return format_share(value["hits"], value["n"])
    if isinstance(value, dict):
        return ", ".join(f"{k} {_format_figure(v)}" for k, v in value.items())
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _list_figures(figures: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Figures with their targets."""
    return [
        (name, _format_figure(value), TARGETS.get(name.partition(", ")[0], ""))
        for name, value in figures.items()
    ]


def tabulate_sealed(cases: Sequence[Judged]) -> dict[str, object]:
    """Tables of cases with one or two effects."""
    figures = sealed.compute_figures(cases)
    counts = Counter(c["kind"] for c in cases)
    single = select_kind(cases, "single")
    parameters = [p for c in cases for p in c.get("covered", ())]
    return {
        "figures": figures,
        "cases": cases,
        "kinds": ", ".join(f"{n} {kind}" for kind, n in sorted(counts.items())),
        "shown": _list_figures(figures),
        "by_robot": _summarize_groups(cases, lambda c: c["robot"]),
        "by_effect": _summarize_groups(single, lambda c: c["truth"][0].split()[0]),
        "confusions": {
            truth: (sum(n.values()), ", ".join(f"{k} {i}" for k, i in n.most_common()))
            for truth, n in sorted(sealed.count_confusions(cases).items())
        },
        "parameters": {
            name: (
                format_hits(p["inside"] for p in some),
                _format_figure(compute_median([p["error"] for p in some])),
            )
            for name, some in _group(parameters, lambda p: p["parameter"])
        },
        "wrong": [c for c in cases if not _went_well(c)],
    }


def _group(
    some: Sequence[Judged], label: Callable[[Judged], str]
) -> list[tuple[str, list[Judged]]]:
    """Members by their label, in the order of labels."""
    names = sorted({label(one) for one in some})
    return [(name, [one for one in some if label(one) == name]) for name in names]


def _summarize_groups(
    cases: Sequence[Judged], label: Callable[[Judged], str]
) -> dict[str, list[str]]:
    return {name: _summarize_group(some) for name, some in _group(cases, label)}


def _summarize_group(cases: Sequence[Judged]) -> list[str]:
    def count(kind: str, key: str) -> str:
        some = select_kind(cases, kind)
        return f"{sum(bool(c[key]) for c in some)}/{len(some)}" if some else "-"

    return [
        *(count("single", key) for key in ("exact", "class", "place")),
        count("null", "false_name"),
        count("unlisted", "no_wrong_name"),
        _format_figure(compute_median([c["run"].get("seconds") for c in cases])),
    ]


def _went_well(case: Judged) -> bool:
    if case["kind"] == "double":
        return case["hits"]["class"] == case["truths"] == case["findings"]
    flag = {"single": "class", "null": "false_name", "unlisted": "no_wrong_name"}
    return bool(case[flag[case["kind"]]]) != (case["kind"] == "null")


def tabulate_drives(cases: Sequence[Judged]) -> dict[str, object]:
    """Tables of cases of drives, by kind."""
    figures = drives.compute_figures(cases)
    return {
        "figures": figures,
        "cases": cases,
        "across": ", ".join(HORIZONS),
        "tables": {
            kind: {
                "about": (KINDS[kind].__doc__ or "").partition("\n")[0],
                "shown": _list_figures(of_kind),
                "rows": [_list_case(case) for case in select_kind(cases, kind)],
            }
            for kind, of_kind in figures.items()
        },
    }


def _list_case(case: Judged) -> list[str]:
    by_model = [
        " ".join(f"{case['errors'][model][name]:.2g}" for name in HORIZONS)
        for model in ("given", "plain", "selfheal", "true")
    ]
    return [
        case["case"],
        case["robot"],
        *by_model,
        case["verdict"] + ("" if case["honest"] in (True, None) else " (no)"),
        f"{case['named']}/{case['needed']}",
        f"{len(case['false'])}/{case['names']}",
        _format_figure(case["run"].get("seconds")),
    ]
