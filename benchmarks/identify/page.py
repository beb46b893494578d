"""Tables of identification runs: records in, sections of a page out."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.identify.outcome import NEAR, explain_inexact_run, explain_likeness
from benchmarks.identify.suites import SuiteRow
from benchmarks.writer import Section
from selfheal.selfmodel.explore import DISTINGUISHABLE
from selfheal.study.statistics import format_share, run_fisher_test

Records = Sequence[dict[str, Any]]
_PAPER_RUNS = 30  # runs of each regime in the paper
_BINS, _ENOUGH, _POINTS = 10, 50, 0.1  # the issue's: bins, statements, tolerance


def make_sections(
    rows: list[SuiteRow], records: Mapping[str, Records], jobs: int
) -> list[Section]:
    """All sections of a suite's page.

    Args:
        records: finished runs by the name of their row.
        jobs: how many ran at a time.
    """
    ours = [r for row in rows if row.settings.method == "default"
            for r in records[row.name]]  # fmt: skip
    found = [_make_success_section(rows, records, jobs)]
    if any(row.rivals or row.paper is not None for row in rows):
        found.append(_make_tests_section(rows, records))
    if ours:
        found += [
            make_calibration_section(ours, "All runs of this suite."),
            _make_inexact_section(ours),
        ]
    return found


def _count_exact(records: Records) -> int:
    """How many runs ended at the true tree."""
    return sum(r["exact"] for r in records)


def _make_success_section(
    rows: list[SuiteRow], records: Mapping[str, Records], jobs: int
) -> Section:
    """How often the true tree was found."""
    lines = []
    for row in rows:
        found, s = records[row.name], row.settings
        good = sum(r["exact"] or bool(explain_likeness(r)) for r in found)
        spent = [sum(_list_search_simulations(r)) for r in found]
        beside = [r["simulations"]["choice"] for r in found]
        middle = np.median([[r["tilt_error"], r["seconds"]] for r in found], axis=0)
        lines.append(
            [
                row.name,
                Path(s.robot).stem,
                s.method,
                s.cycles,
                found[0]["settings"]["engine"],
                format_share(_count_exact(found), len(found)),
                format_share(good, len(found)),
                row.target,
                f"{np.mean([r['edge_f1'] for r in found]):.2f}",
                f"{np.mean([r['axes'] for r in found]):.1f}",
                f"{middle[0]:.2f}",
                f"{np.mean(spent):,.0f}",
                f"{np.mean(beside):,.0f}",
                f"{middle[1]:.1f}",
            ]
        )
    seeds = [r["settings"]["seed"] for found in records.values() for r in found]
    text = (
        f"Seeds from {min(seeds)} (none of these was used in development); 95 % "
        "Wilson intervals. Exact: every part on its true parent. Or like it: exact, or "
        f"the parts' centers lie within {10 * NEAR:g} mm on average (not where hinges "
        "are unknown), or none of the robot's actions tells it from the truth by more "
        f"than {DISTINGUISHABLE:g} degree or {2 * DISTINGUISHABLE:g} mm, or as much of "
        "another sensor as counts like it, by statics. "
        "Tilt error is `mujoco`'s, over the actions tried [deg]; simulations are those "
        "of the search and, apart, those spent on what else might be right, for "
        "choosing "
        f"actions; means. Seconds are a run's while {jobs} ran at a time; medians."
    )
    header = ["row", "robot", "method", "actions", "engine", "exact", "or like it",
              "target (exact)", "edge F1", "right hinge axes", "tilt error",
              "simulations", "for choice", "seconds"]  # fmt: skip
    return Section("Success", text, header, lines)


def _list_search_simulations(record: dict[str, Any]) -> list[int]:
    """Simulations by engine, without those for choice and the final check."""
    outside = ("choice", "failed", "mujoco")
    return [n for name, n in record["simulations"].items() if name not in outside]


def _make_tests_section(
    rows: list[SuiteRow], records: Mapping[str, Records]
) -> Section:
    """Fisher's exact tests of the comparisons that a suite is for."""
    counts = {
        name: (_count_exact(found), len(found)) for name, found in records.items()
    }
    lines = []
    for row in rows:
        own = counts[row.name]
        if row.paper is not None:
            paper = (row.paper, _PAPER_RUNS)
            lines.append(_compare_shares(row.name, own, "the paper", paper))
        for rival in row.rivals:
            lines.append(_compare_shares(row.name, own, rival, counts[rival]))
    header = ["row", "exact", "against", "exact", "p"]
    return Section("Tests", "Fisher's exact test, two-sided.", header, lines)


def _compare_shares(name: str, own: tuple, other: str, its: tuple) -> list[str]:
    """A line of a test of two shares, each (successes, count)."""
    p = run_fisher_test(own, its)
    return [name, f"{own[0]}/{own[1]}", other, f"{its[0]}/{its[1]}", f"{p:.2g}"]


def make_calibration_section(records: Records, source: str) -> Section:
    """Stated probability of each attachment against how often it was right, in bins."""
    stated = np.array([x for r in records for x in r["stated"]])
    right = np.array([x for r in records for x in r["right"]])
    place = np.minimum((stated * _BINS).astype(int), _BINS - 1)
    rows = []
    for k in range(_BINS):
        inside = place == k
        count, low, high = int(inside.sum()), k / _BINS, (k + 1) / _BINS
        if not count:
            rows.append([f"{low:.1f} to {high:.1f}", 0, "", "", ""])
            continue
        said = float(stated[inside].mean())
        gap = said - float(right[inside].mean())
        verdict = "" if count < _ENOUGH else "yes" if abs(gap) <= _POINTS else "no"
        rows.append(
            [f"{low:.1f} to {high:.1f}", count, f"{100 * said:.1f} %",
             format_share(int(right[inside].sum()), count), verdict]
        )  # fmt: skip
    text = (
        f"{source} One statement an attachment: the stated probability that it is "
        f"right, against whether its parent is. Target: within {100 * _POINTS:g} "
        f"points in every bin of at least {_ENOUGH} statements."
    )
    header = ["stated", "statements", "stated, mean", "true", "within 10 points"]
    return Section("How sure, stated against true", text, header, rows)


def _make_inexact_section(records: Records) -> Section:
    """Every run that did not end at the true tree, and what it ended at."""
    names = ("robot", "space", "budget", "cycles", "seed")
    rows = [
        [
            Path(r["settings"]["robot"]).stem,
            *(r["settings"][name] for name in names[1:]),
            _format_wrong_attachments(r),
            f"{r['distance']:.1f}",
            f"{r['apart']:.1f}",
            f"{r['loss']:.1f} / {r['truth_loss']:.1f}",
            explain_inexact_run(r),
        ]
        for r in records
        if not r["exact"]
    ]
    text = (
        "Wrong attachments as part: found (true) parent, 0 = torso. Distance is the "
        "parts' centers' mean [cm]; told apart by: the largest difference that statics "
        "predicts over all actions [deg, or what counts like it]; loss on the actions "
        "tried: found / true body, commanded angles."
    )
    if not rows:
        return Section("Runs that did not end at the true tree", "None.")
    header = ["robot", "space", "budget", "actions", "seed", "wrong attachments",
              "distance", "told apart by", "loss", "what it is"]  # fmt: skip
    return Section("Runs that did not end at the true tree", text, header, rows)


def _format_wrong_attachments(record: dict[str, Any]) -> str:
    """The wrong attachments of a run."""
    pairs = zip(record["parent"], record["truth"], strict=True)
    return ", ".join(f"{i}: {k} ({t})" for i, (k, t) in enumerate(pairs, 1) if k != t)
