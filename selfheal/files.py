"""Files that are whole or absent: paths in; safe places to write, open runs out."""

import errno
import glob
import io
import math
import os
import reprlib
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TYPE_CHECKING
from uuid import uuid4

from .errors import InputError, RunFileError, RunLockError, SelfhealError
from .limited_reading import explain_dangerous
from .machine import lock

if TYPE_CHECKING:
    import h5py
    from typing_extensions import Buffer

# values that an HDF5 file may state; chosen: 1.6 GB as float64, which is two days at
# 1 kHz of one signal, or an hour of 55
MAX_VALUES = 200_000_000
# what h5py raises, beside OSError, of a file that is damaged
HDF5_ERRORS = (KeyError, ValueError, TypeError, RuntimeError, SystemError)
# errors of writing that are the machine's, whatever path was given
DISK_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


def check_writable_folder(folder: str | os.PathLike[str]) -> Path:
    """Make `folder` if it is missing and prove that a file can be written there.

    Raises:
        InputError: nothing can be written there; the message says why.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # permission bits do not tell: root passes them, read-only mounts ignore them
        with tempfile.TemporaryFile(dir=folder):  # it has no name: a kill leaves none
            pass
    except OSError as error:
        raise make_write_error(f"into {folder}", error) from error
    return folder


def check_writable(path: str | os.PathLike[str]) -> None:
    """Prove that `path` could be made or replaced, and make nothing yet.

    Raises:
        InputError: nothing can be made there; the message says why.
    """
    real = Path(os.path.realpath(path))
    try:
        _stat_path(real)  # a name that is too long, or a link to itself, says so here
        if real.name:
            _stat_path(_make_temporary_path(real))
        home = real.parent
        while not home.exists():
            home = home.parent
    except OSError as error:
        raise make_write_error(path, error) from error
    if not home.is_dir():
        raise InputError(f"cannot write {os.fspath(path)}: {home} is a file")
    check_writable_folder(home)


def _stat_path(path: Path) -> None:
    """Ask the system for a path that need not be there; OSError: it never can be."""
    with suppress(FileNotFoundError, NotADirectoryError):
        os.stat(path)


def explain_unreadable(path: str | os.PathLike[str]) -> str:
    """Why there is no file to read at a path; empty where there is one."""
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        return "there is no such file"
    except OSError as error:
        return f"it cannot be read: {_find_reason(error)}"
    if stat.S_ISDIR(mode):
        return "it is a folder"
    return "" if stat.S_ISREG(mode) else "it is no regular file"


def check_file(path: str | os.PathLike[str]) -> None:
    """Refuse a path at which there is no file to read.

    Raises:
        InputError: there is none, or something else.
    """
    if reason := explain_unreadable(path):
        raise InputError(f"{os.fspath(path)}: {reason}")


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path beside `path`; on success it takes that name at once.

    A reader, or a process killed half-way, finds the old file or the new one, never
    a part. After an exception the old file stands and the temporary one is gone. What
    a killed process left beside it goes, too.

    Raises:
        InputError: nothing can be written at `path`; said before the body runs.
        SelfhealError: writing failed later, on a full disk say.
    """
    target = Path(os.path.realpath(path))  # a link keeps pointing where it did
    temporary = _make_temporary_path(target)
    try:
        if target.is_dir():
            raise IsADirectoryError(None, "it is a folder")
        held = temporary.open("xb")
    except OSError as error:
        raise make_write_error(path, error) from error
    try:
        with held:
            with suppress(OSError):  # a file system may have no locks
                lock(held, wait=True)
            _remove_abandoned(target)
            yield temporary
            os.replace(temporary, target)
    except OSError as error:
        raise SelfhealError(f"cannot write {path}: {_find_reason(error)}") from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write a text as UTF-8, whatever the locale; errors as of `atomic_path`."""
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _remove_abandoned(target: Path) -> None:
    """Remove temporary files of a target that no process writes any more."""
    for path in target.parent.glob(f".{glob.escape(target.name)}.????????.tmp"):
        with suppress(OSError), path.open("rb") as file:
            lock(file, wait=False)
            path.unlink()


class _ForgivingFile(io.FileIO):
    """A file for HDF5 to write, which never fails: what went wrong is kept.

    On a full disk HDF5 itself fails while it closes a file, with a segmentation fault
    even.

    Attributes:
        error: the first one, after which nothing is written; None if all went well.
    """

    error: OSError | None = None

    def readinto(self, buffer: "Buffer") -> int:
        """Fill a buffer; what was never written reads as zeros."""
        count = super().readinto(buffer) or 0
        view = memoryview(buffer).cast("B")
        view[count:] = bytes(len(view) - count)
        return len(view)

    def write(self, content: "Buffer") -> int:
        """Write all of a buffer, unless writing has failed before."""
        view, done = memoryview(content).cast("B"), 0
        try:
            while done < len(view) and self.error is None:
                done += super().write(view[done:])
        except OSError as error:
            self.error = error
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Change the length of the file [B], unless writing has failed before."""
        size = self.tell() if size is None else size
        try:
            if self.error is None:
                super().truncate(size)
        except OSError as error:
            self.error = error
        return size


@contextmanager
def atomic_hdf5(path: str | os.PathLike[str]) -> "Iterator[h5py.File]":
    """Give an empty HDF5 file; on success it is at `path` at once.

    Raises:
        InputError: nothing can be written at `path`; said before the body runs.
        SelfhealError: writing failed later, on a full disk say.
    """
    import h5py

    with atomic_path(path) as temporary, _ForgivingFile(temporary, "r+") as disk:
        try:
            with h5py.File(disk, "w") as file:
                yield file
        except (OSError, *HDF5_ERRORS):
            if disk.error is None:
                raise
        if disk.error is not None:
            raise disk.error


