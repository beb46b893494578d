"""Copies of HDF5 files with one member replaced, and what becomes of reading them."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np

from selfheal.errors import SelfhealError

GONE, GROUP = object(), object()
# by what an attribute or a dataset is replaced, made of the values that it had
REPLACEMENTS: dict[str, Callable[[np.ndarray], object]] = {
    "missing": lambda old: GONE,
    "a group": lambda old: GROUP,
    "of wrong rank": lambda old: np.zeros((1,) * 5),
    "JSON null": lambda old: "null",
    "a text": lambda old: "x",
    "a number": lambda old: 3.5,
    "empty": lambda old: np.empty(0),
    "one row less": lambda old: old[:-1] if old.ndim else old,
    "NaN": lambda old: np.full(old.shape, np.nan),
    "negative": lambda old: np.full(old.shape, -1),
    "huge": lambda old: np.full(old.shape, 2**62),
}
NEVER_FIT = ("missing", "a group", "of wrong rank")


def list_members(path: Path) -> list[str]:
    """Names of the datasets of a file, and of its attributes with "@" before them."""
    found = []
    with h5py.File(path) as file:
        file.visititems(
            lambda name, item: (
                found.append(name) if isinstance(item, h5py.Dataset) else None
            )
        )
        return [*(f"@{name}" for name in file.attrs), *found]


def replace_member(path: Path, member: str, value: object) -> None:
    """Put a value in the place of a member."""
    with h5py.File(path, "r+") as file:
        place = file.attrs if member.startswith("@") else file
        name = member.removeprefix("@")
        del place[name]
        if value is GROUP:
            file.require_group(name)
        elif value is not GONE:
            place[name] = value


def make_damaged_copies(path: Path) -> Iterator[tuple[str, str, Path]]:
    """Member, what it is replaced by, and a copy of the file, one after the other."""
    copy = path.with_name("damaged.h5")
    for member in list_members(path):
        with h5py.File(path) as file:
            old = np.asarray(
                file.attrs[member[1:]] if member[0] == "@" else file[member][()]
            )
        is_text = old.dtype.kind not in "fiu"
        for what, make in REPLACEMENTS.items():
            if is_text and what in ("one row less", "NaN", "negative", "huge"):
                continue
            shutil.copy(path, copy)
            replace_member(copy, member, make(old))
            yield member, what, copy


def find_faults(
    path: Path, read: Callable[[Path, str], None]
) -> tuple[dict[tuple[str, str], str], set[tuple[str, str]]]:
    """Damages that end in another error, and those that are read."""
    faults, passed = {}, set()
    for member, what, damaged in make_damaged_copies(path):
        try:
            read(damaged, member)
            passed.add((member, what))
        except SelfhealError as error:
            if str(damaged) not in str(error):
                faults[member, what] = f"no path: {error}"
        except Exception as error:
            faults[member, what] = repr(error)
    return faults, passed
