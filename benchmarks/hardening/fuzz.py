"""Mutants of all kinds of files: kinds and seeds in; what commands did out."""

import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

from benchmarks.hardening.judge import list_faults
from benchmarks.hardening.mutate_trees import Mutate
from benchmarks.hardening.originals import (
    KINDS,
    Original,
    list_originals,
    make_originals,
)
from benchmarks.hardening.process import (
    load_program,
    run_selfheal,
    stop_at_progress,
)
from benchmarks.suites import KeyedRuns, Record


@dataclass(frozen=True)
class Mutant:
    """A damaged file and the command that is to read it.

    Attributes:
        command: arguments, paths in the folder of originals.
    """

    original: Original
    mutate: Mutate
    content: bytes
    command: str


def make_mutant(folder: Path, kind: str, seed: int) -> Mutant:
    """The mutant of a kind and a seed, of originals that `make_originals` made."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    originals = list_originals(kind)
    original = originals[rng.integers(len(originals))]
    mutate = original.mutate[int(rng.integers(len(original.mutate)))]
    command = original.commands[int(rng.integers(len(original.commands)))]
    whole = (folder / original.file).read_bytes()
    damaged = mutate(whole, int(rng.integers(2**31)))
    return Mutant(original, mutate, damaged, command)


def copy_with_mutant(folder: Path, mutant: Mutant, place: Path) -> None:
    """Copy a folder of originals, with a mutant in the place of its original."""
    shutil.copytree(folder, place, copy_function=_copy_file)
    path = place / mutant.original.file
    path.unlink()
    path.write_bytes(mutant.content)


def _copy_file(source: str, target: str) -> None:
    """Copy a file; a pipe is made anew."""
    if Path(source).is_fifo():
        os.mkfifo(target)
    else:
        shutil.copyfile(source, target)


def try_mutant(
    workshop: Path, kind: str, seed: int, keep: Path | None = None
) -> Record:
    """Give a mutant to its command, in a folder of its own.

    Args:
        keep: the folder; None makes one and removes it.

    Returns:
        The command, its exit code, its faults, its time [s] and its memory [MB].
    """
    load_program()
    folder = _find_originals(workshop, kind)
    mutant = make_mutant(folder, kind, seed)
    with tempfile.TemporaryDirectory(prefix="mutant-", dir=folder.parent) as home:
        place = keep or Path(home) / "work"
        copy_with_mutant(folder, mutant, place)
        prepare = partial(stop_at_progress, mutant.original.pause)
        ended = run_selfheal(mutant.command.split(), place, prepare=prepare)
        return {
            "file": mutant.original.file,
            "damage": mutant.mutate.__name__,
            "command": mutant.command,
            "code": ended.code,
            "faults": [asdict(fault) for fault in list_faults(ended, place)],
            "seconds": round(ended.seconds, 2),
            "megabytes": round(ended.megabytes),
            "stderr": ended.stderr[-2000:],
        }


@cache
def _find_originals(workshop: Path, kind: str) -> Path:
    """The originals of a kind, made when this process first asks for them."""
    folder = Path(tempfile.mkdtemp(prefix=f"{kind}-", dir=workshop)) / "originals"
    folder.mkdir()
    make_originals(folder, kind)
    return folder


def list_runs(workshop: Path, count: int, kinds: Sequence[str] = KINDS) -> KeyedRuns:
    """So many mutants, kind after kind in turns."""
    for k in range(count):
        kind, seed = kinds[k % len(kinds)], k // len(kinds)
        yield f"{kind} {seed}", partial(try_mutant, workshop, kind, seed)
