"""Types of ROS messages: takes definitions of a log, gives what decodes messages."""

import re
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING

from .common import import_extra

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

# rosbags writes program text from these names, so that they must be names indeed
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)+", re.ASCII)
_FIELD_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)
_MAX_TEXT = 1_000_000  # characters of a definition; chosen: ten times the longest known
_MAX_FIELDS = 10_000  # of all types of a definition; chosen likewise
_MAX_ARRAY = 1_000  # messages or texts in an array, each of which is a line of program
# constants and fields of types, each a name and what rosbags says of it
Types = dict[str, tuple[Sequence[tuple], Sequence[tuple[str, tuple]]]]


class UnknownTypeError(Exception):
    """A type that is not defined, or whose definition cannot be used."""


def make_typestore(name: str, text: str, form: str) -> "Typestore":
    """What decodes messages of a type.

    Args:
        name: of the type, as "package/msg/Type".
        text: its definition and those of the types in it; "" if the log has none.
        form: "msg" or "idl".

    Raises:
        UnknownTypeError: it is not defined, or its definition cannot be used.
    """
    typesys = import_extra("rosbags.typesys", "ROS bags")
    if not text:
        store = typesys.get_typestore(typesys.Stores.LATEST)
        if name not in store.fielddefs:
            raise UnknownTypeError("it has no definition")
        return store
    if len(text) > _MAX_TEXT or not _TYPE_NAME.fullmatch(name):
        raise UnknownTypeError("its definition is too long, or its name is none")
    try:
        found = _parse(typesys, name, text, form)
        _check_types(found)
        store = typesys.get_typestore(typesys.Stores.EMPTY)
        # some recorders leave out the definitions of types that all know
        known = typesys.get_typestore(typesys.Stores.LATEST).fielddefs
        store.register({**_find_missing(found, known), **found})
        store.get_msgdef(name)
    except Exception as error:  # of the parser, or of the program text, anything
        raise UnknownTypeError(f"its definition cannot be used: {error}") from error
    return store


def _parse(typesys: ModuleType, name: str, text: str, form: str) -> Types:
    """Types of a definition by name: constants and fields."""
    if form == "msg":
        return dict(typesys.get_types_from_msg(text, name))
    found: Types = {}
    for part in re.split(r"^=+\n", text, flags=re.M):
        found |= typesys.get_types_from_idl(re.sub(r"\AIDL: .*\n", "", part))
    return found


def _check_types(found: Types) -> None:
    """Refuse names that are none and arrays that are too long."""
    nodes = import_extra("rosbags.interfaces", "ROS bags").Nodetype
    count = 0
    for name, (constants, fields) in found.items():
        names = [entry[0] for entry in (*constants, *fields)]
        count += len(names)
        if not _TYPE_NAME.fullmatch(name) or count > _MAX_FIELDS:
            raise ValueError("a name that is none, or too many fields")
        if not all(_FIELD_NAME.fullmatch(name) for name in names):
            raise ValueError("a name of a field that is none")
        for _, (node, inner) in fields:
            kind, length = inner if _is_array(node) else ((node, inner), 0)
            is_written_out = kind[0] == nodes.NAME or kind[1][0] == "string"
            if node == nodes.ARRAY and is_written_out and length > _MAX_ARRAY:
                raise ValueError("an array that is too long")
            if kind[0] == nodes.NAME and not _TYPE_NAME.fullmatch(kind[1]):
                raise ValueError("a name of a type that is none")


def _is_array(node: object) -> bool:
    nodes = import_extra("rosbags.interfaces", "ROS bags").Nodetype
    return node in (nodes.ARRAY, nodes.SEQUENCE)


def _find_missing(found: Types, known: Types) -> Types:
    """Types that some types need and a definition lacks, of those that all know."""
    nodes = import_extra("rosbags.interfaces", "ROS bags").Nodetype
    missing: Types = {}
    left = list(found.values())
    while left:
        for _, (node, inner) in left.pop()[1]:
            what, name = inner[0] if _is_array(node) else (node, inner)
            is_new = what == nodes.NAME and name not in {**found, **missing}
            if is_new and name in known:
                missing[name] = known[name]
                left.append(known[name])
    return missing
