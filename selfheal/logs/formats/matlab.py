"""MATLAB's files: takes MAT of version 4 to 7.3, gives streams of their variables."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import InputError
from ...limited_reading import explain_dangerous
from ..base import Log, LogFormat
from .common import explain_damage, read_start
from .hdf5 import list_datasets, read_first_rows
from .run_groups import make_tables
from .tables import TableLog

if TYPE_CHECKING:
    import h5py

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

                members = dict(list_datasets(h5py.File(path, "r")))
                arrays = {
                    name: _Matrix(array, turn=True)
                    for name, array in members.items()
                    if not name.startswith("#") and len(array.shape) == 2
                }
            else:
                variables = list_arrays(load_variables(path))
                arrays = {
                    name: _Matrix(array)
                    for name, array in variables.items()
                    if array.ndim == 2
                }
            return TableLog(path, make_tables(_orient(arrays)))


def load_variables(path: str | os.PathLike[str]) -> dict[str, object]:
    """Variables of a file of version 4 to 7, whatever reading them does.

    Raises:
        ValueError, TypeError, OSError: scipy's, of a file that is damaged.
    """
    from scipy.io import loadmat

    return loadmat(path)


def list_arrays(value: object, path: str = "", depth: int = 0) -> dict[str, np.ndarray]:
    """Arrays (T, d) in variables and structures, by their paths.

    Args:
        value: variables, or what scipy makes of one.
        depth: of it; what is deeper than any log is left out.
    """
    found = dict[str, np.ndarray]()
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


@dataclass(frozen=True)
class _Matrix:
    """A matrix (T, d), or a vector (T), of an array that stands either way round.

    Attributes:
        array: (T, d), or (d, T) where it is turned, as HDF5 has what MATLAB wrote.
        flat: whether it is a vector.
    """

    array: "np.ndarray | h5py.Dataset"
    turn: bool = False
    flat: bool = False

    @property
    def dtype(self) -> np.dtype:
        return self.array.dtype

    @property
    def shape(self) -> tuple[int, ...]:
        shape = self.array.shape[:: -1 if self.turn else 1]
        return shape[:1] if self.flat else shape

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, rows: slice, /) -> object:
        found = np.asarray(self.array[:, rows] if self.turn else self.array[rows])
        found = found.T if self.turn else found
        return found.reshape(-1) if self.flat else found


def _orient(arrays: Mapping[str, _Matrix]) -> dict[str, _Matrix]:
    """Matrices with a row for each sample; those of one row or column as vectors."""
    found = dict[str, _Matrix]()
    lengths = {max(a.shape) for a in arrays.values() if 1 in a.shape}
    for name, matrix in arrays.items():
        rows, columns = matrix.shape
        if 1 in (rows, columns):
            found[name] = replace(matrix, turn=matrix.turn != (rows == 1), flat=True)
        elif rows not in lengths and columns in lengths:
            found[name] = replace(matrix, turn=not matrix.turn)
        else:
            found[name] = matrix
    return found
