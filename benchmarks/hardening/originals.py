"""Whole files to be damaged: a folder in; files and what reads them out."""

import json
import os
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
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
from benchmarks.writer import INTACT

KINDS = ("recording", "model", "run", "study", "diagnosis", "logs")
_BINARY: tuple[Mutate, ...] = (mutate_bytes, mutate_hdf5, mutate_hdf5)
_XML: tuple[Mutate, ...] = (mutate_bytes, mutate_xml, mutate_xml, mutate_xml)
_JSON: tuple[Mutate, ...] = (mutate_bytes, mutate_json, mutate_json, mutate_json)
_PAUSE = 5.0  # [s] after which a search that shows progress is taken for a good one
_MADE = 300.0  # [s] that making an original may take


@dataclass(frozen=True)
class Original:
    """A whole file, and what reads it.

    Attributes:
        file: its path in the folder of originals.
        mutate: ways to damage it.
        commands: arguments of commands that read it, paths in that folder.
        pause: after so long a command that shows progress is stopped [s].
    """

    file: str
    mutate: Sequence[Mutate]
    commands: Sequence[str]
    pause: float = _PAUSE


def list_originals(kind: str) -> list[Original]:
    """The originals of a kind, in the folder that `make_originals` makes."""
    return [
        replace(o, commands=[c.format(o.file) for c in o.commands])
        for o in _ORIGINALS[kind]
    ]


def _make_log(
    file: str, *mutate: Mutate, log: str = "", map_file: str = "map.toml"
) -> Original:
    """A log, or a part of one.

    Args:
        *mutate: ways to damage it, beside those of bytes.
        log: that it is a part of; "" if it is one.
    """
    log = log or file
    more = (make_column_mutation(file),) * 2 if file in ENCODERS else ()
    commands = (
        f"recording import {log} --model {MODEL} --map {map_file} --out {OUT}",
        f"recording import {log} --model {MODEL} --guess --out guess.toml",
    )
    return Original(file, (mutate_bytes, *mutate, *more), (commands[0], *commands))


_RESUMED = "--resume {} --json"
_ORIGINALS = {
    "recording": [
        Original(
            "arm.h5",
            _BINARY,
            (
                "recording check {}",
                "recording check {} --model model.xml --json",
                "replay diagnosis {} --out predicted.h5",
                "diagnose model.xml {} --out found",
            ),
        ),
        Original(
            "walk.h5",
            _BINARY,
            ("recording check {} --json", "watch body.xml {} --json"),
        ),
        Original("poses.h5", _BINARY, ("recording check {}", "watch body.xml {}")),
    ],
    "model": [
        Original(
            "model.xml",
            _XML,
            (
                "recording check arm.h5 --model {}",
                "diagnose {} arm.h5 --out found",
                "replay diagnosis arm.h5 --out p.h5 --model {}",
            ),
        ),
        Original(
            "rich.xml",
            _XML,
            (
                "diagnose {} arm.h5 --out found",
                "recording check arm.h5 --model {}",
                "replay diagnosis arm.h5 --out p.h5 --model {}",
            ),
        ),
        Original(
            "part.xml",
            _XML,
            (
                "recording check arm.h5 --model rich.xml",
                "diagnose rich.xml arm.h5 --out found",
            ),
        ),
        Original(
            "asset.obj", (mutate_bytes,), ("diagnose rich.xml arm.h5 --out found",)
        ),
        Original(
            "arm.urdf",
            _XML,
            ("recording check free.h5 --model {}", "diagnose {} free.h5 --out found"),
        ),
        Original("body.xml", _XML, ("watch {} poses.h5", "watch {} walk.h5 --json")),
    ],
    "run": [
        Original(
            "run.h5",
            _BINARY,
            (
                "show {}",
                "show {} --json",
                "gait {}",
                "heal {} --damage left_lower:0.4 --out healed",
            ),
        ),
        Original("begun.h5", _BINARY, (f"identify {_RESUMED}", "show {}")),
        Original("ended.h5", _BINARY, (f"identify {_RESUMED}", "show {}")),
        Original("heal.h5", _BINARY, (f"heal {_RESUMED}",)),
        Original("begun-heal.h5", _BINARY, (f"heal {_RESUMED}",)),
        Original("recover.h5", _BINARY, (f"recover {_RESUMED}",)),
        Original("begun-recover.h5", _BINARY, (f"recover {_RESUMED}",)),
    ],
    "study": [
        Original(
            "study.h5",
            _BINARY,
            ("study show {}", "study show {} --json", "study eea --resume {}"),
            pause=0.0,
        ),
        Original(
            "study.h5.journal",
            _JSON,
            ("study show study.h5", "study eea --resume study.h5"),
            pause=0.0,
        ),
    ],
    "diagnosis": [
        Original(
            "diagnosis/diagnosis.json",
            _JSON,
            (
                "replay diagnosis arm.h5 --out predicted.h5",
                "replay diagnosis arm.h5 --out predicted.h5 --model model.xml",
            ),
        ),
        Original(
            "diagnosis/patched.xml",
            _XML,
            ("replay diagnosis arm.h5 --out predicted.h5",),
        ),
    ],
    "logs": [
        _make_log("log.csv", mutate_text),
        _make_log("log.txt", mutate_text),
        _make_log("log.tsv"),
        _make_log("log.csv.gz", mutate_gzip),
        _make_log("log.parquet"),
        _make_log(
            "lerobot/data/chunk-000/episode_000000.parquet",
            log="lerobot",
            map_file="lerobot.toml",
        ),
        _make_log(
            "lerobot/meta/info.json",
            mutate_json,
            log="lerobot",
            map_file="lerobot.toml",
        ),
        _make_log("log.json", mutate_json),
        _make_log("runs.json", mutate_json),
        _make_log("log.jsonl", mutate_lines),
        _make_log("log.npz", mutate_zip),
        _make_log("log.npy"),
        _make_log("log.mat"),
        _make_log("log.pt", mutate_zip),
        _make_log("log.hdf5", mutate_hdf5),
        _make_log("log.bag", map_file="bag.toml"),
        _make_log("log.db3", map_file="bag.toml"),
        _make_log("log.mcap", mutate_mcap, map_file="bag.toml"),
        _make_log("packed.mcap", map_file="bag.toml"),
        _make_log("json.mcap", map_file="json.toml"),
        _make_log("map.toml", mutate_text, mutate_toml, mutate_toml, log="log.csv"),
        _make_log(
            "bag.toml", mutate_text, mutate_toml, log="log.mcap", map_file="bag.toml"
        ),
    ],
}


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
    _insist(run_forked(make, folder, seconds=_MADE))


