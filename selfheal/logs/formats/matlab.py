"""MATLAB's files: takes MAT of version 4 to 7.3, gives streams of their variables."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InputError
from ...limited_reading import explain_dangerous
from ..base import Log, LogFormat
from .arrays import ArrayLog
from .common import explain_damage, read_start
from .hdf5 import list_datasets, read_first_rows
from .run_groups import make_tables

_MAX_DEPTH = 16  # of structures in structures; chosen
_MAX_STRUCTURES = 10_000  # in an array of them; chosen


class MatlabFormat(LogFormat):
    """MAT files with numbers and structures of them."""

    name = "MATLAB (.mat)"

    def recognizes(self, path: Path) -> bool:
        """Whether it says so at its start, or by its suffix, as version 4 has none."""
        start = read_start(path, 20)
        return start.startswith(b"MATLAB ") or (
            path.suffix.lower() == ".mat" and bool(start)
        )

    def open(self, path: Path) -> Log:
        """Open a file."""
        is_hdf5 = read_start(path, 520).startswith(b"MATLAB 7.3") or (
            read_start(path).startswith(b"\x89HDF")
        )
        read = read_first_rows if is_hdf5 else load_variables
        library = "h5py" if is_hdf5 else "scipy.io"
        reader = f"{read.__module__}:{read.__name__}"
        if reason := explain_dangerous(path, reader, library):
            raise InputError(f"{path}: {reason}")
        with explain_damage(path, "MAT file"):
            if is_hdf5:
                import h5py

                file = h5py.File(path, "r")
                arrays = {
                    name: _Turned(dataset)
                    for name, dataset in list_datasets(file)
                    if not name.startswith("#") and len(dataset.shape) == 2
                }
            else:
                arrays = dict(list_arrays(load_variables(path)))
            return ArrayLog(path, make_tables(orient(arrays)))


def load_variables(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Variables of a file of version 4 to 7, whatever reading them does.

    Raises:
        ValueError, TypeError, OSError: scipy's, of a file that is damaged.
    """
    from scipy.io import loadmat

    return loadmat(path)


def list_arrays(value: Any, path: str = "", depth: int = 0) -> Mapping[str, Any]:
    """Arrays in variables and structures, by their paths.

    Args:
        value: variables, or what scipy makes of one.
        depth: of it; what is deeper than any log is left out.
    """
    found = dict[str, Any]()
    if isinstance(value, Mapping):
        for name, member in value.items():
            if not name.startswith("__"):
                found |= list_arrays(member, name, depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.names and depth < _MAX_DEPTH:
        items = value.ravel()[:_MAX_STRUCTURES]
        for number, item in enumerate(items):
            start = path if len(items) == 1 else f"{path}/{number + 1}"
            for name in value.dtype.names:
                found |= list_arrays(item[name], f"{start}/{name}", depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        found[path] = value
    return found


def orient(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Matrices (T, d), and vectors as (T), of those that stand either way round.

    Args:
        arrays: (T, d) or (d, T); what has one row or one column is a vector.
    """
    found = dict[str, Any]()
    lengths = {max(a.shape) for a in arrays.values() if 1 in a.shape and a.ndim == 2}
    for name, array in arrays.items():
        if array.ndim == 2 and 1 in array.shape:
            found[name] = array.reshape(-1)
        elif array.ndim == 2 and array.shape[0] not in lengths:
            found[name] = array.T if array.shape[1] in lengths else array
        else:
            found[name] = array
    return found


class _Turned:
    """A dataset of HDF5 as MATLAB sees it: the last axis is the first.

    Attributes:
        dtype: of the numbers.
        shape: of the matrix, or of the vector.
        ndim: 2, or 1 of a vector.
    """

    def __init__(self, dataset: Any, turn: bool = True, flat: bool = False) -> None:
        self._dataset, self._turn, self._flat = dataset, turn, flat
        rows, columns = dataset.shape[::-1] if turn else dataset.shape
        self.dtype = dataset.dtype
        self.shape = (max(rows, columns),) if flat else (rows, columns)
        self.ndim = len(self.shape)

    @property
    def T(self) -> "_Turned":
        """The matrix transposed."""
        return _Turned(self._dataset, not self._turn)

    def reshape(self, _: int) -> "_Turned":
        """The vector that a matrix of one row or one column is."""
        return _Turned(self._dataset, self._dataset.shape[0] == 1, flat=True)

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, rows: slice) -> Any:
        found = self._dataset[:, rows].T if self._turn else self._dataset[rows]
        return found.reshape(-1) if self._flat else found
