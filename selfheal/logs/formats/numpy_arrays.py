"""NumPy's files: takes NPY and NPZ, gives streams of the arrays of one length."""

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO

import numpy as np

from ...errors import InputError
from ...files import MAX_VALUES
from ..base import Log, LogFormat
from .common import MAX_ELEMENTS, explain_damage, read_start
from .run_groups import make_tables
from .tables import TableLog

_MAGIC = b"\x93NUMPY"


class NumpyFormat(LogFormat):
    """NPY and NPZ without Python objects."""

    name = "NumPy (.npy, .npz)"

    def recognizes(self, path: Path) -> bool:
        """Whether it is an array, or a zip archive of arrays."""
        start = read_start(path)
        if start.startswith(_MAGIC):
            return True
        if not start.startswith(b"PK"):
            return False
        try:
            with zipfile.ZipFile(path) as archive:
                return any(name.endswith(".npy") for name in archive.namelist())
        except Exception:  # zipfile has many for archives that are damaged
            return path.suffix == ".npz"

    def open(self, path: Path) -> Log:
        """Open a file."""
        with explain_damage(path, "NumPy file"):
            if read_start(path).startswith(_MAGIC):
                array = np.load(path, mmap_mode="r", allow_pickle=False)
                return TableLog(path, make_tables(part_array(array)))
            with zipfile.ZipFile(path) as archive:
                return TableLog(path, make_tables(_read_archive(archive)))


def part_array(array: np.ndarray, name: str = "") -> dict[str, np.ndarray]:
    """Arrays (T) or (T, d) of one array, which may be of records.

    Args:
        name: of it; "" makes its columns have numbers for names.
    """
    if array.dtype.names:
        start = f"{name}." if name else ""
        return {f"{start}{field}": array[field] for field in array.dtype.names}
    if name:
        return {name: array}
    if array.ndim == 2 and array.shape[1] <= MAX_ELEMENTS:
        return {str(k): array[:, k] for k in range(array.shape[1])}
    return {"0": array}


def _read_archive(archive: zipfile.ZipFile) -> Mapping[str, np.ndarray]:
    """Arrays of an archive by their names; the sizes are checked before."""
    found, left = dict[str, np.ndarray](), 8 * MAX_VALUES
    for member in archive.infolist():
        if not member.filename.endswith(".npy"):
            continue
        with archive.open(member) as file:
            size = _read_size(file)
        left -= size
        if size > member.file_size or left < 0:
            raise InputError("an array that is larger than its file, or than is read")
        with archive.open(member) as file:
            array = np.lib.format.read_array(file, allow_pickle=False)
        found |= part_array(array, member.filename.removesuffix(".npy"))
    return found


def _read_size(file: IO[bytes]) -> int:
    """The size [B] that the header of an array states."""
    version = np.lib.format.read_magic(file)
    if version == (1, 0):
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
    else:
        shape, _, dtype = np.lib.format.read_array_header_2_0(file)
    if dtype.hasobject:
        raise InputError("it holds Python objects, which may run any program")
    return math.prod(shape) * dtype.itemsize
