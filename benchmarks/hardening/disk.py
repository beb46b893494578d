"""Full disks: commands that write and sizes in; what they did and left out."""

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.hardening.commands import (
    COMMANDS,
    OUT,
    copy_folder,
    is_whole,
    make_earlier,
    make_inputs,
    run_writer,
)
from benchmarks.hardening.judge import Fault, list_faults
from benchmarks.hardening.kills import call_at_writes, note, read_largest
from benchmarks.hardening.originals import insist
from benchmarks.hardening.process import Ended, load_program
from benchmarks.suites import KeyedRuns, Record

_SMALLEST, _LARGE = 4, 65536  # [kB] of a disk
_VARIANTS = ("small", "filled")


@contextmanager
def mount_disk(place: Path, size: int) -> Iterator[None]:
    """Keep a disk in memory mounted at a folder.

    Args:
        size: of the disk [kB].
    """
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", f"size={size}k", "tmpfs", place],
        capture_output=True,
        text=True,
        check=False,
    )
    if made.returncode:
        raise SystemExit(
            f"no disk of a chosen size can be mounted here ({made.stderr.strip()}); "
            "run this study as root, where mounting is allowed"
        )
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", place], check=True)


def list_disk_runs(place: Path, count: int) -> KeyedRuns:
    """A run for each command and size, on disks that are small or filled in turns.

    Args:
        count: of sizes, from 4 kB to what the command needs.
    """
    load_program()
    inputs = place / "inputs"
    make_inputs(inputs)
    for name in COMMANDS:
        earlier = copy_folder(inputs, place / name)
        make_earlier(name, earlier)
        need = _measure_need(name, inputs, place / f"need-{name}")
        sizes = np.geomspace(_SMALLEST, 1.2 * need + _SMALLEST, count)
        for k, size in enumerate(sizes):
            variant = _VARIANTS[k % len(_VARIANTS)]
            rounded = int(4 * np.ceil(size / 4))
            start = earlier if variant == "filled" else inputs
            play = partial(try_disk, name, start, variant, rounded)
            yield f"{name} {variant} {k}", play


def _measure_need(name: str, start: Path, place: Path) -> int:
    """What a command needs of a disk that holds nothing else [kB]."""
    folder = copy_folder(start, place)
    noted = folder / "used"
    with mount_disk(folder / OUT, _LARGE):

        def tell_used(moment: int) -> None:
            note(noted, shutil.disk_usage(folder / OUT).used // 1024)

        prepare = partial(call_at_writes, tell_used, folder / OUT)
        insist(run_writer(COMMANDS[name].start, folder, prepare=prepare))
    return read_largest(noted)


def try_disk(name: str, start: Path, variant: str, size: int) -> Record:
    """Run a command whose folder is on a disk with little room.

    Args:
        variant: "small": the disk is small and empty; "filled": what is there leaves
            little room.
        size: the room [kB].
    """
    command = COMMANDS[name]
    with tempfile.TemporaryDirectory(prefix="disk-") as home:
        folder = copy_folder(start, Path(home) / "work")
        out, kept = folder / OUT, Path(home) / "kept"
        shutil.move(out, kept)
        out.mkdir()
        filled = variant == "filled"
        with mount_disk(out, _LARGE if filled else size):
            shutil.copytree(kept, out, dirs_exist_ok=True)
            if filled:
                _fill(out, size)
            words = command.again if filled else command.start
            ended = run_writer(words, folder)
            faults = list_faults(ended, folder, codes=(0, 1))
            faults += _list_losses(name, folder, kept if filled else None, ended)
    record = {"room": size, "code": ended.code, "command": words}
    return {**record, "faults": [*map(asdict, faults)], "stderr": ended.stderr[-2000:]}


def _list_losses(
    name: str, folder: Path, kept: Path | None, ended: Ended
) -> list[Fault]:
    """What a command lost of what was there, or left half-written.

    Args:
        kept: copy of what was there before; None where there was nothing.
    """
    command = COMMANDS[name]
    file = folder / command.main
    if not file.exists():
        return [Fault("lost", f"{command.main} is gone")] if kept else []
    if not is_whole(name, folder):
        return [Fault("lost", f"{command.main} is damaged")]
    # a run that goes on may have got further; what is replaced stays until the end
    if kept and ended.code != 0 and "--resume" not in command.again:
        old = kept / file.relative_to(folder / OUT)
        if old.read_bytes() != file.read_bytes():
            return [Fault("lost", f"{command.main} is another one")]
    return []


def _fill(out: Path, room: int) -> None:
    """Fill a disk up, but for some room [kB]."""
    free = shutil.disk_usage(out).free
    (out / "ballast").write_bytes(bytes(max(free - 1024 * room, 0)))
