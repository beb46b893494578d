"""Fields of ROS messages: takes decoded messages, gives the numbers in them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import repeat
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..timeline import shorten_rows
from .common import MAX_COLUMNS, MAX_ELEMENTS, import_extra

_STAMP = "header.stamp"
_MAX_DEPTH = 16  # of messages in messages; chosen: twice those of any in use
_MAX_MESSAGES = 64  # in a message's list that become columns; chosen
_BYTES = ("uint8", "int8", "byte", "char")
Label = str | int  # of an element: its name where the message has names, or its place
Row = NDArray[np.float64]


class Fields:
    """The numbers in messages of one type.

    Vectors and lists of messages have as many columns as the messages that were
    `learn`ed have elements. Names of elements stand in a field `name`, `names` or
    `..._names` of the same message, or of one around it.

    Attributes:
        stamp: the column of the time at which a message was measured; "" if none.
    """

    def __init__(self, store: Any, kind: str, depth: int = 0) -> None:
        self._numbers, self._times = list[str](), list[str]()
        self._vectors, self._lists = list[_Vector](), list[_List]()
        self._fills = list[Callable[[Any, Row, Sequence[str] | None], None]]()
        self._plan: tuple[Any, Any, Sequence[Any]] = (None, None, ())
        self._add(store, kind, "", None, depth)
        self.stamp = _STAMP if _STAMP in self._times else ""

    def _add(
        self, store: Any, kind: str, path: str, names: str | None, depth: int
    ) -> None:
        """Add the fields of a type at a path; those of messages in it, too."""
        nodes = import_extra("rosbags.interfaces", "ROS bags").Nodetype
        if depth > _MAX_DEPTH or len(self._numbers) > MAX_COLUMNS:
            return
        fields = store.fielddefs[kind][1]
        if [name for name, _ in fields] == ["sec", "nanosec"]:
            self._times.append(path.removesuffix("."))
            return
        stated = [
            name for name, found in fields
            if found[0] == nodes.SEQUENCE and found[1][0][1][0] == "string"
            and (name in ("name", "names") or name.endswith("_names"))
        ]  # fmt: skip
        if stated:  # the first: others are of joints of several degrees of freedom
            names = path + _make_attribute(stated[0])
        for name, found in fields:
            place = path + _make_attribute(name)
            if found[0] == nodes.BASE:
                if found[1][0] != "string":
                    self._numbers.append(place)
            elif found[0] == nodes.NAME:
                self._add(store, found[1], f"{place}.", names, depth + 1)
            elif found[1][0][0] == nodes.NAME:
                inner = found[1][0][1]
                self._lists.append(_List(store, inner, place, names, depth + 1))
            elif found[1][0][1][0] != "string" and not (
                found[0] == nodes.SEQUENCE and found[1][0][1][0] in _BYTES
            ):
                self._vectors.append(_Vector(place, names))

    def learn(self, message: Any, names: Sequence[str] | None = None) -> None:
        """Look which elements the vectors of a message have.

        Args:
            names: of elements, stated by a message around it.
        """
        for vector in self._vectors:
            vector.learn(message, names)
        for part in self._lists:
            part.learn(message, names)

    def list_columns(self, prefix: str = "") -> list[str]:
        """Names of all columns, `MAX_COLUMNS` at most."""
        found = [prefix + path for path in (*self._times, *self._numbers)]
        parts: list[_Elements] = [*self._vectors, *self._lists]
        for part in parts:
            found += part.list_columns(prefix)
        return found[:MAX_COLUMNS]

    def read_stamp(self, message: Any) -> float:
        """The time at which a message was measured [s]."""
        return _read_time(attrgetter(self.stamp)(message))

    def bind(self, places: Mapping[str, int], prefix: str = "") -> None:
        """Say where in a row the columns go that are wanted.

        Args:
            places: in a row, by names of columns.
            prefix: before the names of this message's fields.
        """
        numbers = [path for path in self._numbers if prefix + path in places]
        targets = np.array([places[prefix + path] for path in numbers], dtype=int)
        get = _make_getter(numbers)
        times = [
            (attrgetter(path), places[prefix + path])
            for path in self._times
            if prefix + path in places
        ]
        parts: list[_Elements] = [*self._vectors, *self._lists]
        self._fills = [part.fill for part in parts if part.bind(places, prefix)]
        self._plan = get, targets, times

    def fill(self, message: Any, row: Row, names: Sequence[str] | None = None) -> None:
        """Put the numbers of a message into a row, which is NaN.

        Args:
            row: (C) that is filled, a number for each column.
            names: of elements, stated by a message around it.
        """
        get, targets, times = self._plan
        if get:
            row[targets] = get(message)
        for get_time, target in times:
            row[target] = _read_time(get_time(message))
        for fill in self._fills:
            fill(message, row, names)


def _read_time(time: Any) -> float:
    """A time of ROS in seconds."""
    return float(time.sec + time.nanosec * 1e-9)


def _make_attribute(name: str) -> str:
    """What rosbags calls a field."""
    return import_extra("rosbags.typesys.base", "ROS bags").normalize_fieldname(name)


def _make_getter(paths: Sequence[str]) -> Callable[[Any], Any] | None:
    """What takes the values at paths from a message; None of no path."""
    return attrgetter(*paths) if paths else None


class _Elements(ABC):
    """What vectors and lists of messages have in common: labels of their elements."""

    def __init__(self, path: str, names: str | None) -> None:
        self.path = path
        self._get = attrgetter(path)
        self._get_names = attrgetter(names) if names else None

    def find(
        self, message: Any, names: Sequence[str] | None
    ) -> tuple[Any, Sequence[str] | None]:
        """The elements, and their names if there are as many."""
        elements = self._get(message)
        if self._get_names:
            names = self._get_names(message)
        return elements, names if names and len(names) == len(elements) else None

    @abstractmethod
    def learn(self, message: Any, names: Sequence[str] | None) -> None: ...

    @abstractmethod
    def list_columns(self, prefix: str) -> list[str]: ...

    @abstractmethod
    def bind(self, places: Mapping[str, int], prefix: str) -> bool: ...

    @abstractmethod
    def fill(self, message: Any, row: Row, names: Sequence[str] | None) -> None: ...


class _Vector(_Elements):
    """A vector of numbers."""

    def __init__(self, path: str, names: str | None) -> None:
        super().__init__(path, names)
        self._labels = dict[Label, None]()
        self._targets = dict[Label, int]()
        self._known: tuple[Any, Any, Any] = (None, None, None)

    def learn(self, message: Any, names: Sequence[str] | None) -> None:
        values, names = self.find(message, names)
        if len(values) <= MAX_ELEMENTS >= len(self._labels):
            self._labels |= dict.fromkeys(names or range(len(values)))

    def list_columns(self, prefix: str) -> list[str]:
        return [f"{prefix}{self.path}[{label}]" for label in self._labels]

    def bind(self, places: Mapping[str, int], prefix: str) -> bool:
        columns = zip(self._labels, self.list_columns(prefix), strict=True)
        self._targets = {k: places[name] for k, name in columns if name in places}
        self._known = (None, None, None)
        return bool(self._targets)

    def fill(self, message: Any, row: Row, names: Sequence[str] | None) -> None:
        values, names = self.find(message, names)
        key = len(values) if names is None else names
        known, sources, targets = self._known
        if key != known:  # else as in the message before
            sources, targets = self._match(len(values), names)
            self._known = (list(names) if names else key), sources, targets
        row[targets] = values[sources]

    def _match(self, count: int, names: Sequence[str] | None) -> tuple[Any, Any]:
        """Places of the wanted elements in a vector, and in a row."""
        labels: Sequence[Label] = names if names is not None else range(count)
        pairs = [
            (k, self._targets[label])
            for k, label in enumerate(labels)
            if label in self._targets
        ]
        sources, targets = np.array(pairs, dtype=int).reshape(-1, 2).T
        return shorten_rows(sources), shorten_rows(targets)


class _List(_Elements):
    """A list of messages."""

    def __init__(
        self, store: Any, kind: str, path: str, names: str | None, depth: int
    ) -> None:
        super().__init__(path, names)
        self._make = lambda: Fields(store, kind, depth)
        # of a trajectory the first point is what is due; names are not of points
        self._is_trajectory = kind.endswith("TrajectoryPoint")
        self._most = 1 if self._is_trajectory else _MAX_MESSAGES
        self._parts, self._bound = dict[Label, Fields](), dict[Label, Fields]()

    def _list(
        self, message: Any, names: Sequence[str] | None
    ) -> Iterator[tuple[Label, Any, Sequence[str] | None]]:
        """Label and message of each element, and the names around it."""
        around = self._get_names(message) if self._get_names else names
        elements, found = self.find(message, names)
        labels: Sequence[Label] | None = found
        if labels is None or self._is_trajectory:
            labels = range(self._most)
        yield from zip(labels, elements[: self._most], repeat(around), strict=False)

    def learn(self, message: Any, names: Sequence[str] | None) -> None:
        for label, element, around in self._list(message, names):
            if label not in self._parts and len(self._parts) < self._most:
                self._parts[label] = self._make()
            if label in self._parts:
                self._parts[label].learn(element, around)

    def list_columns(self, prefix: str) -> list[str]:
        found = list[str]()
        for label, part in self._parts.items():
            found += part.list_columns(f"{prefix}{self.path}[{label}].")
        return found

    def bind(self, places: Mapping[str, int], prefix: str) -> bool:
        self._bound = {}
        for label, part in self._parts.items():
            inner = f"{prefix}{self.path}[{label}]."
            if not places.keys().isdisjoint(part.list_columns(inner)):
                part.bind(places, inner)
                self._bound[label] = part
        return bool(self._bound)

    def fill(self, message: Any, row: Row, names: Sequence[str] | None) -> None:
        for label, element, around in self._list(message, names):
            if label in self._bound:
                self._bound[label].fill(element, row, around)
