"""Folders of runs: names in, folders that are free or may be written over out."""

from collections.abc import Sequence
from itertools import chain, count
from pathlib import Path

import typer

from selfheal.errors import InputError
from selfheal.files import check_writable_folder


def make_run_folder(name: str, force: bool) -> Path:
    """runs/NAME, or with a number behind if that is taken and not to be overwritten.

    Made here, so that no other process takes it too.
    """
    runs = check_writable_folder("runs")
    names = chain([name], (f"{name}.{number}" for number in count(2)))
    return next(runs / n for n in names if _make_folder(runs / n, force))


def _make_folder(folder: Path, force: bool) -> bool:
    """Whether this process made the folder, or may use the one that is there."""
    try:
        folder.mkdir(exist_ok=force)
    except FileExistsError:
        return False
    return True


def clear_run(path: Path, force: bool, others: Sequence[str]) -> None:
    """Refuse to overwrite a run file and what belongs to it, or remove them if forced.

    Args:
        path: of the run file.
        force: remove them.
        others: names of files beside it.
    """
    files = [path, *(path.with_name(name) for name in others)]
    old = [file for file in files if file.exists()]
    if old and not force:
        resume = f"go on with it by --resume {path}, " * path.exists()
        raise InputError(
            f"{old[0]} is there already; {resume}start over by --force, or name "
            "another folder by --out"
        )
    for file in old:
        file.unlink()


def refuse_settings(context: typer.Context, heeded: Sequence[str] = ()) -> None:
    """Refuse what a resumed run would not heed."""
    given = [
        "--" + name.replace("_", "-")
        for name in context.params
        if name not in ("resume", "as_json", *heeded)
        and (source := context.get_parameter_source(name))
        and source.name == "COMMANDLINE"
    ]
    if given:
        raise InputError(
            f"--resume takes every setting from the run; leave out {', '.join(given)}"
        )
