"""Files of studies whose runs are done, with made-up outcomes."""

from pathlib import Path
from typing import Any

from selfheal.study.plan import Task
from selfheal.study.store import create_study, open_journal

TREE = {"success": True, "error": [3.0, 2.0], "disagreement": [1.0, 0.5],
        "edge_f1": 1.0, "actions": [1, 2], "evaluations": 5, "choice": 0,
        "stated": [0.9, 0.8], "right": [True, False], "tilt_error": 1.0}  # fmt: skip
SCALES = {"success": False, "error": [1.0, 2.0], "actions": [1], "evaluations": 3,
          "lengths": [[0.9, 1.1, 0.95, 1.0], [0.05, 0.2, 0.9, 0.1]]}  # fmt: skip
LENGTHS = {"part": 1.0, "leg": 2.0, "uneven": 0.5, "evaluations": 3}
MATRIX = {**LENGTHS, "edge_f1": 1.0, "success": True, "hips": True, "foretold": 1.0,
          "tilt_gap": 1.0, "fit": 1.0}  # fmt: skip
WAYS = {"intact": 2.0, "damaged": 1.0, "healed": 1.5, "best_known": None}
FIT = {"given": 1.0, "refit": 1.0, "patched": None, "explainable_removed": 0.5}
ROBOT = {"robot": "starfish", "seed": 0, "recordings": ""}
# study -> settings and outcome of its runs
RUNS: dict[str, list[tuple[dict[str, Any], dict[str, Any]]]] = {
    "table3": [({**ROBOT, "phase": "before", "method": "ours"}, TREE),
               ({**ROBOT, "phase": "before", "method": "paper"}, TREE),
               ({**ROBOT, "phase": "after", "method": "ours"}, SCALES)],
    "actions": [({**ROBOT, "method": "ours"}, TREE)],
    "schema": [({**ROBOT, "what": "lengths", "sensors": "tilt"}, LENGTHS),
               ({**ROBOT, "what": "matrix", "sensors": "tilt"}, MATRIX)],
    "eea": [({"robot": "quadruped", "scenario": 1, "seed": 0},
             {"named": True, "actions": 3, "distance": WAYS})],
    "sealed": [({"case": "one", "seed": 0},
                {"verdict": "explained", "named": [["slope", "world"]], "fit": FIT})],
}  # fmt: skip


def write_finished_study(path: Path, name: str) -> list[dict[str, Any]]:
    """The file of a study, and its records."""
    records = [
        {"key": f"run {k}", "settings": settings, "outcome": outcome, "error": "",
         "seconds": 1.0, "megabytes": 5, "worker": "0"}
        for k, (settings, outcome) in enumerate(RUNS[name])
    ]  # fmt: skip
    tasks = [Task(record["key"], record["settings"]) for record in records]
    create_study(path, name, {"runs": 1, "seed": 0}, tasks)
    with open_journal(path) as journal:
        journal.add(records)
    return records
