"""Figures of pages of identification: records in, what page.md shows out."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.identify.outcome import NEAR, explain_inexact_run, explain_likeness
from benchmarks.identify.suites import SuiteRow
from benchmarks.suites import Record
from benchmarks.writer import format_hits
from selfheal.selfmodel.explore import DISTINGUISHABLE
from selfheal.study.statistics import format_share

Records = Sequence[Record]
BINS, ENOUGH, POINTS = 10, 50, 0.1  # the issue's: bins, statements, tolerance


def compute_figures(
    rows: Sequence[SuiteRow], records: Mapping[str, Records]
) -> dict[str, object]:
    """All that a suite's page shows."""
    every = [r for found in records.values() for r in found]
    return {
        "rows": [_summarize_row(row, records[row.name]) for row in rows],
        "first_seed": min(r["settings"]["seed"] for r in every),
        "near": 10 * NEAR,
        "distinguishable": DISTINGUISHABLE,
        "source": "All runs of this suite.",
        "calibration": tabulate_calibration(every),
        "inexact": [_describe_inexact_run(r) for r in every if not r["exact"]],
        "records": records,
    }


def _summarize_row(row: SuiteRow, found: Records) -> list[str]:
    """Cells of a row of success."""
    s = replace(row.settings, engine=found[0]["settings"]["engine"])
    outside = ("choice", "failed", "mujoco")  # for choice and the final check
    spent = [
        sum(n for name, n in r["simulations"].items() if name not in outside)
        for r in found
    ]
    return [
        row.name,
        Path(s.robot).stem,
        s.method,
        str(s.cycles),
        s.engine,
        format_hits(r["exact"] for r in found),
        format_hits(r["exact"] or explain_likeness(r) for r in found),
        row.target,
        f"{np.mean([r['edge_f1'] for r in found]):.2f}",
        f"{np.mean([r['axes'] for r in found]):.1f}",
        f"{np.median([r['tilt_error'] for r in found]):.2f}",
        f"{np.mean(spent):,.0f}",
        f"{np.mean([r['simulations']['choice'] for r in found]):,.0f}",
        f"{np.median([r['wall_seconds'] for r in found]):.1f}",
    ]


def tabulate_calibration(records: Records) -> list[tuple[str, ...]]:
    """Stated probability of each attachment against how often it was right, in bins."""
    stated = np.array([x for r in records for x in r["stated"]])
    right = np.array([x for r in records for x in r["right"]])
    place = np.minimum((stated * BINS).astype(int), BINS - 1)
    rows = list[tuple[str, ...]]()
    for k in range(BINS):
        inside, label = place == k, f"{k / BINS:.1f} to {(k + 1) / BINS:.1f}"
        count = int(inside.sum())
        if not count:
            rows.append((label, "0", "", "", ""))
            continue
        said, share = float(stated[inside].mean()), float(right[inside].mean())
        near = "yes" if abs(said - share) <= POINTS else "no"
        rows.append(
            (
                label,
                str(count),
                f"{100 * said:.1f} %",
                format_share(int(right[inside].sum()), count),
                near if count >= ENOUGH else "",
            )
        )
    return rows


def _describe_inexact_run(record: Record) -> tuple[str, ...]:
    """Cells of a run that did not end at the true tree."""
    settings = record["settings"]
    pairs = enumerate(zip(record["parent"], record["truth"], strict=True), 1)
    return (
        Path(settings["robot"]).stem,
        *(str(settings[name]) for name in ("space", "budget", "cycles", "seed")),
        ", ".join(f"{i}: {k} ({t})" for i, (k, t) in pairs if k != t),
        f"{record['distance']:.1f}",
        f"{record['apart']:.1f}",
        f"{record['loss']:.1f} / {record['truth_loss']:.1f}",
        explain_inexact_run(record),
    )
