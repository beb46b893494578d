"""Drawn robots, with a fault and without: checked, corrected, checked again."""

import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.telemetry.correct import Files, correct, write_setup
from benchmarks.telemetry.drawn_robots import DrawnRobot, draw_robot
from benchmarks.telemetry.faults import judge
from benchmarks.telemetry.setups import Setup, draw_setup
from benchmarks.writer import tell_progress
from selfheal.telemetry import Fault, check_telemetry

FIRST_SEED = 100_000  # of the faulty; the clean ones have others


def run_study(count: int, first: int = FIRST_SEED) -> dict[str, list[dict[str, Any]]]:
    """What was said of drawn set-ups with a fault, and of as many without.

    Args:
        count: of each.
    """
    found: dict[str, list[dict[str, Any]]] = {"faulty": [], "clean": []}
    begun = time.perf_counter()
    for n in range(count):
        seed = first + 1000 * n
        while (setup := draw_setup(n, robot := draw_robot(seed))) is None:
            seed += 1
        found["faulty"].append({"seed": seed, **_try_setup(setup, robot)})
        clean = draw_robot(first + 1000 * n + 500)
        none = Setup("", (), frozenset(), clean.recording, clean.xml)
        found["clean"].append({"seed": first + 1000 * n + 500,
                               **_try_setup(none, clean)})  # fmt: skip
        tell_progress(f"{setup.name} {seed}", n + 1, count, begun)
    return found


def _try_setup(setup: Setup, robot: DrawnRobot) -> dict[str, Any]:
    """What a check says of a set-up, and then of what it says was done."""
    with tempfile.TemporaryDirectory() as folder:
        files = write_setup(setup, Path(folder), robot.gains)
        faults, left = _check_twice(files)
    _, located, others = judge(setup.kinds, setup.columns, faults)
    return {
        "fault": setup.name,
        "told": bool(located),
        "others": [f.describe() for f in others],
        "left": [f.describe() for f in left],
    }


def _check_twice(files: Files) -> tuple[list[Fault], list[Fault]]:
    """Faults, and those that are left after what they say was done."""
    recording, model = files.import_recording()
    faults = check_telemetry(recording, model)
    if not faults:
        return faults, []
    correct(files, faults, recording)
    return faults, check_telemetry(*files.import_recording())