def _insist(ended: Ended) -> None:
    if ended.code != 0:
        raise RuntimeError(f"originals cannot be made: {ended.signal} {ended.said}")


def write_small_files(folder: Path) -> None:
    """Models, recordings and a diagnosis of an arm and of the starfish."""
    from selfheal.body.mjcf import format_mjcf
    from selfheal.recording import write
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
    free = {
        name: replace(
            e,
            ctrl=np.zeros((e.time.size, 0)),
            ctrl_names=(),
            signals={k: e.signals[k] for k in ("shoulder", "elbow")},
        )
        for name, e in arm.episodes.items()
    }
    write(replace(arm, episodes=free), folder / "free.h5")
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
    document["findings"] = [
        {
            "effect": effect,
            "target": target,
            **more,
            "parameters": [
                {"name": n, "value": v, "low": v, "high": v, "unit": "1"}
                for n, v in values.items()
            ],
        }
        for effect, target, values, more in _FINDINGS
    ]
    document["refit"] = [
        {
            "parameter": "joint:elbow/damping",
            "given": 0.03,
            "value": 0.04,
            "low": 0.03,
            "high": 0.05,
        }
    ]
    (home / "diagnosis.json").write_text(json.dumps(document))


_FINDINGS: list[tuple[str, str, dict[str, object], dict[str, object]]] = [
    ("coulomb_friction", "joint:elbow", {"frictionloss": 0.1}, {"native": True}),
    ("command_delay", "actuator:elbow_servo", {"delay": 0.01}, {}),
    (
        "cogging",
        "joint:shoulder",
        {"amplitude": 0.1, "poles": 7.0, "phase": 0.3},
        {"where": {"onset": {"episode": "001", "time": 0.5, "low": 0.4, "high": 0.6}}},
    ),
    ("payload", "body:lower", {"mass": 0.1, "position": [0.0, 0.1, 0.0]}, {}),
    ("sensor_bias", "sensor:tip", {"bias": [0.1, 0.0, 0.0]}, {}),
    ("quantization", "sensor:elbow", {"step": 0.01}, {}),
]


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
        _insist(run_selfheal(words.split(), folder, prepare=_stop_clock, seconds=_MADE))
    for made, name in (
        ("id/run", "ended"),
        ("id/run", "begun"),
        ("heal/heal", "heal"),
        ("heal/heal", "begun-heal"),
        ("recover/recover", "recover"),
        ("recover/recover", "begun-recover"),
    ):
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
    lines = [
        json.dumps(
            {
                "key": task.key,
                "settings": dict(task.settings),
                "error": "",
                "outcome": {
                    "named": bool(k % 2),
                    "damage": [],
                    "hypotheses": [],
                    "actions": 3,
                    "distance": ways,
                },
                "seconds": 1.0,
                "megabytes": 100,
                "worker": "w",
            }
            if k
            else {
                "key": task.key,
                "settings": dict(task.settings),
                "outcome": None,
                "error": "ValueError: odd",
                "seconds": 0.0,
                "megabytes": 0,
                "worker": "",
            }
        )
        for k, task in enumerate(load_study(path).tasks[:-1])
    ]
    journal = find_journal(path)
    journal.write_text("".join(f"{line}\n" for line in lines[:-4]))
    merge_journal(path)
    journal.write_text("".join(f"{line}\n" for line in lines[-4:]))
