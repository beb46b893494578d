"""Elements of a model's text by their id in the compiled model."""

import os
import tempfile
from pathlib import Path

import mujoco

from ..errors import ModelError
from ..mujoco_files import compile_file
from .asset_paths import relocate_paths
from .document import MjcfDocument, describe_refusal, find_named_element, name_of
from .xml_text import Element, encode_text

_KINDS = {  # MuJoCo's name of an object with an id, and where a model counts it
    "body": ("BODY", "nbody"),
    "inertial": ("BODY", "nbody"),
    "joint": ("JOINT", "njnt"),
    "geom": ("GEOM", "ngeom"),
    "site": ("SITE", "nsite"),
    "actuator": ("ACTUATOR", "nactuator"),
    "contact": ("PAIR", "npair"),
    "equality": ("EQUALITY", "neq"),
    "keyframe": ("KEY", "nkey"),
    "sensor": ("SENSOR", "nsensor"),
    "tendon": ("TENDON", "ntendon"),
}


class ElementIds:
    """Finds the element of a document that has an id in the compiled model.

    MuJoCo assigns ids: a copy of the document, in which every element of the kind has
    a name, is compiled once for each kind.
    """

    def __init__(self, document: MjcfDocument) -> None:
        """`document`: as given; later edits do not change the ids."""
        self._document = document
        self._named: dict[str, tuple[mujoco.MjModel, dict[str | None, Element]]] = {}

    def find(self, tag: str, index: int) -> Element:
        """Find the element of a kind with an id in the compiled model.

        Raises:
            ModelError: there is no such id, or what has it has no text.
        """
        if tag not in self._named:
            self._named[tag] = self._name_all(tag)
        model, elements = self._named[tag]
        kind, count = _KINDS[tag]
        path = self._document.path
        if not 0 <= index < (total := getattr(model, count)):
            raise ModelError(f"{path}: no {tag} has id {index}; there are {total}")
        name = mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind}"), index)
        if name not in elements:
            missing = name or f"with id {index}"
            raise ModelError(self._document.describe_missing(tag, missing))
        return elements[name]

    def _name_all(self, tag: str) -> tuple[mujoco.MjModel, dict[str | None, Element]]:
        """Name and compile all of a kind: the model, and elements by their names."""
        copy, elements = MjcfDocument(self._document.path, in_place=False), {}
        pairs = zip(
            self._document.list_elements(tag), copy.list_elements(tag), strict=True
        )
        for k, (original, copied) in enumerate(pairs):
            if name_of(copy.inline(copied)) is None:
                find_named_element(copied).set({"name": f"unnamed element {k}"})
            elements[name_of(copied)] = original
        return _compile(copy), elements


def _compile(document: MjcfDocument) -> mujoco.MjModel:
    """Compile a document's text in an empty folder; `ModelError`: MuJoCo cannot."""
    with tempfile.TemporaryDirectory() as folder:
        relocate_paths(document, os.path.realpath(folder))
        path = Path(folder) / "model.xml"
        path.write_bytes(encode_text(document.file.to_text()))
        try:
            return compile_file(path)
        except ValueError as error:
            raise ModelError(describe_refusal(document.path, error)) from error
