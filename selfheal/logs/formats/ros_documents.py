"""Messages that are no ROS messages: takes JSON and protobuf, gives their numbers."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from .common import MAX_COLUMNS, MAX_ELEMENTS, convert_number, import_extra
from .json_runs import read_time
from .ros_messages import Row
from .ros_types import UnknownTypeError

CODINGS = ("json", "protobuf")
_MAX_MESSAGE = 4_000_000  # bytes; chosen: a hundred times the whole state of a robot
_MAX_DEPTH = 16  # of objects in objects; chosen: as of ROS messages
_STAMPS = ("header.stamp", "timestamp")  # of ROS's types, and of Foxglove's
_TIMES = ({"sec", "nsec"}, {"sec", "nanosec"}, {"secs", "nsecs"})
Number = tuple[str, float, bool]  # path of it, it, and whether it is a time [s]


def make_decode(coding: str, kind: str, definition: bytes) -> Callable[[bytes], Any]:
    """What makes objects, as `json` has them, of messages.

    Args:
        coding: of the messages, one of `CODINGS`.
        definition: of the type, a FileDescriptorSet where it is protobuf.

    Raises:
        UnknownTypeError: its definition cannot be used.
    """
    if coding == "json":
        return partial(_decode_small, json.loads)
    decoder = import_extra("mcap_protobuf.decoder", "protobuf messages")
    records = import_extra("mcap.records", "MCAP")
    schema = records.Schema(id=1, data=definition, encoding="protobuf", name=kind)
    try:
        decode = decoder.DecoderFactory().decoder_for("protobuf", schema)
    except Exception as error:  # of the parser, or of its checks, anything
        raise UnknownTypeError(f"its definition cannot be used: {error}") from error
    json_format = import_extra("google.protobuf.json_format", "protobuf messages")

    def decode_protobuf(content: bytes) -> Any:
        return json_format.MessageToDict(
            decode(content), preserving_proto_field_name=True,
            always_print_fields_with_no_presence=True, use_integers_for_enums=True,
        )  # fmt: skip

    return partial(_decode_small, decode_protobuf)


def _decode_small(decode: Callable[[bytes], Any], content: bytes) -> Any:
    """The object of a message; an empty one of a picture, which would take long."""
    return decode(content) if len(content) <= _MAX_MESSAGE else {}


class DocumentFields:
    """The numbers in objects of a topic, as `Fields` are those of ROS messages.

    Attributes:
        stamp: the column of the time at which a message was measured; "" if none.
    """

    def __init__(self) -> None:
        self.stamp = ""
        self._columns = dict[str, bool]()  # by path, whether it is a time
        self._places: Mapping[str, int] = {}

    def learn(self, message: Any) -> None:
        """Look which columns a message has."""
        for path, _, is_time in list_numbers(message):
            if len(self._columns) < MAX_COLUMNS:
                self._columns.setdefault(path, is_time)
        stamps = [name for name in _STAMPS if self._columns.get(name)]
        self.stamp = stamps[0] if stamps else ""

    def list_columns(self) -> list[str]:
        """Names of all columns, `MAX_COLUMNS` at most."""
        return list(self._columns)

    def read_stamp(self, message: Any) -> float:
        """The time at which a message was measured [s]; NaN if it says none."""
        found = {path: number for path, number, _ in list_numbers(message)}
        return found.get(self.stamp, float("nan"))

    def bind(self, places: Mapping[str, int]) -> None:
        """Say where in a row the columns go that are wanted."""
        self._places = places

    def fill(self, message: Any, row: Row) -> None:
        """Put the numbers of a message into a row (C), which is NaN."""
        for path, number, _ in list_numbers(message):
            place = self._places.get(path)
            if place is not None:
                row[place] = number


def list_numbers(
    value: Any,
    path: str = "",
    names: Sequence[str] | None = None,
    depth: int = 0,
) -> Iterator[Number]:
    """Paths and values of the numbers in an object.

    Elements of a list have names where a list of as many, called `name`, `names` or
    `..._names`, stands in the same object or in one around it.

    Args:
        value: as `json` makes it.
        depth: of it; what is deeper than any log is left out.
    """
    if depth > _MAX_DEPTH:
        return
    if isinstance(value, dict):
        if value.keys() in _TIMES:
            fraction, sec = (convert_number(value[key]) for key in sorted(value))
            yield path, sec + 1e-9 * fraction, True
            return
        found = (member for key, member in value.items() if _are_names(key, member))
        names = next(found, names)
        for key, member in value.items():
            inner = f"{path}.{key}" if path else key
            yield from list_numbers(member, inner, names, depth + 1)
    elif isinstance(value, list):
        has_names = names is not None and len(names) == len(value)
        labels: Any = names if has_names else range(min(len(value), MAX_ELEMENTS))
        for label, member in zip(labels, value, strict=False):
            yield from list_numbers(member, f"{path}[{label}]", names, depth + 1)
    elif path and value is not None:
        time = read_time(value) if isinstance(value, str) else value
        number = convert_number(time)
        if number == number or value in ("NaN", "nan"):
            yield path, number, time is not value


def _are_names(key: str, member: Any) -> bool:
    """Whether a member of an object names elements of its lists."""
    return (
        (key in ("name", "names") or key.endswith("_names"))
        and isinstance(member, list)
        and len(member) <= MAX_ELEMENTS
        and all(isinstance(name, str) for name in member)
    )
