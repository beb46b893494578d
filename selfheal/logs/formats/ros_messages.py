"""Messages of ROS: takes decoded ones, gives the numbers and vectors in them."""

from collections.abc import Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from .common import MAX_ELEMENTS, import_extra

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

_MAX_DEPTH = 16  # of messages in messages; chosen: twice those of any in use
_MAX_MESSAGES = 64  # in a message's list that become columns; chosen
_BYTES = ("uint8", "int8", "byte", "char")  # of which a sequence is a picture


class Part(NamedTuple):
    """A number or a vector in a message.

    Attributes:
        path: where it is, names of fields with dots between them.
        labels: of a vector's elements: their names where the message has as many, or
            their places; None of a number.
        values: it, or (n).
        is_time: whether it is a time [s].
    """

    path: str
    labels: tuple[str, ...] | range | None
    values: float | np.ndarray
    is_time: bool = False

    def list_columns(self) -> list[str]:
        """Names of its columns."""
        if self.labels is None:
            return [self.path]
        return [f"{self.path}[{label}]" for label in self.labels]


class _Plan(NamedTuple):
    """Attributes of a type of messages by what they hold."""

    is_time: bool
    names: str
    numbers: list[str]
    messages: list[str]
    vectors: list[str]
    lists: list[str]


class RosWalk:
    """Finds the numbers in messages of the types that a store knows."""

    def __init__(self, store: "Typestore") -> None:
        self._store = store
        self._plan = cache(self._make_plan)

    def __call__(
        self,
        message: object,
        path: str = "",
        names: Sequence[str] | None = None,
        depth: int = 0,
    ) -> Iterator[Part]:
        """All parts of a message.

        Names of elements stand in a field `name`, `names` or `..._names` of the same
        message, or of one around it.

        Args:
            path: of the message, with a dot behind it.
            names: of elements, stated by a message around it.
            depth: of messages around it; what is deeper than any in use is left out.
        """
        plan = self._plan(message.__msgtype__)  # type: ignore[attr-defined]
        get = message.__getattribute__
        if plan.is_time:
            yield Part(path[:-1], None, get("sec") + get("nanosec") * 1e-9, True)
            return
        names = get(plan.names) if plan.names else names
        for name in plan.numbers:
            yield Part(path + name, None, get(name))
        for name in plan.messages if depth < _MAX_DEPTH else ():
            yield from self(get(name), f"{path}{name}.", names, depth + 1)
        for name in plan.vectors:
            values = get(name)
            if 0 < len(values) <= MAX_ELEMENTS:
                yield Part(path + name, label_elements(names, len(values)), values)
        for name in plan.lists if depth < _MAX_DEPTH else ():
            elements = get(name)
            labels = label_elements(names, len(elements))
            if elements and elements[0].__msgtype__.endswith("TrajectoryPoint"):
                labels = range(1)  # the first point is what is due
            for label, element in zip(labels[:_MAX_MESSAGES], elements, strict=False):
                yield from self(element, f"{path}{name}[{label}].", names, depth + 1)

    def _make_plan(self, kind: str) -> _Plan:
        nodes = import_extra("rosbags.interfaces", "ROS bags").Nodetype
        rename = import_extra("rosbags.typesys.base", "ROS bags").normalize_fieldname
        plan, stated = _Plan(False, "", [], [], [], []), list[str]()
        fields = cast("Sequence[tuple[str, tuple]]", self._store.fielddefs[kind][1])
        if [name for name, _ in fields] == ["sec", "nanosec"]:
            return plan._replace(is_time=True)
        for field, (node, inner) in fields:
            name, is_several = rename(field), node in (nodes.ARRAY, nodes.SEQUENCE)
            what, (base, *_) = inner[0] if is_several else (node, inner)
            if what == nodes.NAME:
                (plan.lists if is_several else plan.messages).append(name)
            elif base == "string":
                stated += [name] * (node == nodes.SEQUENCE and holds_names(field))
            elif not is_several:
                plan.numbers.append(name)
            elif node == nodes.ARRAY or base not in _BYTES:
                plan.vectors.append(name)
        # the first: others are of joints of several degrees of freedom
        return plan._replace(names=stated[0] if stated else "")


def holds_names(field: str) -> bool:
    """Whether a field of texts is one of names of elements."""
    return field in ("name", "names") or field.endswith("_names")


def label_elements(names: Sequence[str] | None, count: int) -> tuple[str, ...] | range:
    """The labels of so many elements: their names where there are as many."""
    return tuple(names) if names and len(names) == count else range(count)
