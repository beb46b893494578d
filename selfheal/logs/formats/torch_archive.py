"""PyTorch's archives: takes what `torch.save` wrote, gives the tensors in it.

Neither torch nor pickle's own reader is used: a pickle can run any program. The reader
here knows the operations of containers and the two calls that make a tensor, and
refuses the rest.
"""

import math
import pickle
import zipfile
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from ...errors import InputError
from ...files import MAX_VALUES
from ..base import Log, LogFormat
from .common import explain_damage, read_start
from .tables import Table, TableLog, make_length_tables

_MAX_PICKLE = 10_000_000  # bytes; chosen: a log's has hundreds
_TYPES = {
    **{"Float": "f4", "Double": "f8", "Half": "f2", "Bool": "?", "Byte": "u1"},
    **{"Long": "i8", "Int": "i4", "Short": "i2", "Char": "i1"},
}
_TIMES = ("time", "t", "timestamp")
# operations of pickle that make numbers, texts, containers and calls
_ALLOWED = """
    PROTO FRAME STOP MARK POP POP_MARK NONE NEWTRUE NEWFALSE BININT BININT1 BININT2
    LONG1 BINFLOAT BINUNICODE SHORT_BINUNICODE EMPTY_DICT DICT EMPTY_LIST LIST
    EMPTY_TUPLE TUPLE TUPLE1 TUPLE2 TUPLE3 APPEND APPENDS SETITEM SETITEMS BINGET
    LONG_BINGET BINPUT LONG_BINPUT MEMOIZE GLOBAL STACK_GLOBAL REDUCE BINPERSID
"""
_READER = pickle._Unpickler  # the one in Python, whose operations are a table


class TorchFormat(LogFormat):
    """What torch.save wrote since PyTorch 1.6, as PACE does."""

    name = "PyTorch (.pt of tensors, as PACE writes)"

    def recognizes(self, path: Path) -> bool:
        """Whether it is a zip archive with a pickle, as torch writes it."""
        if not read_start(path).startswith(b"PK"):
            return path.suffix in (".pt", ".pth") and path.is_file()
        try:
            with zipfile.ZipFile(path) as archive:
                return _find_pickle(archive) is not None
        except Exception:  # zipfile has many for archives that are damaged
            return path.suffix in (".pt", ".pth")

    def open(self, path: Path) -> Log:
        """Open an archive."""
        with explain_damage(path, "PyTorch archive"):
            with zipfile.ZipFile(path) as archive:
                tensors = _list_tensors(_read_document(archive))
            return TableLog(path, [_add_time(t) for t in make_length_tables(tensors)])


def _find_pickle(archive: zipfile.ZipFile) -> str | None:
    """The name of the pickle in an archive."""
    names = archive.namelist()
    return next((n for n in names if n.split("/")[1:] == ["data.pkl"]), None)


def _add_time(table: Table) -> Table:
    """A table with its time, where it has one of a name that PACE uses, in seconds."""
    return replace(table, time=next((n for n in _TIMES if n in table.cells), ""))


def _read_document(archive: zipfile.ZipFile) -> object:
    """What was saved, with arrays in place of tensors."""
    name = _find_pickle(archive)
    if name is None:
        raise InputError("no data.pkl in it")
    if archive.getinfo(name).file_size > _MAX_PICKLE:
        raise InputError(f"a pickle of more than {_MAX_PICKLE} bytes")
    root, order = name.removesuffix("data.pkl"), b"little"
    if root + "byteorder" in archive.namelist():
        with archive.open(root + "byteorder") as file:
            order = file.read(8)
    reader = _TensorReader(archive, root, order.decode(), archive.read(name))
    try:
        return reader.load()
    except KeyError as error:
        raise InputError(f"it holds more than tensors ({error})") from error


class _TensorReader(_READER):
    """Reads a pickle of tensors; refuses all that is not needed for it."""

    dispatch: ClassVar[dict[int, Callable[[pickle.Unpickler], None]]] = {
        getattr(pickle, name)[0]: _READER.dispatch[getattr(pickle, name)[0]]
        for name in _ALLOWED.split()
    }

    def __init__(
        self, archive: zipfile.ZipFile, root: str, order: str, content: bytes
    ) -> None:
        super().__init__(BytesIO(content))
        self._archive, self._root = archive, root
        self._order: Literal[">", "<"] = ">" if order == "big" else "<"
        self._storages = dict[str, np.ndarray]()
        self._left = MAX_VALUES

    def find_class(self, module: str, name: str) -> Callable[..., object] | str:
        """One of the few names that a pickle of tensors has."""
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        if module == "torch._utils" and name == "_rebuild_tensor_v2":
            return _rebuild_tensor
        if module == "torch._utils" and name == "_rebuild_parameter":
            return _rebuild_parameter
        kind = name.removesuffix("Storage")
        if module in ("torch", "torch.storage") and kind in _TYPES and kind != name:
            return _TYPES[kind]  # a text: a call of it is an error
        raise InputError(f"a {module[:40]!r} {name[:40]!r}; would fit: tensors")

    def persistent_load(self, saved: tuple[str, str, str, str, int]) -> np.ndarray:
        """The numbers of a member of the archive."""
        what, kind, key, _, count = saved
        if what != "storage" or kind not in _TYPES.values() or "/" in key:
            raise InputError("what is no storage of a tensor")
        if key not in self._storages:
            type_ = np.dtype(kind).newbyteorder(self._order)
            member = self._archive.getinfo(f"{self._root}data/{key}")
            self._left -= member.file_size
            if member.file_size != count * type_.itemsize or self._left < 0:
                raise InputError("a storage that has another size than it states")
            content = self._archive.read(member)
            self._storages[key] = np.frombuffer(content, type_)
        return self._storages[key]


def _rebuild_tensor(
    values: np.ndarray,
    offset: int,
    size: Sequence[int],
    stride: Sequence[int],
    *_: object,
) -> np.ndarray:
    """A tensor of a storage, as torch._utils._rebuild_tensor_v2 makes it.

    Args:
        values: (n) of the storage.
        size: length of each axis.
        stride: numbers from one to the next along each axis.
    """
    steps = list(zip(size, stride, strict=True))
    if offset < 0 or any(length < 0 or step < 0 for length, step in steps):
        raise InputError("a tensor of no size")
    last = offset + sum((length - 1) * step for length, step in steps)
    if math.prod(size) > values.size or (values.size and last >= values.size):
        raise InputError("a tensor larger than its storage")
    byte_steps = [step * values.itemsize for step in stride]
    return np.lib.stride_tricks.as_strided(
        values[offset:], tuple(size), byte_steps, writeable=False
    )


def _rebuild_parameter(tensor: object, *_: object) -> object:
    """The tensor in a parameter of a network."""
    return tensor


def _list_tensors(document: object) -> dict[str, np.ndarray]:
    """Tensors in containers by their paths."""
    found, seen = dict[str, np.ndarray](), set[int]()
    left = [("", document)]
    while left:
        path, value = left.pop()
        if isinstance(value, np.ndarray):
            found[path or "0"] = value
        if id(value) in seen:  # a container that holds itself, or often the same
            continue
        seen.add(id(value))
        members = list[tuple[str, object]]()
        if isinstance(value, dict):
            members = [(f"{path}.{k}" if path else str(k), v) for k, v in value.items()]
        elif isinstance(value, list | tuple):
            members = [(f"{path}[{k}]", member) for k, member in enumerate(value)]
        left += reversed(members)
    return found
