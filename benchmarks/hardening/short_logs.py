"""Short logs: every one gets an answer or a refusal, never a traceback or a warning.

Logs of 1 to 300 rows at 30 to 1000 Hz, in several shapes, are checked as by `selfheal
recording check --model`. Some drawn at random are diagnosed as well, each search
stopped after some seconds.
"""

import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.recordings import edit_values, select_rows
from benchmarks.suites import Record
from benchmarks.writer import publish_page
from selfheal.recording import Episode, Recording
from tests.support.recorded_robots import ROBOTS, record

ROWS = (*range(1, 121), *range(124, 301, 8), 300)
RATES = (30, 50, 100, 200, 333, 500, 1000)  # [Hz]
NAMES = ("pendulum", "arm", "cart_pole", "gimbal", "box")
LONG = 300  # rows of a long episode beside short ones
MISSING = 0.4  # share of the readings that are, where some are
MINUTES = 0.05  # of a diagnosis, 3 s; chosen: some get to their end
Case = tuple[str, Recording]


def lose(episode: Episode, rng: np.random.Generator) -> Episode:
    """The episode without some of its readings."""

    def drop(name: str, values: np.ndarray) -> np.ndarray:
        kept = values.copy()
        kept[rng.random(len(kept)) < MISSING] = np.nan
        return kept

    return edit_values(episode, drop)


def list_shapes(recording: Recording, rows: int) -> Iterator[Case]:
    """Logs of a robot with so many rows in an episode, by what they are like."""
    rng = np.random.default_rng(rows)
    episodes = list(recording.episodes.values())
    short = [select_rows(e, slice(rows)) for e in episodes]
    step = episodes[0].time[1]
    late = short[0].time + rng.uniform(0, 0.6 * step, rows)
    shapes = {
        "one": short[:1],
        "three": short,
        "one long, two short": [select_rows(episodes[0], slice(LONG)), *short[1:]],
        "readings missing": [lose(e, rng) for e in short],
        "irregular": [replace(short[0], time=late)],
    }
    for shape, made in shapes.items():
        named = {str(k): e for k, e in enumerate(made)}
        yield shape, replace(recording, episodes=named)


def list_cases() -> Iterator[tuple[str, str, Recording]]:
    """Robot, name and log of each case."""
    for name in NAMES:
        for rate in RATES:
            whole = record(
                ROBOTS[name], seconds=LONG / rate, rate=rate, finer=1, states=False
            )
            for rows in ROWS:
                for shape, recording in list_shapes(whole, rows):
                    yield name, f"{name} {rate} Hz {rows} rows, {shape}", recording


def attempt(act: Callable[[], Any]) -> str:
    """What came of an act: answered, refused, or the error or warning it ended in."""
    from selfheal.errors import InputError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            act()
    except InputError:
        return "refused"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "answered"


def run(diagnoses: int) -> Record:
    """Outcomes of checks and diagnoses by robot, and every fault."""
    from selfheal.api import diagnose
    from selfheal.telemetry import check_telemetry

    cases = list(list_cases())
    drawn = np.random.default_rng(0).permutation(len(cases))[:diagnoses]
    outcomes: dict[str, Counter[str]] = {name: Counter() for name in NAMES}
    faults: list[str] = []
    with tempfile.TemporaryDirectory(prefix="short-logs-") as room:
        models, paths = {}, {}
        for name in NAMES:
            models[name] = mujoco.MjModel.from_xml_string(ROBOTS[name].xml)
            paths[name] = Path(room) / f"{name}.xml"
            paths[name].write_text(ROBOTS[name].xml)
        acts: list[tuple[str, int, Callable[[], Any]]] = [
            ("check", i, partial(check_telemetry, log, models[name]))
            for i, (name, _, log) in enumerate(cases)
        ]
        for i in drawn:
            name, _, log = cases[i]
            answer = partial(diagnose, paths[name], log, minutes=MINUTES)
            acts.append(("diagnose", int(i), answer))
        for what, i, act in acts:
            name, case, _ = cases[i]
            outcome = attempt(act)
            is_fault = outcome not in ("answered", "refused")
            outcomes[name][f"{what} {'fault' if is_fault else outcome}"] += 1
            if is_fault:
                faults.append(f"{what} {case}: {outcome}")
    return {"outcomes": outcomes, "faults": faults}


def publish_short_logs(root: Path, count: int) -> None:
    """Check all short logs, and write their part of docs/results."""
    page = Path(__file__).with_name("short_logs.md")
    publish_page(root, "short-logs", page, run(count))
