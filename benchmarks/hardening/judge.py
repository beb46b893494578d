"""What is wrong with how a command ended: its end and its folder in; faults out."""

import re
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from benchmarks.hardening.process import Ended
from benchmarks.writer import ROOT

MOST_MEGABYTES = 1000.0  # of a command; chosen
_LONGEST_MESSAGE = 2000  # characters; chosen
_LEFTOVERS = ("*.tmp", "*.lock", "*.old", "MUJOCO_LOG.TXT")
_UNFINISHED = ("imported.h5", "guess.toml")  # what a command that refused may not leave
_NOISE = re.compile(r"^(?:WARNING|HDF5-DIAG|Exception ignored|.*Warning: ).*", re.M)
_FRAME = re.compile(r'File "([^"]*)", line (\d+),? in ([\w<>]+)')


@dataclass(frozen=True)
class Fault:
    """Something that a command must not do.

    Attributes:
        what: "hang", "crash", "traceback", "exit code", "message", "warning", "memory"
            or "leftover".
        detail: where, or how; the same for all that have the same cause.
    """

    what: str
    detail: str


def list_faults(
    ended: Ended, folder: Path, *, codes: Collection[int] = (0, 2)
) -> list[Fault]:
    """All that is wrong with how a command ended."""
    found = list[Fault]()
    if ended.megabytes >= MOST_MEGABYTES:
        place = _find_innermost(ended.stderr)
        found.append(Fault("memory", place or f"over {MOST_MEGABYTES:.0f} MB"))
    if ended.code is None:
        what = "hang" if ended.hung else "crash"
        return [*found, Fault(what, f"{ended.signal}: {_find_innermost(ended.stderr)}")]
    if "Traceback (most recent call last)" in ended.stderr:
        found.append(Fault("traceback", _describe_traceback(ended.stderr)))
    elif ended.code not in codes:
        found.append(Fault("exit code", f"{ended.code}: {_shorten(ended.stderr)}"))
    elif ended.code and (reason := _find_message_fault(ended.stderr)):
        found.append(Fault("message", reason))
    if noise := _NOISE.search(ended.stderr):
        found.append(Fault("warning", _shorten(noise[0])))
    names = list_leftovers(folder)
    if ended.code:
        names += [name for name in _UNFINISHED if (folder / name).exists()]
    return [*found, *(Fault("leftover", name) for name in names)]


def list_leftovers(folder: Path) -> list[str]:
    """Names of files that no command may leave, random parts as *."""
    found = {path.name for pattern in _LEFTOVERS for path in folder.rglob(pattern)}
    return sorted({re.sub(r"\b[0-9a-f]{8}\b", "*", name) for name in found})


def _find_message_fault(stderr: str) -> str:
    """What is wrong with the message of a command that refused; "" if nothing."""
    begins = [m.start() for m in re.finditer("^selfheal: ", stderr, re.M)]
    if len(begins) != 1:
        return f"{len(begins)} messages: {_shorten(stderr)}"
    if len(stderr) - begins[0] > _LONGEST_MESSAGE:
        return f"longer than {_LONGEST_MESSAGE} characters: {_shorten(stderr)}"
    return ""


def _describe_traceback(stderr: str) -> str:
    """The last line of a traceback, and the last line of the program in it."""
    parts = stderr.split("Traceback (most recent call last)")[1:]
    last = next((p for p in reversed(parts) if _list_places(p)), parts[-1])
    lines = [line for line in last.splitlines()[1:] if line[:1].strip()]
    place = "".join(f"({place})" for place in _list_places(last)[-1:])
    return f"{_shorten(lines[0]) if lines else ''} {place}"


def _list_places(stderr: str) -> list[str]:
    """The program's own lines in a traceback or a stack, as file:line name."""
    own = []
    for file, line, name in _FRAME.findall(stderr):
        path = Path(file).resolve()
        if any(path.is_relative_to(ROOT / top) for top in ("selfheal", "cli")):
            own.append(f"{path.relative_to(ROOT)}:{line} {name}")
    return own


def _find_innermost(stack: str) -> str:
    """The innermost of the program's own lines, which a fatal signal shows first."""
    return next(iter(_list_places(stack)), "")


def _shorten(text: str) -> str:
    """The start of a text in one line, paths and digits that vary left out."""
    text = re.sub(r"/tmp/[^/\s]+/|time = .*", "", " ".join(text.split()))
    return text if len(text) < 160 else f"{text[:150]} ..."
