"""Success of `identify` over seeds, for each method and robot.

    python -m benchmarks.identify SUITE [--seeds N] [--first-seed K] [--jobs 2]

Takes a suite of `suites.py`, gives docs/results/identify-SUITE.md. Finished runs are
kept in benchmarks/results/identify-SUITE.jsonl, so that an interrupted suite goes on;
runs of other program code than today's are not counted. "calibration" runs nothing:
it pools what the suites' runs said of how sure they are.
"""

import hashlib
import json
import multiprocessing
import os
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from benchmarks.identify.outcome import compare_with_truth
from benchmarks.identify.page import make_calibration_section, make_sections
from benchmarks.identify.suites import REAL, SUITES, SuiteRow
from benchmarks.suites import read_lines
from benchmarks.writer import (
    INTACT,
    ROOT,
    count_cores,
    make_parser,
    publish_results,
    tell_progress,
)
from selfheal.robot.open_robot import open_robot
from selfheal.selfmodel.loop import identify_body
from selfheal.selfmodel.run import Settings

_ROOMS = ("body", "engine", "robot", "selfmodel", "models")  # what results depend on


def hash_code() -> str:
    """Hash of the program code and models that the results depend on."""
    digest = hashlib.sha256()
    files = [f for room in _ROOMS for f in (ROOT / "selfheal" / room).rglob("*.py")]
    models = [f for f in (ROOT / "models").rglob("*") if f.suffix in (".xml", ".toml")]
    for file in sorted(files + models):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def plan_suite(suite: str, options) -> list[tuple[SuiteRow, Settings]]:
    """Every run of a suite: its row and its settings."""
    runs = []
    for row in SUITES[suite]:
        for seed in range(options.first_seed, options.first_seed + options.count(row)):
            robot = row.settings.robot.format(seed=seed)
            engine = options.engine or row.settings.engine
            changes: dict[str, Any] = {"robot": robot, "engine": engine, "seed": seed}
            runs.append((row, replace(row.settings, **changes)))
    return runs


def play_run(settings: Settings, recordings: str) -> dict[str, Any]:
    """One whole identification in a worker process: its settings in, its record out."""
    file = Path(recordings) if settings.robot == REAL else None
    robot = open_robot(settings.robot, seed=settings.seed, recordings=file)
    start = time.perf_counter()
    *_, run = identify_body(robot, settings)
    spent = time.perf_counter() - start
    return {
        "settings": asdict(settings),
        "seconds": spent,
        **compare_with_truth(run, robot),
    }


def _pin_to_core(free: Any) -> None:
    """Keep a worker process to one core, so that workers do not share threads."""
    os.sched_setaffinity(0, {free.get()})


def start_workers(jobs: int) -> ProcessPoolExecutor:
    """Worker processes, each on its own core where there are several."""
    context = multiprocessing.get_context("spawn")  # fork and threads do not mix
    if jobs == 1:
        return ProcessPoolExecutor(1, context)
    free, allowed = context.Manager().Queue(), sorted(os.sched_getaffinity(0))
    for job in range(jobs):
        free.put(allowed[job % len(allowed)])
    return ProcessPoolExecutor(jobs, context, _pin_to_core, (free,))


def read_known_runs(file: Path, now: str) -> dict[str, dict[str, Any]]:
    """The records in a file that the present code made, by their settings."""
    records = read_lines(file)
    return {make_key(r["settings"]): r for r in records if r["code"] == now}


def make_key(settings: dict[str, Any]) -> str:
    """Settings as one text, by which a record is looked up."""
    return json.dumps(settings, sort_keys=True)


def complete_runs(runs: list, file: Path, options) -> dict[str, dict[str, Any]]:
    """Do the runs that have no record yet, writing each as it ends.

    Args:
        runs: rows and settings, as `plan_suite` gives them.
        file: JSON lines that records are appended to.

    Returns:
        All records of the present code, by `make_key` of their settings.
    """
    now = hash_code()
    done = read_known_runs(file, now)
    left = [s for _, s in runs if make_key(asdict(s)) not in done]
    file.parent.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    with start_workers(options.jobs) as pool, file.open("a") as out:
        played = [pool.submit(play_run, s, str(options.recordings)) for s in left]
        for count, future in enumerate(as_completed(played), 1):
            record = {"code": now, **future.result()}
            done[make_key(record["settings"])] = record
            out.write(json.dumps(record) + "\n")
            out.flush()
            tell_progress(_describe_run(record), count, len(left), start)
    return done


def _describe_run(record: dict[str, Any]) -> str:
    """A run and what came of it, in a line."""
    s = record["settings"]
    return (
        f"{s['robot']} {s['method']} {s['space']} {s['budget']} {s['cycles']} seed "
        f"{s['seed']}: {'right' if record['exact'] else 'wrong'}, "
        f"{record['seconds']:.1f} s"
    )


def run_suite(name: str, options, folder: Path) -> None:
    """Do what is left of a suite and publish its page.

    Args:
        folder: that holds the suites' JSON lines.
    """
    runs = plan_suite(name, options)
    done = complete_runs(runs, folder / f"identify-{name}.jsonl", options)
    records: dict[str, list[dict[str, Any]]] = {row.name: [] for row in SUITES[name]}
    for row, settings in runs:
        records[row.name].append(done[make_key(asdict(settings))])
    title = f"Identification: {name}"
    found = make_sections(SUITES[name], records, options.jobs)
    publish_results(
        options.root, f"identify-{name}", title, found, {"code": hash_code(), **records}
    )


def pool_calibration(options, folder: Path) -> None:
    """Publish how sure all suites' runs of our method were, against how often right."""
    now, pooled, used = hash_code(), [], []
    for name in SUITES:
        found = read_known_runs(folder / f"identify-{name}.jsonl", now).values()
        ours = [r for r in found if r["settings"]["method"] == "default"]
        pooled += ours
        used += [f"{name} ({len(ours)} runs)"] if ours else []
    section = make_calibration_section(
        pooled, f"Pooled from: {', '.join(used) or 'none'}."
    )
    data = {"code": now, "suites": used, "rows": section.rows}
    title = "Identification: how sure, stated against true"
    publish_results(options.root, "identify-calibration", title, [section], data)


def main() -> None:
    """Read the command line and run what it says."""
    line = make_parser(__doc__ or "")
    line.add_argument("suite", choices=[*SUITES, "calibration"])
    line.add_argument("--seeds", type=int, help="runs of each row, instead of its own")
    line.add_argument("--first-seed", type=int, default=5000, help="then one by one")
    line.add_argument("--jobs", type=int, help="processes; one a core, mjx suite: one")
    line.add_argument("--engine", help="instead of the suite's (statics; mjx: mjx)")
    line.add_argument("--recordings", type=Path, default=INTACT, help="intact.h5")
    options = line.parse_args()
    options.jobs = options.jobs or (1 if options.suite == "mjx" else count_cores())
    options.count = lambda row: options.seeds or row.seeds
    folder = options.root / "benchmarks" / "results"
    if options.suite == "calibration":
        pool_calibration(options, folder)
    else:
        run_suite(options.suite, options, folder)
