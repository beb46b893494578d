"""Study `empty` of the benchmark: runs that do nothing, to measure the machinery."""

from collections.abc import Mapping
from typing import Any

from selfheal.study.plan import Study, Task


def return_constant(settings: Mapping[str, Any]) -> Mapping[str, Any]:
    """An outcome as large as one of study `table3`, without any work."""
    return {"told": [0.25] * 200}


STUDY = Study(
    about="Of the benchmark.",
    list_tasks=lambda asked: [Task(f"run {k}", {"seed": k}) for k in asked.seeds],
    run_task=return_constant,
    make_tables=lambda records: [],
)
