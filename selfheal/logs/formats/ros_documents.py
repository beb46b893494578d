"""Messages that are no ROS messages: takes JSON and protobuf, gives their numbers."""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from .common import MAX_ELEMENTS, convert_number, import_extra
from .json_runs import read_time
from .ros_messages import Part, holds_names, label_elements
from .ros_types import UnknownTypeError

CODINGS = ("json", "protobuf")
_MAX_MESSAGE = 4_000_000  # bytes; chosen: a hundred times the whole state of a robot
_MAX_DEPTH = 16  # of objects in objects; chosen: as of ROS messages
_TIMES = ({"sec", "nsec"}, {"sec", "nanosec"}, {"secs", "nsecs"})


def make_decode(coding: str, kind: str, definition: bytes) -> Callable[[bytes], object]:
    """What makes objects, as `json` has them, of messages.

    Args:
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
    convert = partial(
        import_extra("google.protobuf.json_format", "protobuf messages").MessageToDict,
        preserving_proto_field_name=True,
        always_print_fields_with_no_presence=True,
        use_integers_for_enums=True,
    )
    return partial(_decode_small, lambda content: convert(decode(content)))


def _decode_small(decode: Callable[[bytes], object], content: bytes) -> object:
    """The object of a message; an empty one of a picture, which would take long."""
    return decode(content) if len(content) <= _MAX_MESSAGE else {}


def walk_document(
    value: object, path: str = "", names: Sequence[str] | None = None, depth: int = 0
) -> Iterator[Part]:
    """The numbers in an object.

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
            yield Part(path, None, sec + 1e-9 * fraction, True)
            return
        found = (member for key, member in value.items() if _are_names(key, member))
        names = next(found, names)
        for key, member in value.items():
            inner = f"{path}.{key}" if path else key
            yield from walk_document(member, inner, names, depth + 1)
    elif isinstance(value, list):
        yield from _walk_list(value, path, names, depth)
    elif path and value is not None:
        time = read_time(value) if isinstance(value, str) else value
        number = convert_number(time)
        if not math.isnan(number) or value in ("NaN", "nan"):
            yield Part(path, None, number, time is not value)


def _walk_list(
    value: list[object], path: str, names: Sequence[str] | None, depth: int
) -> Iterator[Part]:
    """The numbers in a list; a vector where it holds nothing else."""
    labels = label_elements(names, len(value))
    if isinstance(labels, range):
        labels = labels[:MAX_ELEMENTS]
    if value and all(type(member) in (int, float) for member in value):
        numbers = [convert_number(member) for member in value[: len(labels)]]
        yield Part(path, labels, np.array(numbers))
        return
    for label, member in zip(labels, value, strict=False):
        yield from walk_document(member, f"{path}[{label}]", names, depth + 1)


def _are_names(key: str, member: object) -> bool:
    """Whether a member of an object names elements of its lists."""
    return (
        holds_names(key)
        and isinstance(member, list)
        and len(member) <= MAX_ELEMENTS
        and all(isinstance(name, str) for name in member)
    )
