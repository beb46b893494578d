"""Whole files to be damaged: a folder in; files and what reads them out."""

import json
import os
import shutil
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import h5py
import numpy as np

from benchmarks.hardening.log_files import ENCODERS, FILES, MODEL, OUT, write_logs
from benchmarks.hardening.mutate_bytes import mutate_bytes
from benchmarks.hardening.mutate_hdf5 import mutate_hdf5
from benchmarks.hardening.mutate_logs import (
    make_column_mutation,
    mutate_gzip,
    mutate_mcap,
    mutate_zip,
)
from benchmarks.hardening.mutate_trees import (
    Mutate,
    mutate_json,
    mutate_lines,
    mutate_text,
    mutate_toml,
    mutate_xml,
)
from benchmarks.hardening.process import Ended, run_forked, run_selfheal
from benchmarks.recordings import edit_episodes, select_signals
from benchmarks.writer import INTACT

KINDS = ("recording", "model", "run", "study", "diagnosis", "logs")
_MUTATIONS: Mapping[str, Mutate] = {
    "bytes": mutate_bytes,
    "gzip": mutate_gzip,
    "hdf5": mutate_hdf5,
    "json": mutate_json,
    "lines": mutate_lines,
    "mcap": mutate_mcap,
    "text": mutate_text,
    "toml": mutate_toml,
    "xml": mutate_xml,
    "zip": mutate_zip,
}
_PAUSE = 5.0  # [s] after which a search that shows progress is taken for a good one
_MADE = 300.0  # [s] that making an original may take


@dataclass(frozen=True)
class Original:
    """A whole file, and what reads it.

    Attributes:
        commands: arguments of commands that read it, paths in that folder.
        pause: after so long a command that shows progress is stopped [s].
    """

    file: str
    mutate: Sequence[Mutate]
    commands: Sequence[str]
    pause: float = _PAUSE


@cache
def list_originals(kind: str) -> list[Original]:
    """The originals of a kind, in the folder that `make_originals` makes."""
    tables = tomllib.loads((FILES / "originals.toml").read_text())[kind]
    read = _read_log if kind == "logs" else _read_original
    return [read(**table) for table in tables]


def _read_original(
    file: str, damage: str, commands: Sequence[str], pause: float = _PAUSE
) -> Original:
    mutate = [_MUTATIONS[name] for name in damage.split()]
    return Original(file, mutate, [c.format(file) for c in commands], pause)


def _read_log(
    file: str, damage: str = "", log: str = "", map: str = "map.toml"
) -> Original:
    """A log, or a part of one; most are imported by a map, and some without."""
    start = f"recording import {log or file} --model {MODEL}"
    mapped = f"{start} --map {map} --out {OUT}"
    commands = (mapped, mapped, f"{start} --guess --out guess.toml")
    mutate = [_MUTATIONS[name] for name in f"bytes {damage}".split()]
    columns = [make_column_mutation(file)] * 2 if file in ENCODERS else []
    return Original(file, [*mutate, *columns], commands)


def make_originals(folder: Path, kind: str) -> None:
    """Fill a folder with the originals of a kind and all that is read with them."""
    _call_forked(partial(write_small_files, folder), folder)
    if kind == "run":
        _make_runs(folder)
    if kind == "study":
        _call_forked(partial(write_study, folder), folder)
    if kind == "logs":
        _call_forked(partial(write_logs, folder), folder)


def _call_forked(make: Callable[[], None], folder: Path) -> None:
    """Call a function in a process of its own, and insist that it ends well."""
    insist(run_forked(make, folder, seconds=_MADE))


def insist(ended: Ended) -> None:
    """Raise RuntimeError where a command did not end well."""
    if ended.code != 0:
        raise RuntimeError(f"files cannot be made: {ended.signal} {ended.stderr}")


def write_small_files(folder: Path) -> None:
    """Models, recordings and a diagnosis of an arm and of the starfish."""
    from selfheal.body.mjcf import format_mjcf
    from selfheal.recording import Episode, write
    from tests.support.mjcf_models import CUBE
    from tests.support.recorded_robots import ROBOTS, record
    from tests.support.short_heal import BODY, record_walks

    (folder / "model.xml").write_text(ROBOTS["arm"].xml)
    for name in ("rich.xml", "part.xml", "arm.urdf"):
        shutil.copy(FILES / name, folder)
    (folder / "asset.obj").write_text(CUBE.format(0.02))
    (folder / "asset.bin").write_bytes(np.random.default_rng(0).bytes(4000))
    os.mkfifo(folder / "pipe")
    arm = record(ROBOTS["arm"], episodes=3, seconds=1.0)
    write(arm, folder / "arm.h5")

    def free(e: Episode) -> Episode:
        kept = select_signals(e, ("shoulder", "elbow"))
        return replace(kept, ctrl=np.zeros((e.time.size, 0)), ctrl_names=())

    write(edit_episodes(arm, free), folder / "free.h5")
    write(record_walks()[1], folder / "walk.h5")
    (folder / "body.xml").write_text(format_mjcf(BODY))
    # readings of a real robot where they are at hand
    damaged = INTACT.with_name("damaged.h5")
    shutil.copy(
        damaged if damaged.is_file() else folder / "walk.h5", folder / "poses.h5"
    )
    _write_diagnosis(folder)


