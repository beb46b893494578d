"""Opens a log of any format that is installed: takes a path, gives the log."""

import os
import pkgutil
from collections.abc import Iterator
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

from ..errors import InputError
from . import formats
from .base import Log, LogFormat
from .formats.common import clean_text

GROUP = "selfheal.importers"


def open_log(path: str | os.PathLike[str]) -> Log:
    """Open the log at a path, which a format of ours or of an entry point reads.

    Raises:
        InputError: there is nothing, nobody recognizes it, or it is damaged.
    """
    path = Path(path)
    try:
        is_empty = path.is_file() and not path.stat().st_size
        path.stat()
    except FileNotFoundError as error:
        raise InputError(f"{path}: there is no such file or folder") from error
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: it cannot be read: {clean_text(error)}") from error
    if is_empty:
        raise InputError(f"{path}: it is empty; would fit: a log with rows")
    broken = list[str]()
    names = list[str]()
    for found in _load_formats(broken):
        names.append(found.name)
        try:
            is_this = found.recognizes(path)
        except Exception as error:  # of a third party's, or of a folder that is closed
            broken.append(f"{found.name} fails: {clean_text(error)}")
            continue
        if is_this:
            return _check_names(found.open(path))
    message = f"{path}: no log that is read; these are: {', '.join(names)}"
    raise InputError("; ".join([message, *broken]))


def _check_names(log: Log) -> Log:
    """Refuse a log with a name that no map can hold: one that no UTF-8 stands for."""
    for stream in log.streams:
        for name in (stream.name, *stream.columns):
            try:
                name.encode()
            except UnicodeEncodeError as error:
                raise InputError(
                    f"{log.path}: the name {name!r} has half a character in it; would "
                    "fit: whole ones"
                ) from error
    return log


def _load_formats(broken: list[str]) -> Iterator[LogFormat]:
    """The formats of `formats`, and those of others; adds why one does not load."""
    for found in pkgutil.iter_modules(formats.__path__, f"{formats.__name__}."):
        for kind in vars(import_module(found.name)).values():
            is_own = isinstance(kind, type) and kind.__module__ == found.name
            if is_own and issubclass(kind, LogFormat):
                yield kind()
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        try:
            yield point.load()()
        except Exception as error:  # whatever a third party's module raises
            broken.append(f"{point.value} does not load: {clean_text(error)}")
