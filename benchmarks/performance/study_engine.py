"""What studies cost and survive, apart from what their runs do.

    python -m benchmarks.performance.study_engine

Kills workers and clients of a study of 60 short real runs, measures what the machinery
adds to empty runs, and how fast records are kept; gives docs/results/study-engine.md.
"""

import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import h5py
import psutil

from benchmarks.writer import INTACT, ROOT, Section, make_parser, publish_results
from selfheal.study.plan import Record, Task
from selfheal.study.store import (
    create_study,
    find_journal,
    load_study,
    merge_journal,
    open_journal,
)

_RUNS, _KILLS, _EMPTY, _KEPT = 60, 20, 2000, 100_000


def _start_client(*words: Any) -> subprocess.Popen:
    """`selfheal study` in a process of its own."""
    program = [sys.executable, "-m", "benchmarks.performance.study_client", "study"]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        [*program, *map(str, words)], stdout=quiet, stderr=quiet, cwd=ROOT
    )


def _count_records(file: Path) -> int:
    """Records kept so far."""
    try:
        return len(load_study(file).records)
    except Exception:  # it is being made
        return 0


def _find_workers(client: subprocess.Popen) -> list[psutil.Process]:
    """The worker processes of a client."""
    found = psutil.Process(client.pid).children(recursive=True)
    return [p for p in found if "resource_tracker" not in " ".join(p.cmdline())]


def _read_outcomes(file: Path) -> list[tuple]:
    """What every run gave."""
    with h5py.File(file) as kept:
        records = [json.loads(text) for text in kept["records"].asstr()[()]]
    return [(r["key"], r["outcome"], r["error"]) for r in records]


def kill_processes(folder: Path) -> dict[str, Any]:
    """The same study left alone, and with a worker or the client killed in turn."""
    if not INTACT.is_file():
        sys.exit(f"no readings of the robot of 2006 at {INTACT}")
    start = time.perf_counter()
    calm = folder / "calm" / "study.h5"
    code = _start_client("short", "--runs", _RUNS, "--out", calm.parent).wait()
    spent = time.perf_counter() - start
    killed = folder / "killed" / "study.h5"
    words: tuple[Any, ...] = ("--runs", _RUNS, "--out", killed.parent)
    dice, count = random.Random(0), {"worker": 0, "client": 0}
    client = _start_client("short", *words)
    for k in range(_KILLS):
        until = (k + 1) * _RUNS // (_KILLS + 1)
        while _count_records(killed) < until:
            if client.poll() is not None:
                sys.exit(f"a client ended by itself, with {client.returncode}")
            time.sleep(0.02)
        time.sleep(dice.uniform(0, 1))
        if k % 2:
            client.kill()
            client.wait()
            client = _start_client("short", "--resume", killed)
            count["client"] += 1
        elif workers := _find_workers(client):
            dice.choice(workers).kill()
            count["worker"] += 1
    ended = client.wait()
    values = [_read_outcomes(file) for file in (calm, killed)]
    return {
        "codes": [code, ended],
        "kills": count,
        "runs": [len(v) for v in values],
        "distinct": len({key for key, *_ in values[1]}),
        "same": values[0] == values[1],
        "seconds": [spent, time.perf_counter() - start - spent],
    }


def measure_overhead(folder: Path) -> dict[str, Any]:
    """Runs a second where runs do nothing, and the client's memory."""
    file = folder / "empty" / "study.h5"
    start, before = time.perf_counter(), _sum_children_cpu()
    words = ("--workers", 1, "--out", file.parent)
    _start_client("empty", "--runs", 1, *words).wait()
    one, alone = time.perf_counter() - start, _sum_children_cpu() - before
    start, before = time.perf_counter(), _sum_children_cpu()
    _start_client("empty", "--runs", _EMPTY, *words, "--force").wait()
    many, cpu = time.perf_counter() - start, _sum_children_cpu() - before - alone
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    return {"start": one, "runs": _EMPTY, "each": (many - one) / (_EMPTY - 1),
            "cpu": cpu / (_EMPTY - 1), "peak": peak}  # fmt: skip