def _write_diagnosis(folder: Path) -> None:
    """A diagnosis of the arm with a finding of each sort."""
    from tests.support.diagnosis_folder import write_empty_diagnosis

    home = write_empty_diagnosis(folder / "diagnosis", folder / "model.xml")
    document = json.loads((home / "diagnosis.json").read_text())
    document |= json.loads((FILES / "findings.json").read_text())
    (home / "diagnosis.json").write_text(json.dumps(document))


def write_identified_run(folder: Path) -> None:
    """Write run.h5, a run that found the right body."""
    from selfheal.selfmodel.run import save_run
    from tests.support.short_heal import identified

    path, run = identified(folder)
    files = {"seconds": 1.0, "run": "run.h5", "model": "best.xml"}
    save_run(replace(run, result={**run.result, **files}), path)


def _make_runs(folder: Path) -> None:
    """Runs of `identify`, `heal` and `recover`, whole and as if they were killed."""
    commands = (
        "identify --robot starfish --engine statics --budget 500 --cycles 1 --out id",
        "heal run.h5 --damage dead:left_hip_position --out heal",
        "recover --robot quadruped --scenario 1 --out recover",
    )
    _call_forked(partial(write_identified_run, folder), folder)
    for words in commands:
        insist(run_selfheal(words.split(), folder, prepare=_stop_clock, seconds=_MADE))
    for name in ("ended", "begun", "heal", "begun-heal", "recover", "begun-recover"):
        command = name.removeprefix("begun-")
        made = "id/run" if command in ("ended", "begun") else f"{command}/{command}"
        shutil.copy(folder / f"{made}.h5", folder / f"{name}.h5")
        if name.startswith("begun"):
            take_back(folder / f"{name}.h5")
    with (
        h5py.File(folder / "run.h5", "r+") as run,
        h5py.File(folder / "ended.h5") as end,
    ):
        run.attrs["result"] = end.attrs["result"]  # the one of a made-up run is empty
    for name in ("id", "heal", "recover"):
        shutil.rmtree(folder / name)


def _stop_clock() -> None:
    """Have all take no time, so that originals are the same to the bit."""
    time.perf_counter = lambda: 0.0


def take_back(path: Path) -> None:
    """Make the file of a finished run one of a killed run, which has more to do."""
    with h5py.File(path, "r+") as file:
        file.attrs["result"] = "{}"
        if "phases" in file:
            for name in sorted(file["phases"])[3:]:
                del file["phases"][name]
        else:
            settings = json.loads(file.attrs["settings"])
            file.attrs["settings"] = json.dumps({**settings, "cycles": 2})


def write_study(folder: Path) -> None:
    """A study whose runs are done but for the last, a part of them in its journal."""
    from selfheal.study.plan import StudyRequest
    from selfheal.study.run import begin_study
    from selfheal.study.store import find_journal, load_study, merge_journal

    path = folder / "study.h5"
    begin_study(path, "eea", StudyRequest(1))
    ways = {"intact": 1.0, "damaged": 0.3, "healed": 0.8, "best_known": None}
    found = {"damage": [], "hypotheses": [], "actions": 3, "distance": ways}
    failed = {"outcome": None, "error": "ValueError: odd", "worker": ""}
    lines = list[str]()
    for k, task in enumerate(load_study(path).tasks[:-1]):
        done = {"outcome": {"named": bool(k % 2), **found}, "error": "", "worker": "w"}
        spent = {"seconds": float(bool(k)), "megabytes": 100 * bool(k)}
        record = {"key": task.key, "settings": dict(task.settings), **spent}
        lines.append(json.dumps({**record, **(done if k else failed)}) + "\n")
    journal = find_journal(path)
    journal.write_text("".join(lines[:-4]))
    merge_journal(path)
    journal.write_text("".join(lines[-4:]))
