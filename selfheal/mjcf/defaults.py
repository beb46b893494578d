"""Default classes: takes edits of joints, gives fewer where a class can say them once.

MJCF: an element has the attributes that its class states, and a class those of the one
that it is nested in. Its class is its own `class`, or the nearest `childclass` around
it, or the outermost one.
"""

import os
from collections.abc import Mapping, Sequence

from .document import MAKERS, MjcfDocument, name_of
from .edit import Edit, Set, SetDefault
from .element_ids import ElementIds
from .xml_text import Element

_JOINT = "joint"
MIN_JOINTS = 2  # that a class must say something for; chosen: one can say it itself


def fold_into_defaults(
    path: str | os.PathLike[str], edits: Sequence[Edit]
) -> list[Edit]:
    """Edits that do the same, where all joints of a class agree by its `<default>`.

    What a joint states itself stays there, and models whose elements MuJoCo multiplies
    stay as they are.
    """
    document = MjcfDocument(path, in_place=False)
    classes = document.list_default_classes()
    joints = [e for e in document.list_elements(_JOINT) if e.tag == _JOINT]
    if not classes or any(e.tag in MAKERS for e in document.root.walk()):
        return list(edits)
    ids, given = ElementIds(document), {name_of(joint) for joint in joints}
    wanted: dict[Element, dict[str, str | None]] = {}
    names: dict[Element, str | int] = {}
    others: list[Edit] = []
    for edit in edits:
        if not isinstance(edit, Set) or edit.tag != _JOINT:
            others.append(edit)
            continue
        if isinstance(edit.name, str):
            if edit.name not in given:  # of a joint that another edit inserts
                others.append(edit)
                continue
            joint = document.find(_JOINT, edit.name)
        else:
            joint = ids.find(_JOINT, edit.name)
        wanted.setdefault(joint, {}).update(edit.attributes)
        names.setdefault(joint, edit.name)
    # the outermost first
    agreed = {c: _find_agreed(c, classes, joints, wanted) for c in classes}
    folded = [SetDefault(c, _JOINT, a) for c, a in agreed.items() if a]
    if not folded:
        return list(edits)
    left = [Set(_JOINT, names[j], a) for j, a in wanted.items() if a]
    return [*folded, *left, *others]


def _find_agreed(
    name: str,
    classes: Mapping[str, Element],
    joints: Sequence[Element],
    wanted: Mapping[Element, dict[str, str | None]],
) -> dict[str, str | None]:
    """Attributes that all joints which inherit them from a class are to have alike."""
    agreed: dict[str, str | None] = {}
    for attribute in sorted({a for attributes in wanted.values() for a in attributes}):
        heirs = [j for j in joints if _inherits(j, name, attribute, classes)]
        values = {wanted.get(j, {}).get(attribute) for j in heirs}
        if len(heirs) < MIN_JOINTS or len(values) > 1 or None in values:
            continue
        agreed[attribute] = values.pop()
        for joint in heirs:
            del wanted[joint][attribute]
    return agreed


def _inherits(
    joint: Element, name: str, attribute: str, classes: Mapping[str, Element]
) -> bool:
    """Whether a joint would have an attribute from a class that states it."""
    if joint.get(attribute) is not None:
        return False
    at: Element | None = classes.get(_find_class(joint, next(iter(classes))))
    while at is not None and at is not classes[name]:
        stated = (e for e in at.elements() if e.tag == _JOINT)
        if any(e.get(attribute) is not None for e in stated):
            return False
        at = at.parent if at.parent and at.parent.tag == "default" else None
    return at is not None


def _find_class(element: Element, outermost: str) -> str:
    """Name of the class of an element."""
    own = element.get("class")
    above = element.parent
    while own is None and above is not None:
        own, above = above.get("childclass"), above.parent
    return outermost if own is None else own
