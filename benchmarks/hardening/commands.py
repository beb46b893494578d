"""Commands that write: where each runs, what it leaves, whether that is whole."""

import json
import shutil
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import h5py

from benchmarks.hardening.log_files import FILES
from benchmarks.hardening.originals import (
    insist,
    take_back,
    write_identified_run,
    write_small_files,
)
from benchmarks.hardening.process import Ended, run_forked, run_selfheal

OUT = "out"  # folder of what a command writes, in its working folder
_SECONDS = 120.0  # [s] that a command may take; it works, and is no reader alone


@dataclass(frozen=True)
class WritingCommand:
    """A command that writes files.

    Attributes:
        again: its arguments where files of an earlier run are there: to go on with
            that run, or to replace them.
        resumed: its arguments after a kill; `start` where they are empty or where
            there is no file to go on with.
        main: path of its first file.
        others: paths of its other files.
    """

    start: str
    again: str
    resumed: str
    main: str
    others: Sequence[str] = ()


COMMANDS = {
    name: WritingCommand(**table)
    for name, table in tomllib.loads((FILES / "commands.toml").read_text()).items()
}


def run_writer(words: str, folder: Path, **more: Any) -> Ended:
    """Run a command that writes, in its working folder."""
    return run_selfheal(words.split(), folder, seconds=_SECONDS, **more)


def make_inputs(folder: Path) -> None:
    """Fill a new folder with all that the commands read, and an empty one for OUT."""
    folder.mkdir()
    for write in (write_small_files, write_identified_run):
        insist(run_forked(partial(write, folder), folder))
    (folder / "pipe").unlink()
    (folder / OUT).mkdir()


def make_earlier(name: str, folder: Path) -> None:
    """Have OUT hold an earlier run of a command, one that is to go on where it can."""
    command = COMMANDS[name]
    insist(run_writer(command.start, folder))
    if "--resume" in command.again:
        take_back(folder / command.main)
        for other in command.others:
            (folder / other).unlink()


def read_main(name: str, folder: Path) -> Any:
    """All that a command's first file says but times and where it lies.

    Raises:
        Exception: the file is damaged.
    """
    path = folder / COMMANDS[name].main
    if path.suffix == ".json":
        return _drop_times(json.loads(_cut_paths(path.read_text(), folder)))
    found: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        found |= {f"/{k}": _parse(v, folder) for k, v in file.attrs.items()}

        def read(key: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and not key.endswith("/seconds"):
                found[key] = _parse(item[()], folder)

        file.visititems(read)
    return found


def _parse(value: Any, folder: Path) -> Any:
    """A value of HDF5: JSON as what it says, arrays as text of all their bits."""
    if isinstance(value, bytes | str):
        text = value.decode() if isinstance(value, bytes) else value
        text = _cut_paths(text, folder)
        try:
            return _drop_times(json.loads(text))
        except ValueError:
            return text
    return value.tobytes().hex() if hasattr(value, "tobytes") else value


def _cut_paths(text: str, folder: Path) -> str:
    """A text with paths from a folder on, as files in two folders are compared."""
    return text.replace(f"{folder}/", "")


def _drop_times(document: Any) -> Any:
    """A JSON document without the seconds that things took."""
    if isinstance(document, dict):
        return {k: _drop_times(v) for k, v in document.items() if k != "seconds"}
    return [*map(_drop_times, document)] if isinstance(document, list) else document


def is_whole(name: str, folder: Path) -> bool:
    """Whether a command's first file can be read to its end; looked at from outside."""
    ended = run_forked(lambda: read_main(name, folder) and None, folder)
    return ended.code == 0


def copy_folder(folder: Path, place: Path) -> Path:
    """Copy a working folder to a new place, and give the place."""
    return Path(shutil.copytree(folder, place))
