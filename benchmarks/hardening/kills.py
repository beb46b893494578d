"""Kills: commands that write and moments in; how they ended when resumed out."""

import os
import signal
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from benchmarks.hardening.commands import (
    COMMANDS,
    copy_folder,
    make_inputs,
    read_main,
    run_writer,
)
from benchmarks.hardening.judge import Fault, list_faults
from benchmarks.hardening.originals import insist
from benchmarks.hardening.process import load_program
from benchmarks.suites import KeyedRuns, Record

# what Python's audit reports before it is done; HDF5's own writing is wrapped below
_EVENTS = {"os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.truncate", "os.link"}
_COUNT = "moments"  # a file in which a run that is only counted says how many


def call_at_writes(act: Callable[[int], None], folder: Path) -> None:
    """Call a function just before whatever this process does to files of a folder.

    Args:
        act: is given how many such moments there were.
    """
    done = 0

    def reach() -> None:
        nonlocal done
        done += 1
        act(done)

    def hear(event: str, args: tuple[Any, ...]) -> None:
        if event == "open":
            path, _, flags = args
            if flags & (os.O_WRONLY | os.O_RDWR) and _is_within(path, folder):
                reach()
        elif event in _EVENTS and _is_within(args[0], folder):
            reach()

    sys.addaudithook(hear)
    for place, name in (
        (h5py.File, "__init__"),
        (h5py.File, "close"),
        (h5py.Group, "create_dataset"),
    ):
        setattr(place, name, _report_before(getattr(place, name), reach))


def _report_before(call: Callable[..., Any], reach: Callable[[], None]) -> Any:
    def wrapped(*args: Any, **more: Any) -> Any:
        reach()
        return call(*args, **more)

    return wrapped


def _is_within(path: Any, folder: Path) -> bool:
    """Whether what Python opens is in a folder, its count of moments aside."""
    if isinstance(path, int):
        return False
    full = os.path.abspath(os.fsdecode(path))
    return full.startswith(f"{folder}/") and not full.endswith(_COUNT)


def _kill_at(moment: int, done: int) -> None:
    if done == moment:
        os.kill(os.getpid(), signal.SIGKILL)


def note(file: Path, number: int) -> None:
    """Write a number behind those that a file has; several threads may."""
    with file.open("a") as out:
        out.write(f"{number}\n")


def read_largest(file: Path) -> int:
    """The largest number that was noted."""
    return max(map(int, file.read_text().split()))


def list_kill_runs(place: Path, count: int) -> KeyedRuns:
    """A run for each command and moment.

    Args:
        count: of kills, shared out to the commands.
    """
    load_program()
    make_inputs(place / "inputs")
    for name in COMMANDS:
        whole = copy_folder(place / "inputs", place / name)
        prepare = partial(call_at_writes, partial(note, whole / _COUNT), whole)
        insist(run_writer(COMMANDS[name].start, whole, prepare=prepare))
        most, each = read_largest(whole / _COUNT), count // len(COMMANDS)
        moments = np.unique(np.linspace(1, most, max(each, 1)).round().astype(int))
        for moment in map(int, moments):
            play = partial(try_kill, name, place / "inputs", whole, moment)
            yield f"{name} {moment} of {most}", play


def try_kill(name: str, inputs: Path, whole: Path, moment: int) -> Record:
    """Kill a command at a moment, have it go on, and compare with one that was not.

    Args:
        moment: number of the write before which it is killed.
    """
    command, faults = COMMANDS[name], list[Fault]()
    with tempfile.TemporaryDirectory(prefix="kill-") as home:
        folder = copy_folder(inputs, Path(home) / "work")
        kill = partial(_kill_at, moment)
        killed = run_writer(
            command.start, folder, prepare=partial(call_at_writes, kill, folder)
        )
        if killed.signal != "SIGKILL":
            faults.append(Fault("crash", f"not killed: {killed.code} {killed.signal}"))
        goes_on = (folder / command.main).exists() or name == "diagnose"
        words = command.resumed if goes_on else command.start
        ended = run_writer(words, folder)
        faults += list_faults(ended, folder, codes=(0,))
        if ended.code == 0:
            if read_main(name, folder) != read_main(name, whole):
                faults.append(Fault("other result", command.main))
            faults += [
                Fault("lost", other)
                for other in command.others
                if not (folder / other).exists()
            ]
            faults += [Fault("leftover", p.name) for p in folder.rglob(".*.unfinished")]
    record = {"moment": moment, "code": ended.code, "command": words}
    return {**record, "faults": [*map(asdict, faults)], "stderr": ended.stderr[-2000:]}
