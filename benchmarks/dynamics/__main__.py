"""What short moves tell of the servos of hidden robots, on fresh seeds.

    python -m benchmarks.dynamics starfish [--count N]
    python -m benchmarks.dynamics page

A suite appends its records to benchmarks/results/dynamics-SUITE.jsonl and leaves out
what is there already; `page` makes its part of docs/results of them. Seeds are 6000 and
up; development used seeds below 6000.
"""

from collections.abc import Mapping

import numpy as np

from benchmarks.dynamics.suites import SUITES
from benchmarks.suites import Record, run_suites

MODELS = {
    "present": "as heal says",
    "rated": "rated plant",
    "found": "rated plant, servos as found",
    "body": "best.xml",
    "dynamics": "best.xml with what was found",
}


def compute_figures(known: Mapping[str, Mapping[str, Record]]) -> dict[str, object]:
    """All runs, zeros of servos and how far they are off, errors of walks."""
    runs = {f"{s} {key}": r for s, of in known.items() for key, r in of.items()}
    gaps = {
        name: np.mean([abs(r[name] - r["walked"]) for r in runs.values()])
        for name in MODELS
    }
    return {
        "runs": runs,
        "models": MODELS,
        "gaps": {name: float(gap) for name, gap in gaps.items()},
        "zeros": {key: _compare_zeros(*r["offset"]) for key, r in runs.items()},
    }


def _compare_zeros(found: list[float], hidden: list[float]) -> list[float]:
    """Root mean squares of the hidden zeros, and of what is left of them [deg]."""
    pairs = np.degrees(hidden), np.degrees(np.subtract(found, hidden))
    return [float(np.sqrt(np.mean(x**2))) for x in pairs]


if __name__ == "__main__":
    run_suites("dynamics", __doc__ or "", SUITES, compute_figures)
