"""Files of the runs that Python users start: a folder in; a locked run file out."""

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, TypeVar

from ..errors import InputError, UnknownNameError
from ..files import check_writable_folder, lock_file

if TYPE_CHECKING:
    from ..recovery.phased_run import PhasedRun

R = TypeVar("R", bound="PhasedRun")
PathLike = str | os.PathLike[str]
# a folder, or a function that makes one from the name of the run
Folder = PathLike | Callable[[str], Path]
REPORT = "report.html"


class RunOptions(TypedDict, total=False):
    """Where `identify`, `heal` and `recover` write; all of it may be left out.

    Attributes:
        out: folder for the run's file and its page; without it nothing is written. A
            function is given the run's name and makes the folder.
        resume: file of a run to continue, by its own settings.
        force: replace a run that is in `out` already.
    """

    out: Folder | None
    resume: PathLike | None
    force: bool


def check_options(options: Iterable[str], known: Collection[str]) -> None:
    """Refuse names of options that are not known."""
    for name in options:
        if name not in known:
            raise UnknownNameError("option", name, known)


def take_place(options: RunOptions) -> tuple[Folder | None, PathLike | None, bool]:
    """`out`, `resume` and `force` of options, which then are settings alone."""
    out, resume = options.pop("out", None), options.pop("resume", None)
    return out, resume, options.pop("force", False)


@contextmanager
def begin_run_file(
    out: Folder | None,
    file: str,
    *,
    name: str,
    force: bool,
    others: Sequence[str] = (REPORT,),
) -> Iterator[Path | None]:
    """Give the path of a new run file, locked until the run is left.

    Args:
        out: the folder, a function that makes it from the run's name, or None.
        file: name of the run file in that folder.
        force: replace a run that is there already.
        others: names of the files that belong to such a run.

    Yields:
        The path, at which there is no file yet; None where nothing is to be written.

    Raises:
        InputError: a run is there already, or nothing can be written there.
        RunLockError: another process works on it.
    """
    if out is None:
        yield None
        return
    folder = out(name) if callable(out) else check_writable_folder(out)
    path = folder / file
    with lock_file(path):
        clear_run(path, force, others)
        yield path


def follow_phases(
    run: R, steps: Iterable[R], path: Path | None, on_step: Callable[[R], None]
) -> R:
    """Go through the phases of a run.

    Args:
        run: as it begins, or as it was left.
        steps: the run after each phase.
        path: of the file that each is saved to; None saves nothing.
        on_step: given the run first, and after each phase.

    Returns:
        The run after its last phase.
    """
    from ..recovery.phased_run import save_phased_run

    on_step(run)
    for step in steps:
        run = step
        if path:
            save_phased_run(run, path)
        on_step(run)
    return run


def clear_run(path: Path, force: bool, others: Sequence[str]) -> None:
    """Refuse to overwrite a run file and what belongs to it, or remove them if forced.

    Raises:
        InputError: one of them is there already.
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
