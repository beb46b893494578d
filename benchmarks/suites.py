"""Suites that go on where they stopped: runs in, one line of JSON for each out."""

import json
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.writer import RESULTS, make_parser, tell_progress

Record = dict[str, Any]
KeyedRuns = Iterable[tuple[str, Callable[[], Record]]]


def read_lines(file: Path) -> list[Record]:
    """The records of a file of JSON lines; none where there is no such file."""
    if not file.is_file():
        return []
    return [json.loads(line) for line in file.read_text().splitlines()]


def read_records(benchmark: str, suite: str) -> dict[str, Record]:
    """The records of a suite's finished runs, by the key of the run."""
    lines = read_lines(RESULTS / f"{benchmark}-{suite}.jsonl")
    return {line.pop("key"): line for line in lines}


def complete_suite(benchmark: str, suite: str, runs: KeyedRuns) -> None:
    """Do the runs of a suite that have no record yet, writing each as it ends.

    Args:
        runs: key and function of each run; the function gives its record.
    """
    done = read_records(benchmark, suite)
    RESULTS.mkdir(parents=True, exist_ok=True)
    left = [(key, play) for key, play in runs if key not in done]
    begun = time.perf_counter()
    for count, (key, play) in enumerate(left, 1):
        start, cpu = time.perf_counter(), time.process_time()
        record = {"key": key, **play(), "cpu_seconds": time.process_time() - cpu}
        with (RESULTS / f"{benchmark}-{suite}.jsonl").open("a") as out:
            out.write(json.dumps(record) + "\n")
        spent = time.perf_counter() - start
        tell_progress(f"{suite} {key}: {spent:.1f} s", count, len(left), begun)


def run_suites(
    benchmark: str,
    text: str,
    suites: Mapping[str, tuple[Callable[[int], KeyedRuns], int]],
    write: Callable[[Path, Mapping[str, dict[str, Record]], str], None],
    *,
    option: str,
) -> None:
    """Do the suites that the command line names, or make the page of all.

    Args:
        benchmark: name of the benchmark and of its folder, which has remarks.md.
        text: what `--help` says.
        suites: by name: a function from a count to the runs, and the usual count.
        write: makes the page from the root folder, all records, and the remarks.
        option: name of the command-line option that gives another count.
    """
    line = make_parser(text)
    line.add_argument("suites", nargs="+", choices=[*suites, "page"])
    line.add_argument(f"--{option}", type=int, default=0, dest="count")
    chosen = line.parse_args()
    for name in chosen.suites:
        if name == "page":
            known = {suite: read_records(benchmark, suite) for suite in suites}
            remarks = Path(__file__).parent / benchmark / "remarks.md"
            write(chosen.root, known, remarks.read_text())
        else:
            list_runs, usual = suites[name]
            complete_suite(benchmark, name, list_runs(chosen.count or usual))
