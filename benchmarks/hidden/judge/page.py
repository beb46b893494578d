"""The pages: takes judged cases, gives their sections."""

from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from benchmarks.hidden.drafts import KINDS
from benchmarks.hidden.drives import HORIZONS
from benchmarks.hidden.judge import drives
from benchmarks.hidden.judge.sealed import (
    Judged,
    compute_figures,
    compute_median,
    count_confusions,
    select_kind,
)
from benchmarks.writer import Section
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


def _list_figures(figures: Mapping[str, Any]):
    """Header and rows of a table of figures."""
    rows = [
        (name, _format_figure(value), TARGETS.get(name.partition(", ")[0], ""))
        for name, value in figures.items()
    ]
    return ("figure", "value", "target"), rows


def make_sections(cases: Sequence[Judged]) -> list[Section]:
    """All sections of the page of cases with one or two effects."""
    found = compute_figures(cases)
    counts = Counter(c["kind"] for c in cases)
    kinds = ", ".join(f"{n} {kind}" for kind, n in sorted(counts.items()))
    return [
        Section(
            "Figures",
            f"{len(cases)} cases: {kinds}. Shares with their 95 % Wilson interval. The "
            "key of each case was opened after all diagnoses were written.",
            *_list_figures(found),
        ),
        _make_group_section("By robot", cases, lambda c: c["robot"]),
        _make_group_section(
            "By effect",
            select_kind(cases, "single"),
            lambda c: c["truth"][0].split()[0],
        ),
        _make_confusion_section(cases),
        _make_parameters_section(cases),
        _make_wrong_section(cases),
    ]


def _make_group_section(
    title: str, cases: Sequence[Judged], label: Callable
) -> Section:
    header = ("", "exact", "class", "place", "false on null", "unlisted kept", "s")
    groups: dict[str, list[Judged]] = defaultdict(list)
    for case in cases:
        groups[label(case)].append(case)
    return Section(
        title, "", header, [_summarize_group(k, v) for k, v in sorted(groups.items())]
    )


def _summarize_group(name: str, cases: Sequence[Judged]) -> list[str]:
    single, null, odd = (select_kind(cases, k) for k in ("single", "null", "unlisted"))

    def count(some: Sequence[Judged], key: str) -> str:
        return f"{sum(bool(c[key]) for c in some)}/{len(some)}" if some else "-"

    seconds = compute_median([c["run"].get("seconds") for c in cases])
    return [
        name,
        *(count(single, key) for key in ("exact", "class", "place")),
        count(null, "false_name"),
        count(odd, "no_wrong_name"),
        _format_figure(seconds),
    ]


def _make_confusion_section(cases: Sequence[Judged]) -> Section:
    rows = [
        (truth, sum(row.values()), ", ".join(f"{k} {n}" for k, n in row.most_common()))
        for truth, row in sorted(count_confusions(cases).items())
    ]
    text = "What was named first, or the verdict where nothing was named."
    return Section("Confusions", text, ("truth", "n", "first"), rows)


def _make_parameters_section(cases: Sequence[Judged]) -> Section:
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for case in cases:
        for parameter in case.get("covered", ()):
            groups[parameter["parameter"]].append(parameter)
    rows = [
        (
            name,
            format_share(sum(p["inside"] for p in some), len(some)),
            _format_figure(_compute_median_error(some)),
        )
        for name, some in sorted(groups.items())
    ]
    text = "Of effects named exactly, at the right place. Error: |stated/true - 1|."
    return Section("Parameters", text, ("parameter", "covered", "median error"), rows)


def _compute_median_error(parameters: Sequence[dict[str, Any]]) -> float | None:
    return compute_median([p["error"] for p in parameters])


def _make_wrong_section(cases: Sequence[Judged]) -> Section:
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
        if not _went_well(c)
    ]
    return Section("Cases that went wrong", "", header, rows)


def _went_well(case: Judged) -> bool:
    if case["kind"] == "double":
        return case["hits"]["class"] == case["truths"] == case["findings"]
    flag = {"single": "class", "null": "false_name", "unlisted": "no_wrong_name"}
    return bool(case[flag[case["kind"]]]) != (case["kind"] == "null")


# ---------------------------------------------------------------- drives


METHOD = """\
The hidden robots are stepped by code of the benchmark. Episodes that no diagnosis saw
are predicted open loop in pieces of {across}, each from its true state, which is the
same for all models. An error is the contract's: the RMSE over the standard deviation of
the readings. `given` is the model as given, `plain` a fit of
dry friction, viscous friction, rotor and one delay at every driven joint, `true` the
hidden physics; without a diagnosis, `selfheal` is the model as given. An effect has to
be named that removes a tenth of the squared error when added last to all others."""
HEADER = (
    "case",
    "robot",
    "given",
    "plain",
    "selfheal",
    "true",
    "verdict",
    "named",
    "false",
    "s",
)


def make_drive_sections(cases: Sequence[Judged]) -> list[Section]:
    """Sections of the page of drives: each kind's figures and its cases."""
    across = ", ".join(HORIZONS)
    sections = [Section("How it is measured", METHOD.format(across=across))]
    for kind, figures in drives.compute_figures(cases).items():
        text = (KINDS[kind].__doc__ or "").partition("\n")[0]
        sections.append(Section(kind, text, *_list_figures(figures)))
        text = f"Errors over pieces of {across}; (no): they contradict the verdict."
        rows = [_list_case(case) for case in select_kind(cases, kind)]
        sections.append(Section(f"Cases of {kind}", text, HEADER, rows))
    return sections


def _list_case(case: Judged) -> list[str]:
    errors = case["errors"]
    by_model = [
        " ".join(f"{errors[model][name]:.2g}" for name in HORIZONS)
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
