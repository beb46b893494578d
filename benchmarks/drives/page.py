"""The page of the drives: scored cases in, figures and sections out."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.drives.kinds import KINDS
from benchmarks.drives.pieces import HORIZONS
from benchmarks.writer import Section

Scores = Sequence[dict[str, Any]]


def compute_figures(cases: Scores) -> dict[str, Any]:
    """Figures of cases of one kind."""
    figures: dict[str, Any] = {"cases": len(cases)}
    for name in HORIZONS:
        for other in ("plain", "true"):
            ratios = [
                c["errors"]["selfheal"][name] / c["errors"][other][name] for c in cases
            ]
            figures[f"error / {other}, {name}"] = float(np.median(ratios))
    needed, named = (sum(c[key] for c in cases) for key in ("needed", "named"))
    names, false = sum(c["names"] for c in cases), sum(len(c["false"]) for c in cases)
    honest = [c["honest"] for c in cases if c["honest"] is not None]
    figures |= {
        "effects named": [named, needed],
        "false names": [false, names],
        "verdicts that agree with the errors": [sum(honest), len(honest)],
        "without a diagnosis": [sum(not c["replayed"] for c in cases), len(cases)],
        "seconds, median": float(np.median([c["seconds"] for c in cases])),
        "seconds, largest": max(c["seconds"] for c in cases),
    }
    return figures


TARGETS = {
    "error / plain": "<= 1.0",
    "error / true": "<= 1.15",
    "effects named": ">= 85 %",
    "false names": "<= 5 %",
    "verdicts that agree with the errors": "100 %",
}


def _format_value(value: Any) -> str:
    if isinstance(value, list):
        count, whole = value
        return f"{count}/{whole}" + (f" = {100 * count / whole:.0f} %" if whole else "")
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _list_rows(figures: dict[str, Any]) -> Iterable[tuple[str, str, str]]:
    for name, value in figures.items():
        yield name, _format_value(value), TARGETS.get(name.partition(",")[0], "")


def _list_case(case: dict[str, Any]) -> list[str]:
    errors = case["errors"]
    by_model = [
        " ".join(f"{errors[model][name]:.2g}" for name in HORIZONS)
        for model in ("given", "plain", "selfheal", "true")
    ]
    return [
        case["case"],
        f"{case['robot']}, {case['actuators']}, {case['rate']:.0f} Hz",
        *by_model,
        case["verdict"] + ("" if case["honest"] in (True, None) else " (no)"),
        f"{case['named']}/{case['needed']}",
        f"{len(case['false'])}/{case['names']}",
        f"{case['seconds']:.0f}",
    ]


METHOD = """\
The hidden robots are stepped by code of the benchmark. Episodes that no diagnosis saw
are predicted open loop in pieces of {across}, each from a state that is stated, or
estimated from its readings, and is the same for all models. An error is the RMSE over
the standard deviation of the readings. `given` is the model as given, `plain` a fit of
dry friction, viscous friction, rotor and one delay at every driven joint, `true` the
hidden physics; without a diagnosis, `selfheal` is the model as given. An effect has to
be named that removes a tenth of the squared error when added last to all others."""
HEADER = ("case", "robot", "given", "plain", "selfheal", "true", "verdict", "named",
          "false", "s")  # fmt: skip


def make_sections(by_kind: Mapping[str, Scores]) -> list[Section]:
    """Sections of the page: each kind's figures and its cases."""
    across = ", ".join(HORIZONS)
    sections = [Section("How it is measured", METHOD.format(across=across))]
    for kind, cases in by_kind.items():
        text = (KINDS[kind].__doc__ or "").partition("\n")[0]
        rows = list(_list_rows(compute_figures(cases)))
        sections.append(Section(kind, text, ("figure", "value", "target"), rows))
        text = f"Errors over pieces of {across}; (no): they contradict the verdict."
        listed = [_list_case(case) for case in cases]
        sections.append(Section(f"Cases of {kind}", text, HEADER, listed))
    return sections
