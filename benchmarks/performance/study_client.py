"""Studies that only the benchmark of studies has, and `selfheal` that knows them."""

import sys
from collections.abc import Mapping
from typing import Any

from benchmarks.writer import INTACT
from selfheal.study import plan
from selfheal.study.after import after
from selfheal.study.plan import Study, Task


def _short(settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """A short real run: which part of the robot of 2006 was damaged."""
    asked = {"robot": "starfish-2006", "method": "ours, random"}
    return after({**asked, "recordings": str(INTACT.parent), **settings})


def _empty(settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """A run that does nothing and tells as much as one of table3."""
    return {"told": [0.25] * 200}


def _study(play: Any) -> Study:
    return Study(
        about="Of the benchmark.",
        tasks=lambda asked: [Task(f"run {k}", {"seed": k}) for k in asked.seeds],
        play=play,
        tables=lambda records: [],
    )


NAMES = ("short", "empty")


if __name__ == "__main__":
    # workers import this file by its name
    import _study_runs

    from selfheal.cli import app, study

    for name in NAMES:
        plan.STUDIES[name] = f"_study_{name}"
        module = type(sys)(f"_study_{name}")
        module.STUDY = _study(getattr(_study_runs, f"_{name}"))
        sys.modules[module.__name__] = module
        study._command(name, "Of the benchmark.")
    app(sys.argv[1:])
