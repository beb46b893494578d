"""HDF5 of others: takes robomimic's, ALOHA's and any file of arrays, gives streams."""

import json
import math
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import InputError
from ...files import MAX_VALUES, walk_hdf5
from ...limited_reading import explain_dangerous
from ..base import Log, LogFormat
from .common import explain_damage, read_start
from .json_runs import find_period
from .run_groups import make_tables
from .tables import TableLog, is_usable

if TYPE_CHECKING:
    import h5py

_MAGIC = b"\x89HDF\r\n\x1a\n"
_UNITS = ("unit", "units")  # attributes


class Hdf5Format(LogFormat):
    """HDF5 with arrays, as robomimic and ALOHA write it."""

    name = "HDF5 (robomimic, ALOHA, or arrays)"

    def recognizes(self, path: Path) -> bool:
        """Whether it begins as HDF5 does."""
        return read_start(path).startswith(_MAGIC)

    def open(self, path: Path) -> Log:
        """Open a file, which stays open as long as the log is used."""
        if reason := explain_dangerous(path, f"{__name__}:read_first_rows", "h5py"):
            raise InputError(f"{path}: {reason}")
        with explain_damage(path, "HDF5 file"):
            import h5py

            file = h5py.File(path, "r")
            if _read_text(file.attrs, "format") == "selfheal-recording":
                raise InputError(
                    f"{path}: a recording of selfheal already, which needs no import"
                )
            arrays = dict(list_datasets(file))
            units = {name: _find_unit(array) for name, array in arrays.items()}
            period = _find_period(file)
            tables = make_tables(arrays, units)
            return TableLog(path, [replace(t, period=period) for t in tables])


def read_first_rows(path: str | os.PathLike[str]) -> None:
    """Read the headers and the first rows of an HDF5 file, whatever that does.

    Raises:
        OSError, RuntimeError, KeyError, ValueError, TypeError: h5py's, of a file that
            is damaged.
    """
    import h5py

    with h5py.File(path, "r") as file:
        dict(file.attrs)
        _find_period(file)
        for _, array in list_datasets(file):
            dict(array.attrs)
            array[:1]


def list_datasets(
    group: "h5py.Group",
) -> Iterator[tuple[str, "h5py.Dataset | _Field"]]:
    """Paths of the datasets in a group that become columns, and what reads them.

    What is kept elsewhere is left out, so that nothing outside the file is opened.
    """
    import h5py

    for path, found in walk_hdf5(group):
        if not isinstance(found, h5py.Dataset) or found.is_virtual or found.external:
            continue
        # reading a row unpacks a chunk
        if found.shape is None or math.prod(found.chunks or (0,)) > MAX_VALUES:
            continue
        if found.dtype.names and len(found.shape) == 1:
            for name in found.dtype.names:
                field = _Field(found, name)
                if is_usable(field):
                    yield f"{path}.{name}", field
        elif is_usable(found) and (
            found.dtype.kind != "O" or h5py.check_string_dtype(found.dtype)
        ):
            yield path, found


class _Field:
    """One field of a dataset of records, (T) or (T, d)."""

    def __init__(self, dataset: "h5py.Dataset", name: str) -> None:
        self._dataset, self._name = dataset, name
        kind = dataset.dtype[name]
        self.dtype: np.dtype = kind.base
        self.shape: tuple[int, ...] = dataset.shape + kind.shape
        self.attrs: h5py.AttributeManager = dataset.attrs

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, rows: slice, /) -> object:
        return self._dataset[rows][self._name]


def _find_period(file: "h5py.File") -> float | None:
    """The time [s] from row to row that robomimic's `env_args` state, if they do."""
    import h5py

    if not isinstance(file.get("data", getlink=True), h5py.HardLink):
        return None
    try:
        return find_period(json.loads(_read_text(file["data"].attrs, "env_args")))
    except ValueError:  # none, or no JSON
        return None


def _find_unit(array: "h5py.Dataset | _Field") -> str:
    """The unit that an attribute of a dataset states."""
    found = (_read_text(array.attrs, name) for name in _UNITS)
    return next((unit for unit in found if unit), "")


def _read_text(attrs: "h5py.AttributeManager", name: str) -> str:
    """An attribute that is a text; "" of another or none."""
    value = attrs.get(name)
    value = value.decode(errors="replace") if isinstance(value, bytes) else value
    return value if isinstance(value, str) else ""
