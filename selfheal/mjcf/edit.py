"""Edits of MJCF text: takes a model's path and edits, gives the changed text."""

import difflib
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ..errors import ModelError
from .asset_paths import relocate_paths
from .document import SECTIONS, SETTINGS, MjcfDocument, name_of
from .element_ids import ElementIds
from .xml_text import Element, format_path

_HALF_ULP = 2.0**-25  # of a single-precision number, relative (IEEE 754)


@dataclass(frozen=True)
class Set:
    """Set or remove attributes of an element.

    Attributes:
        tag: "joint" (a freejoint too), "geom", "site", "body" or "inertial" (of the
            body named). A section ("actuator", "sensor", ...) means any element in it.
            A setting ("option", "compiler", ...) is made where it is missing.
        name: the element's, "" for settings; or its id in the compiled given model.
        attributes: values as MJCF writes them, None to remove one.
    """

    tag: str
    name: str | int
    attributes: Mapping[str, str | None]


@dataclass(frozen=True)
class Insert:
    """Put elements into another one, after those of their kind.

    Attributes:
        tag: of the parent, as in `Set`; also "mujoco". A section's own name is "".
        xml: the new text; where it stands sets its indentation.
        first: before everything else in the parent.
        angles: attributes [rad] of the new element; written in degrees where the model
            counts in them.
    """

    tag: str
    name: str | int
    xml: str
    first: bool = False
    angles: tuple[str, ...] = ()


@dataclass(frozen=True)
class Rename:
    """Change an element's tag, and attributes as `Set` does."""

    tag: str
    name: str | int
    to: str
    attributes: Mapping[str, str | None]


@dataclass(frozen=True)
class SetDefault:
    """Set attributes of what a default class says of elements of one tag.

    Attributes:
        name: of the class; it is in the main file.
        tag: "joint", ...; made where the class says nothing of it yet.
    """

    name: str
    tag: str
    attributes: Mapping[str, str | None]


Edit = Set | Insert | Rename | SetDefault


def format_number(value: float | Iterable[float]) -> str:
    """Write one or several numbers as MJCF, in six to nine digits (single precision).

    Raises:
        ModelError: one of them is not finite.
    """
    values = value if isinstance(value, Iterable) else [value]
    return " ".join(_format_digits(float(v)) for v in values)


def _format_digits(value: float) -> str:
    """Shortest text of six to nine digits that is a number in single precision."""
    if not math.isfinite(value):
        raise ModelError(f"{value} cannot be written into a model")
    texts = (f"{value + 0.0:.{digits}g}" for digits in (6, 7, 8))  # + 0: no -0
    close = (t for t in texts if abs(float(t) - value) <= _HALF_ULP * abs(value))
    return next(close, f"{value:.9g}")


def unified_diff(given: str, new: str, name: str) -> str:
    """Unified diff of two versions of a file, as git takes it; empty of equal texts."""
    name = format_path(name)
    old, now = (re.findall(r"[^\n]*\n|[^\n]+", text) for text in (given, new))
    lines = difflib.unified_diff(old, now, f"a/{name}", f"b/{name}")
    return "".join(
        line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"
        for line in lines
    )


def apply_edits(
    path: str | os.PathLike[str],
    edits: Sequence[Edit],
    folder: str | os.PathLike[str],
) -> str:
    """The model's text after the edits, to be written as UTF-8 into a folder.

    Comments, order, whitespace, line ends and names stay. An included file stays
    included unless an edit falls into it; then its text takes the place of the
    `<include>`. Without edits, in its own folder, a model comes back as it is.

    Args:
        path: an MJCF, or a URDF, which MuJoCo first turns into one.
        edits: applied one after the other; ids are those of the model as given.
        folder: where the text will lie; paths in it are made to lead from there.

    Raises:
        ModelError: a file is missing or no XML, or an element has no text.
        UnknownNameError: a tag that no edit can have.
    """
    tree = MjcfDocument(path, in_place=False)
    _edit_document(tree, edits)
    relocate_paths(tree, os.path.realpath(folder))
    return tree.file.to_text()


def diff_edits(path: str | os.PathLike[str], edits: Sequence[Edit]) -> str:
    """Unified diff of what edits change in the model's own files, in its folder.

    Args:
        edits: as of `apply_edits`; so are the errors.

    Returns:
        The diff, in which an included file below the model's folder is one of its own.
    """
    tree = MjcfDocument(path, in_place=True)
    given = tree.list_texts()
    _edit_document(tree, edits)
    new = tree.list_texts()
    return "".join(unified_diff(given[name], new[name], name) for name in given)


def _edit_document(tree: MjcfDocument, edits: Sequence[Edit]) -> None:
    """Make edits in a document; ids are those of the model as given."""
    ids = ElementIds(tree)
    found = [
        None if isinstance(e.name, str) else ids.find(e.tag, e.name) for e in edits
    ]
    for edit, element in zip(edits, found, strict=True):
        _apply_edit(tree, edit, element)


def list_tags(path: str | os.PathLike[str], tag: str) -> list[tuple[str | None, str]]:
    """Name and tag of all elements that an edit with this tag can change.

    In the order of the text, what is included in place; errors as `patched` says.
    """
    document = MjcfDocument(path, in_place=False)
    return [(name_of(e), e.tag) for e in document.list_elements(tag)]


def _apply_edit(tree: MjcfDocument, edit: Edit, element: Element | None) -> None:
    """Make one edit in a document."""
    if isinstance(edit, SetDefault):
        owner = tree.list_default_classes()[edit.name]
        said = next((e for e in owner.own_elements() if e.tag == edit.tag), None)
        (said or tree.insert(owner, f"<{edit.tag}/>", True)).set(edit.attributes)
        return
    general = edit.name == "" and edit.tag in (*SETTINGS, *SECTIONS)
    if isinstance(edit, Set) and general:
        tree.configure(edit.tag, edit.attributes)
        return
    if edit.tag == "mujoco" and edit.name == "":
        element = tree.root
    elif general:
        first = isinstance(edit, Insert) and edit.first
        element = tree.get_section(edit.tag, first=first)
    elif element is None:
        element = tree.find(edit.tag, str(edit.name))
    if isinstance(edit, Insert):
        new = tree.insert(tree.inline(element), edit.xml, edit.first)
        if tree.uses_degrees():
            new.set({name: _to_degrees(new.get(name)) for name in edit.angles})
        return
    if isinstance(edit, Rename) and element.tag != edit.to:
        tree.inline(element).tag = edit.to
        element.close = f"</{edit.to}>" if element.close else None
    if element.find_changes(edit.attributes):
        tree.inline(element).set(edit.attributes)


def _to_degrees(radians: str | None) -> str | None:
    """Text of angles [rad] in degrees; None and "" stay."""
    return radians and format_number(math.degrees(float(r)) for r in radians.split())