def _sum_children_cpu() -> float:
    """Seconds of all processes that were waited for, and of theirs."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure_writer(folder: Path) -> dict[str, Any]:
    """Records kept a second, by the size of chunks; and what the one file costs."""
    tasks = [Task(f"run {k}", {"seed": k}) for k in range(_KEPT)]
    records: list[Record] = [
        {"key": t.key, "settings": dict(t.settings), "error": "",
         "outcome": {"told": [0.25] * 200}, "seconds": 1.0, "megabytes": 1,
         "worker": "0"} for t in tasks
    ]  # fmt: skip
    found: dict[str, Any] = {"bytes": len(json.dumps(records[0]))}
    for size in (1, 10, 100, 1000):
        file = folder / f"kept-{size}.h5"
        create_study(file, "empty", {}, tasks[:10_000])
        some = records[: min(10_000, 1000 * size)]
        with open_journal(file) as journal:
            start = time.perf_counter()
            for k in range(0, len(some), size):
                journal.add(some[k : k + size])
            found[f"rate {size}"] = len(some) / (time.perf_counter() - start)
    file = folder / "all.h5"
    create_study(file, "empty", {}, tasks)
    with open_journal(file) as journal:
        journal.add(records)
        start = time.perf_counter()
        merge_journal(file)
        found["merge"] = time.perf_counter() - start
    start = time.perf_counter()
    load_study(file)
    found["load"] = time.perf_counter() - start
    found["megabytes"] = file.stat().st_size / 1e6
    assert not find_journal(file).exists()
    return found


def _make_sections(
    k: dict[str, Any], o: dict[str, Any], w: dict[str, Any]
) -> list[Section]:
    cores = len(os.sched_getaffinity(0))
    text = (
        f"{_RUNS} short real runs, {cores} worker(s), left alone; then the same while "
        "a worker or the client was killed (SIGKILL) in turn, at random moments within "
        "a second after every third record; a killed client was resumed."
    )
    rows = [("left alone", "", k["runs"][0], "", f"{k['seconds'][0]:.0f}"),
            (f"{k['kills']['worker']} workers, {k['kills']['client']} clients killed",
             "yes" if k["same"] else "NO", k["runs"][1], k["distinct"],
             f"{k['seconds'][1]:.0f}")]  # fmt: skip
    head = ("study", "same values", "records", "distinct runs", "seconds")
    kept = [(size, f"{w[f'rate {size}']:,.0f}") for size in (1, 10, 100, 1000)]
    return [
        Section("Killed workers and clients", text, head, rows),
        Section(
            "What the machinery adds",
            "Runs that do nothing, one worker; client, scheduler and worker share the "
            "cores in use. Start and end: a study of one such run, from the command to "
            "its pages.",
            (
                "start and end [s]",
                "each further run [ms]",
                "CPU of it, all processes [ms]",
                "largest process so far [MB]",
            ),
            [
                (
                    f"{o['start']:.1f}",
                    f"{1000 * o['each']:.1f}",
                    f"{1000 * o['cpu']:.1f}",
                    f"{o['peak']:.0f}",
                )
            ],
        ),
        Section(
            "The one writer",
            f"Records of {w['bytes']:,} bytes, on disk (fsync) before the next chunk. "
            f"{_KEPT:,} of them: {w['merge']:.1f} s to make one file of the journal, "
            f"{w['megabytes']:.0f} MB; {w['load']:.1f} s to read it.",
            ("records a chunk", "records a second"),
            kept,
        ),
    ]


def main() -> None:
    """Measure kills, overhead and writer, and publish."""
    options = make_parser(__doc__ or "").parse_args()
    with tempfile.TemporaryDirectory(prefix="study-") as room:
        folder = Path(room)
        found = kill_processes(folder), measure_overhead(folder), measure_writer(folder)
    data = dict(zip(("kills", "overhead", "writer"), found, strict=True))
    title = "Studies: what they survive and cost"
    publish_results(options.root, "study-engine", title, _make_sections(*found), data)


if __name__ == "__main__":
    main()
