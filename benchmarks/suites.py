"""The one runner of all benchmarks: named runs in, one line of JSON for each out."""

import json
import multiprocessing
import os
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from queue import Queue
from typing import Any

from benchmarks.writer import RESULTS, make_parser, publish_page, report_progress

Record = dict[str, Any]
Run = Callable[[], Record]
KeyedRuns = Iterable[tuple[str, Run]]
Suites = Mapping[str, tuple[Callable[[int], KeyedRuns], int]]


def read_records(name: str) -> dict[str, Record]:
    """The records of a suite's finished runs, by the key of the run."""
    file = RESULTS / f"{name}.jsonl"
    lines = file.read_text().splitlines() if file.is_file() else []
    records = (json.loads(line) for line in lines)
    return {record.pop("key"): record for record in records}


def complete_suite(name: str, runs: KeyedRuns, jobs: int = 1) -> dict[str, Record]:
    """Do the runs of a suite that have no record yet, writing each as it ends.

    Args:
        name: of the suite's file in benchmarks/results, without its ending.
        runs: key and function of each run, which gives its record.
        jobs: processes at a time; with several, each has a core of its own and
            functions have to be known by name.

    Returns:
        The records of the runs, by their keys.
    """
    wanted, done = dict(runs), read_records(name)
    left = {key: play for key, play in wanted.items() if key not in done}
    RESULTS.mkdir(parents=True, exist_ok=True)
    begun = time.perf_counter()
    with (RESULTS / f"{name}.jsonl").open("a") as out:
        for count, (key, record) in enumerate(_play_all(left, jobs), 1):
            out.write(json.dumps({"key": key, **record}) + "\n")
            out.flush()
            done[key] = record
            report_progress(f"{name} {key}", count, len(left), begun)
    return {key: done[key] for key in wanted}


def _play_all(runs: Mapping[str, Run], jobs: int) -> Iterable[tuple[str, Record]]:
    """Keys and records, one run after the other or several at a time."""
    if jobs == 1:
        yield from ((key, _play(play)) for key, play in runs.items())
        return
    context = multiprocessing.get_context("spawn")  # fork and threads do not mix
    with context.Manager() as manager:
        free, allowed = manager.Queue(), sorted(os.sched_getaffinity(0))
        for job in range(jobs):
            free.put(allowed[job % len(allowed)])
        with ProcessPoolExecutor(
            jobs, context, initializer=_pin_to_core, initargs=(free,)
        ) as pool:
            played = {pool.submit(_play, play): key for key, play in runs.items()}
            for future in as_completed(played):
                yield played[future], future.result()


def _pin_to_core(free: "Queue[int]") -> None:
    """Keep a worker process to one core, so that workers do not share threads."""
    os.sched_setaffinity(0, {free.get()})


def _play(play: Run) -> Record:
    """The record of a run, with its CPU time and wall time [s]."""
    start, cpu = time.perf_counter(), time.process_time()
    record = play()
    spent = {
        "cpu_seconds": time.process_time() - cpu,
        "wall_seconds": time.perf_counter() - start,
    }
    return {**record, **spent}


def run_suites(
    benchmark: str,
    text: str,
    suites: Suites,
    compute: Callable[[Mapping[str, dict[str, Record]]], Mapping[str, object]],
) -> None:
    """Do the suites that the command line names, or make the page of all.

    Args:
        benchmark: name of the benchmark and of its folder, which has page.md.
        suites: by name: a function from a count to the runs, and the usual count.
        compute: further figures of the page, from all records by suite and key.
    """
    line = make_parser(text)
    line.add_argument("suites", nargs="+", choices=[*suites, "page"])
    line.add_argument("--count", type=int, default=0)
    line.add_argument("--jobs", type=int, default=1)
    chosen = line.parse_args()
    for name in chosen.suites:
        if name == "page":
            known = {suite: read_records(f"{benchmark}-{suite}") for suite in suites}
            page = Path(__file__).parent / benchmark / "page.md"
            publish_page(chosen.root, benchmark, page, {**known, **compute(known)})
        else:
            list_runs, usual = suites[name]
            runs = list_runs(chosen.count or usual)
            complete_suite(f"{benchmark}-{name}", runs, chosen.jobs)
