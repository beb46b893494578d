"""Studies with something replaced are refused by one error that names it, or shown."""

import copy
import json
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from selfheal import files
from selfheal.errors import RunFileError
from selfheal.study.page import format_markdown
from selfheal.study.plan import Record, Task, find_study
from selfheal.study.store import create_study, load_checked, open_journal
from tests.support.damaged.members import NEVER_FIT, find_faults, replace_member

TREE = {
    "success": True,
    "error": [3.0, 2.0],
    "disagreement": [1.0, 0.5],
    "edge_f1": 1.0,
    "actions": [1, 2],
    "evaluations": 5,
    "choice": 0,
    "stated": [0.9, 0.8],
    "right": [True, False],
    "tilt_error": 1.0,
}
INTERVALS = [[0.9, 1.1, 0.95, 1.0], [0.05, 0.2, 0.9, 0.1]]
SCALES = {
    "success": False,
    "error": [1.0, 2.0],
    "actions": [1],
    "evaluations": 3,
    "lengths": INTERVALS,
}
LENGTHS = {"part": 1.0, "leg": 2.0, "uneven": 0.5, "evaluations": 3}
MATRIX = {
    **LENGTHS,
    "edge_f1": 1.0,
    "success": True,
    "hips": True,
    "foretold": 1.0,
    "tilt_gap": 1.0,
    "fit": 1.0,
}
WAYS = {"intact": 2.0, "damaged": 1.0, "healed": 1.5, "best_known": None}
FIT = {"given": 1.0, "refit": 1.0, "patched": None, "explainable_removed": 0.5}
SLOPE = {
    "effect": "slope",
    "target": "world",
    "name": "tilt",
    "value": 0.1,
    "low": 0.0,
    "high": 0.2,
    "unit": "rad",
}
DIAGNOSIS = {"verdict": "explained", "findings": [SLOPE], "fit": FIT}
RECOVERY = {"named": True, "actions": 3, "distance": WAYS}
ROBOT = {"robot": "starfish", "seed": 0, "recordings": ""}
# settings and outcome of the runs of each study
RUNS = {
    "table3": [
        ({**ROBOT, "phase": "before", "method": "ours"}, TREE),
        ({**ROBOT, "phase": "after", "method": "ours"}, SCALES),
    ],
    "actions": [({**ROBOT, "method": "ours"}, TREE)],
    "schema": [
        ({**ROBOT, "what": "lengths", "sensors": "tilt"}, LENGTHS),
        ({**ROBOT, "what": "matrix", "sensors": "tilt"}, MATRIX),
    ],
    "eea": [({"robot": "quadruped", "scenario": 1, "seed": 0}, RECOVERY)],
    "diagnose": [({"robot": "one", "seed": 0}, DIAGNOSIS)],
}


def _write_study(path: Path, name: str) -> list[Record]:
    """The file of a study, and its records."""
    cost = {"error": "", "seconds": 1.0, "megabytes": 5, "worker": "0"}
    records: list[Record] = [
        {"key": f"run {k}", "settings": settings, "outcome": outcome, **cost}
        for k, (settings, outcome) in enumerate(RUNS[name])
    ]
    tasks = [Task(record["key"], record["settings"]) for record in records]
    create_study(path, name, {"runs": 1, "seed": 0}, tasks)
    with open_journal(path) as journal:
        journal.add(records)
    return records


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    """Files are not read on trial by another process, which takes time."""
    monkeypatch.setattr(files, "explain_dangerous", lambda *what: "")


def _show_study(path: Path, member: str = "") -> None:
    results = load_checked(path)
    tables = find_study(results.study).make_tables(results.finished)
    format_markdown(results, tables)


def _replace_each(value: dict | list) -> Iterator[dict | list]:
    """Copies of a document with one entry missing or something else."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, old in list(items):
        for new in (None, "x", -1, [], {}, 10**30, float("nan"), True, ...):
            changed = copy.copy(value)
            if new is ...:
                del changed[key]
            else:
                changed[key] = new
            yield changed
        if isinstance(old, dict | list):
            for inner in _replace_each(old):
                changed = copy.copy(value)
                changed[key] = inner
                yield changed


SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in ("table3", "schema")]


@pytest.mark.parametrize("name", ["actions", "eea", "diagnose", *SLOW])
def test_tables_of_a_study_are_made_of_outcomes_that_fit(name, tmp_path):
    path = tmp_path / "study.h5"
    records = _write_study(path, name)
    _show_study(path)
    lines = [json.dumps(record) for record in records]
    refused = 0
    for k, record in enumerate(records):
        for changed in _replace_each(record):
            new = [*lines[:k], json.dumps(changed), *lines[k + 1 :]]
            replace_member(path, "records", np.array(new, h5py.string_dtype()))
            try:
                _show_study(path)
            except RunFileError as error:
                assert str(path) in str(error)
                refused += 1
    assert refused > 20


def test_a_study_with_a_member_replaced_is_refused_or_shown(tmp_path):
    path = tmp_path / "study.h5"
    _write_study(path, "eea")
    faults, passed = find_faults(path, _show_study)
    known = {f for f in faults if f[0] == "@study"}  # another study's name
    assert not faults.keys() - known
    assert not {each for each in passed if each[1] in NEVER_FIT}
