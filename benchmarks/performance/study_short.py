"""Study `short` of the benchmark: short real runs, each the same for the same seed."""

from collections.abc import Mapping
from typing import Any

from benchmarks.writer import INTACT
from selfheal.study.after_damage import run_after_damage
from selfheal.study.plan import Study, Task


def name_damaged_part(settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """Which part of the robot of 2006 was damaged, in a run of a second or two."""
    asked = {"robot": "starfish-2006", "method": "ours, random"}
    return run_after_damage({**asked, "recordings": str(INTACT.parent), **settings})


STUDY = Study(
    about="Of the benchmark.",
    list_tasks=lambda asked: [Task(f"run {k}", {"seed": k}) for k in asked.seeds],
    run_task=name_damaged_part,
    make_tables=lambda records: [],
)