@contextmanager
def lock_file(path: str | os.PathLike[str]) -> Iterator[None]:
    """Keep a file or folder to this process while it works on it, by PATH.lock.

    Raises:
        RunLockError: another process works on it, or no lock can be made beside it.
        SelfhealError: the disk is full.
    """
    beside = Path(f"{path}.lock")
    busy = f"{path}: another process is working on it"
    try:
        file = beside.open("w")
    except OSError as error:
        if error.errno in DISK_ERRORS:
            raise make_write_error(beside, error) from error
        raise RunLockError(f"cannot write beside {path}: {error.strerror}") from error
    with file:
        try:
            lock(file, wait=False)
        except BlockingIOError as error:
            raise RunLockError(busy) from error
        if not _is_same_file(file, beside):  # another process has just let go of it
            raise RunLockError(busy)
        try:
            yield
        finally:
            beside.unlink(missing_ok=True)


def _is_same_file(file: IO[str], path: Path) -> bool:
    """Whether an open file is still the one at a path."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.stat())
    except FileNotFoundError:
        return False


@contextmanager
def open_run(
    path: str | os.PathLike[str], what: str, *, form: str, version: int
) -> "Iterator[h5py.File]":
    """Open a run's HDF5 file and check that it is what its reader takes.

    Args:
        what: such a file in words, "run file" say.
        form: its attribute `format`.
        version: its attribute `version`.

    Yields:
        The open file. What goes wrong with it, or lacks in it, until it is closed is a
        `RunFileError`.

    Raises:
        RunFileError: missing, held by another process, truncated, of another format or
            version, or damaged.
    """
    import h5py

    path = Path(path)
    if not path.is_file():
        raise RunFileError(f"{path}: no such run file")
    if reason := explain_dangerous(path, f"{__name__}:read_members", "h5py"):
        raise RunFileError(f"{path}: {reason}")
    try:
        with h5py.File(path, "r") as file:
            _check_run(path, file.attrs, what, form, version)
            yield file
    except BlockingIOError as error:
        raise RunFileError(f"{path}: another process holds it open") from error
    except PermissionError as error:
        raise RunFileError(f"{path}: it may not be read") from error
    except OSError as error:
        message = f"{path}: truncated, or not an HDF5 file: {error}"
        raise RunFileError(message) from error
    except HDF5_ERRORS as error:
        raise RunFileError(f"{path}: a damaged {what}: {error}") from error


def read_members(path: str | os.PathLike[str]) -> None:
    """Read all of an HDF5 file that can be, whatever that does to the process.

    What is damaged is passed by: who reads the file next may not begin with it.

    Raises:
        OSError, RuntimeError, KeyError, ValueError, TypeError: h5py's, of a file that
            cannot be opened or listed.
    """
    import h5py

    damaged = suppress(OSError, *HDF5_ERRORS)
    with h5py.File(path, "r") as file:
        for name in ("format", "version"):
            with damaged:
                file.attrs.get(name)
        with damaged:
            dict(file.attrs)
        for _, member in walk_hdf5(file):
            if isinstance(member, h5py.Group | h5py.Dataset):
                with damaged:
                    dict(member.attrs)
            if isinstance(member, h5py.Dataset):
                with damaged:
                    member[()]


def walk_hdf5(group: "h5py.Group") -> "Iterator[tuple[str, h5py.HLObject]]":
    """Path and member of all that an HDF5 group holds, each group once.

    Links to elsewhere are not followed: in place of their members they come themselves.
    There are no callbacks, for h5py makes a `SystemError` of what is raised in one.
    """
    import h5py

    left, seen = [("", group)], set()
    while left:
        place, group = left.pop()
        for name in group:
            path = f"{place}{name}"
            link = group.get(name, getlink=True)
            member = group[name] if isinstance(link, h5py.HardLink) else link
            yield path, member
            if isinstance(member, h5py.Group):
                address = h5py.h5o.get_info(member.id).addr
                if address not in seen:  # else a group that holds itself
                    seen.add(address)
                    left.append((f"{path}/", member))


def count_values(dataset: "h5py.Dataset") -> int:
    """How many values reading a dataset unpacks: one chunk always as a whole."""
    return max(dataset.size or 0, math.prod(dataset.chunks or (0,)))


def _check_run(
    path: Path, attrs: "h5py.AttributeManager", what: str, form: str, version: int
) -> None:
    """Refuse a file of another format or version."""
    found = attrs.get("format")
    if found != form:
        found = reprlib.repr(found)
        raise RunFileError(f"{path}: format {found}, not a {what} ({form!r})")
    if (found := attrs["version"]) != version:
        raise RunFileError(
            f"{path}: {what} version {str(found)[:40]}; this program reads version "
            f"{version}"
        )


def _make_temporary_path(path: Path) -> Path:
    return path.with_name(f".{path.name}.{uuid4().hex[:8]}.tmp")


def make_write_error(path: str | os.PathLike[str], error: OSError) -> SelfhealError:
    """What to raise if a path cannot be written: `InputError`, but for a full disk."""
    kind = SelfhealError if error.errno in DISK_ERRORS else InputError
    return kind(f"cannot write {os.fspath(path)}: {_find_reason(error)}")


def _find_reason(error: OSError) -> str:
    return error.strerror or str(error)
