"""Folders of runs: names in, folders that are free or may be written over out."""

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import chain, count
from pathlib import Path

import typer

from selfheal.errors import InputError
from selfheal.files import check_writable_folder


class RunFolder:
    """Where a command's run goes: a folder the user named, or runs/NAME.

    Attributes:
        path: of the folder, once it was made.
    """

    def __init__(self, out: Path | None, force: bool) -> None:
        """`out`: what the user named; `force`: a folder that is taken may be used."""
        self.out, self.force = out, force
        self.path = Path()

    def __call__(self, name: str) -> Path:
        """Make the folder for a run of this name, with a number behind if it is taken.

        It is made here, so that no other process takes it too.
        """
        if self.out is not None:
            self.path = check_writable_folder(self.out)
            return self.path
        runs = check_writable_folder("runs")
        for each in _number(name):
            self.path = runs / each
            with suppress(FileExistsError):
                self.path.mkdir(exist_ok=self.force)
                break
        return self.path


def choose_run_folder(name: str) -> Path:
    """runs/NAME, or with a number behind if that is taken; the command makes it."""
    runs = Path("runs")
    return next(runs / n for n in _number(name) if not os.path.lexists(runs / n))


def _number(name: str) -> Iterator[str]:
    """A name, and then that with numbers behind."""
    return chain([name], (f"{name}.{number}" for number in count(2)))


def refuse_existing(path: Path, used: Iterable[Path], *, force: bool) -> None:
    """Refuse to write over files that are used, and over any other unless forced."""
    if path.resolve() in [each.resolve() for each in used]:
        raise InputError(f"--out {path} would overwrite what it is made of")
    if os.path.lexists(path) and not force:
        raise InputError(
            f"{path} is there already; --force replaces it, or give another name by "
            "--out"
        )


def refuse_settings(context: typer.Context, heeded: Sequence[str] = ()) -> None:
    """Refuse what a resumed run would not heed."""
    given = [
        "--" + name.replace("_", "-")
        for name in context.params
        if name not in ("resume", "as_json", "progress", *heeded)
        and (source := context.get_parameter_source(name))
        and source.name == "COMMANDLINE"
    ]
    if given:
        raise InputError(
            f"--resume takes every setting from the run; leave out {', '.join(given)}"
        )
