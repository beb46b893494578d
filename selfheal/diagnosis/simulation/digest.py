"""Digests: takes any value that a computation depends on, gives 32 bytes for it."""

import functools
import hashlib
import sys
import types
from collections.abc import Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib.metadata import version
from pathlib import Path, PurePath
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import mujoco
import numpy as np

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Named = type | types.FunctionType | types.BuiltinFunctionType
PACKAGE = Path(__file__).parents[2]
PARAMS = "__dataclass_params__"  # of a dataclass, as Python names them
VERSIONED = ("mujoco", "numpy", "scipy")  # packages that make the numbers


class Digester:
    """Makes digests of values from everything that they hold.

    Arrays count by shape, dtype and bytes, compiled models by MuJoCo's saved binary.
    Dataclasses count by every field that takes part in comparison, so that
    `field(compare=False)` leaves a field out. Other objects count by their attributes,
    functions by name, defaults and closure. What is not of this package counts by its
    source file, too.

    A frozen dataclass that is compared by identity is read once, and its digest is kept
    while it lives: nobody may change the arrays that it holds.
    """

    def __init__(self) -> None:
        self._of_objects: WeakKeyDictionary[object, bytes] = WeakKeyDictionary()
        self._of_modules: dict[str, bytes] = {}

    def digest(self, value: object) -> bytes:
        """SHA-256 of a value.

        Raises:
            TypeError: it holds something of which no digest can be made.
        """
        state = hashlib.sha256()
        self._feed(state, value)
        return state.digest()

    def _feed(self, state: "hashlib._Hash", value: object) -> None:
        """Add a value to a digest, so that no two different values add the same."""
        if isinstance(value, np.ndarray | np.generic) and value.dtype != object:
            state.update(_tag("array", value.shape, value.dtype.str))
            state.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data)
        elif isinstance(value, bytes | bytearray):
            state.update(_tag("bytes", len(value)))
            state.update(value)
        elif isinstance(value, Enum):
            state.update(_tag("enum", _name_of(type(value)), value.name))
        elif value is None or isinstance(value, bool | int | float | complex | str):
            state.update(_tag(type(value).__name__, value))
        elif is_dataclass(value) and not isinstance(value, type):
            self._feed_dataclass(state, value)
        elif isinstance(value, mujoco.MjModel):
            self._feed_items(state, "MjModel", [_save_model(value)])
        else:
            self._feed_container(state, value)

    def _feed_container(self, state: "hashlib._Hash", value: object) -> None:
        """Add a collection, a function or an object of any other class."""
        if isinstance(value, Mapping):
            pairs = [part for pair in value.items() for part in pair]
            self._feed_items(state, "mapping", pairs)
        elif isinstance(value, Set):
            self._feed_items(state, "set", sorted(map(self.digest, value)))
        elif isinstance(value, Sequence | np.ndarray):  # an array of objects
            self._feed_items(state, "sequence", list(value))
        elif isinstance(value, PurePath | slice | range):
            state.update(_tag(type(value).__name__, str(value)))
        elif isinstance(value, functools.partial):
            parts = [value.func, value.args, value.keywords]
            self._feed_items(state, "partial", parts)
        elif isinstance(value, types.MethodType):
            self._feed_items(state, "method", [value.__func__, value.__self__])
        elif isinstance(value, types.FunctionType):
            cells = [cell.cell_contents for cell in value.__closure__ or ()]
            parts = [value.__defaults__, value.__kwdefaults__, cells]
            self._feed_code(state, value)
            self._feed_items(state, "function", parts)
        elif isinstance(value, type | types.BuiltinFunctionType):
            self._feed_code(state, value)
        elif hasattr(value, "__dict__"):
            self._feed_code(state, type(value))
            self._feed(state, vars(value))
        else:
            raise TypeError(f"no digest of a {type(value).__name__}: {value!r}")

    def _feed_items(
        self, state: "hashlib._Hash", kind: str, items: Sequence[object]
    ) -> None:
        """Add several values in their order."""
        state.update(_tag(kind, len(items)))
        for item in items:
            self._feed(state, item)

    def _feed_dataclass(
        self, state: "hashlib._Hash", value: "DataclassInstance"
    ) -> None:
        """Add a dataclass by its fields; by their digest where it can be kept."""
        params = getattr(type(value), PARAMS)
        if not params.frozen or params.eq:
            self._feed_fields(state, value)
            return
        if value not in self._of_objects:
            own = hashlib.sha256()
            self._feed_fields(own, value)
            self._of_objects[value] = own.digest()
        state.update(_tag("digest", len(self._of_objects[value])))
        state.update(self._of_objects[value])

    def _feed_fields(self, state: "hashlib._Hash", value: "DataclassInstance") -> None:
        """Add a dataclass's name, and each field that is compared."""
        self._feed_code(state, type(value))
        compared = {f.name: getattr(value, f.name) for f in fields(value) if f.compare}
        self._feed(state, compared)

    def _feed_code(self, state: "hashlib._Hash", value: Named) -> None:
        """Add the name of a class or function, and the source of another package's."""
        state.update(_tag("code", _name_of(value)))
        module = value.__module__ or ""
        if module.partition(".")[0] == __name__.partition(".")[0]:
            return  # `digest_programs` has it
        if module not in self._of_modules:
            file = getattr(sys.modules.get(module), "__file__", None) or ""
            source = Path(file).read_bytes() if file.endswith(".py") else b""
            self._of_modules[module] = hashlib.sha256(source).digest()
        state.update(self._of_modules[module])


def _tag(kind: str, *about: object) -> bytes:
    """A value's kind and size, ended by a zero byte."""
    return f"{kind}:{about!r}\0".encode()


def _name_of(value: Named) -> str:
    """Full name of a class or function."""
    return f"{value.__module__}.{value.__qualname__}"


def _save_model(model: mujoco.MjModel) -> np.ndarray:
    """A compiled model's binary (B), as MuJoCo saves it."""
    binary = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    return binary


def digest_source(folder: Path) -> bytes:
    """SHA-256 of all Python files below a folder, by path and content."""
    state = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        source = path.read_bytes()
        state.update(_tag("file", path.relative_to(folder).as_posix(), len(source)))
        state.update(source)
    return state.digest()


@functools.cache
def digest_programs() -> bytes:
    """SHA-256 of this package's source code and of the versions that it runs with.

    A process reads the source once, in some 10 ms.
    """
    versions = [version(name) for name in VERSIONED]
    return hashlib.sha256(digest_source(PACKAGE) + repr(versions).encode()).digest()
