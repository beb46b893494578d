"""Runs of `identify`: a row of a suite in, runs by key out, for worker processes."""

import hashlib
import json
from argparse import Namespace
from dataclasses import asdict, replace
from functools import cache, partial
from pathlib import Path

from benchmarks.identify.outcome import compare_with_truth
from benchmarks.identify.suites import REAL, SuiteRow
from benchmarks.suites import Record, Run
from benchmarks.writer import ROOT
from selfheal.robot.open_robot import open_robot
from selfheal.selfmodel.loop import identify_body
from selfheal.selfmodel.run import Settings

_ROOMS = ("body", "engine", "robot", "selfmodel", "models")  # what results depend on


@cache
def hash_code() -> str:
    """Hash of the program code and models that the results depend on."""
    digest = hashlib.sha256()
    files = [f for room in _ROOMS for f in (ROOT / "selfheal" / room).rglob("*.py")]
    models = [f for f in (ROOT / "models").rglob("*") if f.suffix in (".xml", ".toml")]
    for file in sorted(files + models):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def list_runs(row: SuiteRow, options: Namespace) -> dict[str, Run]:
    """Every run of a row, by a key of the present code and the run's settings.

    Args:
        options: of the command line, whose seeds and engine go before the row's own.
    """
    found = dict[str, Run]()
    for seed in range(options.first_seed, options.first_seed + _count(row, options)):
        robot = row.settings.robot.format(seed=seed)
        engine = options.engine or row.settings.engine
        settings = replace(row.settings, robot=robot, engine=engine, seed=seed)
        key = f"{hash_code()} {json.dumps(asdict(settings), sort_keys=True)}"
        found[key] = partial(play_run, settings, str(options.recordings))
    return found


def _count(row: SuiteRow, options: Namespace) -> int:
    return options.seeds or row.seeds


def play_run(settings: Settings, recordings: str) -> Record:
    """One whole identification in a worker process: its settings in, its record out."""
    file = Path(recordings) if settings.robot == REAL else None
    robot = open_robot(settings.robot, seed=settings.seed, recordings=file)
    *_, run = identify_body(robot, settings)
    return {"settings": asdict(settings), **compare_with_truth(run, robot)}
