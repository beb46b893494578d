"""Diagnoses in supervised processes: takes cases, gives each its diagnosis folder.

Every case is diagnosed by a process of its own, in a temporary folder that holds its
model and its recording and nothing else. What a case is, `selfheal study diagnose`
says, whose workers know no time limit; for that, a process is watched here.
"""

import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from benchmarks.replay_error import compute_score, drop_samples, extract_values
from benchmarks.suites import Record
from benchmarks.writer import report_progress
from selfheal.files import atomic_path
from selfheal.recording import Recording, read, write
from selfheal.study.diagnose import FOUND, GIVEN, find_cases

DOCUMENT = f"{FOUND}/diagnosis.json"  # in the folder of a diagnosed case
TAIL = 2000  # characters of a process's last words that are kept


@dataclass(frozen=True)
class ProcessLimits:
    """What one process may take.

    Attributes:
        seconds: after which it is killed and recorded as a failure.
        cores: of each process; empty: all.
    """

    seconds: float
    program: tuple[str, ...]
    cores: frozenset[int] = frozenset()


def find_undiagnosed(folder: Path) -> list[Path]:
    """The cases of a folder that have no diagnosis yet."""
    return [c for c in find_cases(folder) if not (c / DOCUMENT).is_file()]


def diagnose_case(case: Path, limits: ProcessLimits) -> Record:
    """Diagnose one case in a process of its own and write run.json, its record."""
    with tempfile.TemporaryDirectory(prefix="sealed-") as room:
        for name in GIVEN:
            shutil.copy(case / name, room)
        record = _run_process(Path(room), limits)
        if record["exit_code"] == 0 and (Path(room) / DOCUMENT).is_file():
            shutil.rmtree(case / FOUND, ignore_errors=True)
            (case / "proof.json").unlink(missing_ok=True)  # of another diagnosis
            shutil.copytree(Path(room) / FOUND, case / FOUND)
    with atomic_path(case / "run.json") as path:
        path.write_text(json.dumps(record, indent=1) + "\n")
    return record


def _run_process(room: Path, limits: ProcessLimits) -> Record:
    """Start the process, wait for it, kill it when its time is over."""
    words = [*limits.program, *GIVEN, "--out", f"{FOUND}/", "--json"]
    start = time.perf_counter()
    with (
        tempfile.TemporaryFile() as out,
        tempfile.TemporaryFile() as err,
    ):
        process = subprocess.Popen(
            words, cwd=room, stdout=out, stderr=err, start_new_session=True
        )
        if limits.cores:
            os.sched_setaffinity(process.pid, limits.cores)
        code, usage, late = _wait_for_process(process, start + limits.seconds)
        return {
            "exit_code": code,
            "late": late,
            "seconds": time.perf_counter() - start,
            "megabytes": usage.ru_maxrss / 1024,
            "stderr": _read_tail(err),
        }


def _wait_for_process(process: subprocess.Popen, until: float) -> tuple[int, Any, bool]:
    """Exit code, resources used, and whether it had to be killed."""
    late = False
    try:
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            if pid:
                process.returncode = os.waitstatus_to_exitcode(status)
                return process.returncode, usage, late
            if time.perf_counter() > until and not late:
                late = True
                os.killpg(process.pid, signal.SIGKILL)
            time.sleep(0.1)
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)
        raise


def _read_tail(file: Any) -> str:
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - TAIL, 0))
    return file.read().decode(errors="replace")


def score_diagnosis(case: Path, key: Path, program: tuple[str, ...]) -> float | None:
    """Score of a diagnosis on its test, by `selfheal replay`; kept in proof.json."""
    kept, diagnosis = case / "proof.json", case / FOUND
    if kept.is_file():
        return json.loads(kept.read_text())["patched"]
    if not (case / DOCUMENT).is_file():
        return None
    patched = score_replay(diagnosis, read(key / "test.h5"), program)
    with atomic_path(kept) as path:
        path.write_text(json.dumps({"patched": patched}) + "\n")
    return patched


def score_replay(
    diagnosis: Path, test: Recording, program: Sequence[str], *more: str
) -> float | None:
    """Score of a diagnosis' replay of a test's inputs; None where it failed."""
    played = replay_inputs(diagnosis, test, program, *more)
    return None if played is None else compute_score(extract_values(played), test)


def replay_inputs(
    diagnosis: Path, test: Recording, program: Sequence[str], *more: str
) -> Recording | None:
    """What a diagnosis predicts of a test's inputs; None where its replay failed."""
    with tempfile.TemporaryDirectory(prefix="sealed-") as room:
        write(drop_samples(test), Path(room) / "inputs.h5")
        words = [*program, str(diagnosis.resolve()), "inputs.h5", "--out", "out.h5"]
        done = subprocess.run(
            [*words, *more], cwd=room, capture_output=True, check=False
        )
        return None if done.returncode else read(Path(room) / "out.h5")


def diagnose_cases(folder: Path, jobs: int, limits: ProcessLimits) -> int:
    """Diagnose every case of a folder that has no diagnosis yet.

    Args:
        jobs: processes at a time, each on a core of its own where there are several.
        limits: of each process; its cores are chosen here.

    Returns:
        How many diagnoses failed.
    """
    todo, free = find_undiagnosed(folder), SimpleQueue[frozenset[int]]()
    allowed = sorted(os.sched_getaffinity(0))
    for job in range(jobs):
        free.put(frozenset() if jobs == 1 else frozenset({allowed[job % len(allowed)]}))

    def one(case: Path) -> Record:
        cores = free.get()
        try:
            return diagnose_case(
                case, ProcessLimits(limits.seconds, limits.program, cores)
            )
        finally:
            free.put(cores)

    failed, start = 0, time.perf_counter()
    with ThreadPoolExecutor(jobs) as pool:
        futures = {pool.submit(one, case): case for case in todo}
        for count, future in enumerate(as_completed(futures), 1):
            record = future.result()
            failed += record["exit_code"] != 0
            said = f"{futures[future].name}: exit {record['exit_code']}, "
            said += f"{record['seconds']:.1f} s"
            report_progress(said, count, len(todo), start)
    return failed
