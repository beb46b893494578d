"""A model as a tree of files: takes its path, finds and changes its elements."""

import inspect
import os
import re
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import mujoco

from ..errors import ModelError, UnknownNameError
from ..recording import read_spec
from .markup import (
    Element,
    after_note,
    indentation,
    is_space,
    notes,
    parse,
    put,
    trimmed,
)
from .paths import first_file, relocate

_BODIES = ("worldbody", "body")
SETTINGS = ("compiler", "option", "size", "statistic", "visual")
SECTIONS = ("actuator", "contact", "equality", "keyframe", "sensor", "tendon")
_KINDS = {  # MuJoCo's name of what has an id, and where a model counts it
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
_MAKERS = ("replicate", "composite", "flexcomp", "attach")


class Tree:
    """A model's files, the included ones where they are included."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self.home = os.path.realpath(os.path.dirname(os.path.abspath(path)))
        text = _read(self.path)
        self.document = parse(text, self.home, self.path)
        if self.document.root().tag == "robot":
            text = _from_urdf(self.path)
            self.document = parse(text, self.home, self.path)
        self.root = self.document.root()
        if self.root.tag != "mujoco":
            tag = self.root.tag
            raise ModelError(f"{self.path}: <{tag}> is no model; <mujoco> or <robot>")
        self.twins: dict[str, tuple[mujoco.MjModel, dict[str | None, Element]]] = {}
        self.newline = "\r\n" if "\r\n" in text else "\n"
        self._include(self.document, {os.path.realpath(self.path)})

    def _include(self, file: Element, seen: set[str]) -> None:
        """Read what a file includes."""
        for element in [e for e in file.walk() if e.tag == "include"]:
            path = first_file(element.get("file") or "", self.home, element.home)
            if os.path.realpath(path) in seen:  # MuJoCo refuses it too
                raise ModelError(f"{self.path}: {path} is included twice")
            seen.add(os.path.realpath(path))
            text = _read(path).removeprefix("\ufeff")
            text = text.replace("\r\n", "\n").replace("\n", self.newline)
            element.included = parse(text, os.path.dirname(path), path)
            element.included.parent = element
            self._include(element.included, seen)

    def sections(self, tag: str) -> list[Element]:
        """The model's outermost elements of a tag."""
        return [e for e in self.root.elements() if e.tag == tag]

    def candidates(self, tag: str) -> list[Element]:
        """All elements of the text that an edit with this tag can speak of."""
        if tag in SECTIONS:
            return [e for s in self.sections(tag) for e in s.elements()]
        if tag in ("mujoco", *SETTINGS):
            raise ModelError(f"{self.path}: a <{tag}> has no name; say '' for it")
        if tag not in _KINDS:
            raise UnknownNameError("tag", tag, ("mujoco", *SETTINGS, *_KINDS))
        tags = {"joint": ("joint", "freejoint"), "body": ("worldbody", "body")}
        return [e for e in self._things() if e.tag in tags.get(tag, (tag,))]

    def _things(self) -> Iterator[Element]:
        """Bodies and what is in them, without what MuJoCo multiplies."""
        stack = self.sections("worldbody")[::-1]
        while stack:
            element = stack.pop()
            yield element
            if element.tag in ("worldbody", "body", "frame"):
                stack += list(element.elements())[::-1]

    def find(self, tag: str, name: str) -> Element:
        """The element of a name; of several (worlds) the last of the main file."""
        found = [e for e in self.candidates(tag) if name_of(e) == name]
        if not found:
            raise ModelError(self._missing(tag, name))
        return next((e for e in found[::-1] if not e.includes()), found[-1])

    def _missing(self, tag: str, name: str) -> str:
        names = [name_of(e) for e in self.candidates(tag)]
        there = [repr(n) for n in names if n is not None]
        unnamed = f"{names.count(None)} without a name" if None in names else ""
        there += [unnamed] if unnamed else []
        makers = sorted({e.tag for e in self._things() if e.tag in _MAKERS})
        made = f"; what {', '.join(f'<{m}>' for m in makers)} makes has no text"
        return (
            f"{self.path}: the text has no {tag} {name!r}; there are: "
            f"{', '.join(there) or 'none'}{made if makers else ''}"
        )

    def by_id(self, tag: str, index: int) -> Element:
        """The element that has an id in the compiled model: MuJoCo is asked."""
        if tag not in self.twins:
            self.twins[tag] = self._twin(tag)
        model, names = self.twins[tag]
        kind, count = _KINDS[tag]
        if not 0 <= index < (total := getattr(model, count)):
            what = f"no {tag} has id {index}; there are {total}"
            raise ModelError(f"{self.path}: {what}")
        kind = getattr(mujoco.mjtObj, f"mjOBJ_{kind}")
        name = mujoco.mj_id2name(model, kind, index)
        if name not in names:
            raise ModelError(self._missing(tag, name or f"with id {index}"))
        return names[name]

    def _twin(self, tag: str) -> "tuple[mujoco.MjModel, dict[str | None, Element]]":
        """The same model with a name for all of a kind, and what has which name."""
        twin, names = Tree(self.path), {}
        pairs = zip(self.candidates(tag), twin.candidates(tag), strict=True)
        for k, (own, its) in enumerate(pairs):
            if name_of(twin.own(its)) is None:
                _bearer(its).set({"name": f"unnamed element {k}"})
            names[name_of(its)] = own
        return twin.compiled(), names

    def compiled(self) -> "mujoco.MjModel":
        """The model as MuJoCo reads it."""
        with tempfile.TemporaryDirectory() as folder:
            relocate(self, os.path.realpath(folder))
            path = Path(folder) / "model.xml"
            path.write_bytes(self.document.text().encode())
            try:
                return mujoco.MjModel.from_xml_path(str(path))
            except ValueError as error:
                raise ModelError(_refusal(self.path, error)) from error

    def own(self, element: Element) -> Element:
        """Bring an element into the main file, with the files that it lies in."""
        for include in element.includes():
            file, above = include.included, include.parent
            assert file and above
            indent, root = indentation(include), file.root()
            margin = "" if indent is None else self.newline + indent
            at = file.children.index(root)
            pieces: list[str | Element] = []
            for note in notes(file.children[:at]):
                pieces += [note, margin]
            pieces += trimmed(root.children)
            for note in notes(file.children[at:]):
                pieces += [margin, note]
            put(above, above.children.index(include), pieces, replaced=1)
        return element

    def section(self, tag: str, first: bool = False) -> Element:
        """A section or a setting of the main file; made where it has none."""
        found = self.sections(tag)
        if found and (first or not found[-1].includes()):
            return self.own(found[0 if first else -1])
        return self.insert(self.root, f"<{tag}/>", first=False)

    def in_degrees(self) -> bool:
        """Whether the text counts angles in degrees, as MJCF does unless told."""
        told = [e.get("angle") for e in self.sections("compiler")]
        return next((a for a in told[::-1] if a), "degree") == "degree"

    def configure(self, tag: str, attributes: Mapping[str, str | None]) -> None:
        """Change settings where they are made: the last word counts."""
        for name, value in attributes.items():
            holders = [e for e in self.sections(tag) if e.get(name) is not None]
            if value is None:
                for holder in holders:
                    self.own(holder).set({name: None})
            elif not holders:
                self.section(tag).set({name: value})
            elif holders[-1].news({name: value}):
                self.own(holders[-1]).set({name: value})

    def insert(self, parent: Element, xml: str, first: bool) -> Element:
        """Put a text into an element of the main file; gives its first element."""
        margin = self._margin(parent)
        lines = inspect.cleandoc(xml).splitlines()
        text = (margin or self.newline).join(lines)
        pieces = parse(text, self.home, f"text to insert, {xml!r}").children
        new = next(p for p in pieces if isinstance(p, Element))
        if parent.close is None:
            parent.space, parent.close = "", f"</{parent.tag}>"
        at = 0 if first else _place(parent, new.tag)
        at = after_note(parent.children, at)
        rest = "".join(p for p in parent.children[at:] if isinstance(p, str))
        first_child = not any(isinstance(p, Element) for p in parent.children)
        end = []  # the end tag gets a line of its own with the first child
        if margin and first_child and "\n" not in rest:
            end = [self.newline + (indentation(parent) or "")]
        put(parent, at, [margin, *pieces, *end])
        return new

    def _margin(self, parent: Element) -> str:
        """What stands before a child: a line's end and indentation; "" in a line."""
        children = [c for c in parent.children if isinstance(c, Element)]
        indents = [i for c in children if (i := indentation(c)) is not None]
        if indents:
            return self.newline + indents[0]
        base = indentation(parent)
        if children or base is None:
            return ""
        tops = (indentation(c) for c in self.root.children if isinstance(c, Element))
        step = next((t for t in tops if t), "").removeprefix(
            indentation(self.root) or ""
        )
        return self.newline + base + (step or "  ")


def _read(path: str) -> str:
    """A file's text; where it is not UTF-8 it says that from now on."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise ModelError(f"cannot read {path}: {error.strerror}") from error
    try:
        return data.decode()
    except UnicodeDecodeError:
        pass
    declared = re.match(rb"""(<\?xml[^>]*encoding\s*=\s*["'])([\w.-]+)""", data)
    try:
        text = data.decode(declared[2].decode() if declared else "latin-1")
    except (LookupError, UnicodeDecodeError) as error:
        raise ModelError(f"cannot read {path}: {error}") from error
    return re.sub(r"""^(<\?xml[^>]*encoding\s*=\s*["'])[\w.-]+""", r"\1UTF-8", text)


def _from_urdf(path: str) -> str:
    """A URDF as MuJoCo writes it in MJCF."""
    try:
        spec = read_spec(path)
        spec.compile()
        return spec.to_xml()
    except ValueError as error:
        raise ModelError(_refusal(path, error)) from error


def _refusal(path: str, error: Exception) -> str:
    return f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}"


def _bearer(element: Element) -> Element:
    """The element whose name an edit says: of an inertia the body."""
    bearer: Element | None = element
    while element.tag == "inertial" and bearer and bearer.tag not in _BODIES:
        bearer = bearer.parent
    return bearer or element


def name_of(element: Element) -> str | None:
    """Name in the text; None without one."""
    bearer = _bearer(element)
    return "world" if bearer.tag == "worldbody" else bearer.get("name")


def _place(parent: Element, tag: str) -> int:
    """Where a child belongs: after its kind, before bodies, settings at the front."""
    pieces = parent.children
    children = [(i, c) for i, c in enumerate(pieces) if isinstance(c, Element)]
    end = max((i for i, p in enumerate(pieces) if not is_space(p)), default=-1) + 1
    if parent.tag == "mujoco" and tag in SETTINGS:
        return max((i + 1 for i, c in children if c.tag in SETTINGS[:2]), default=0)
    if parent.tag not in (*_BODIES, "frame"):
        return end
    if alike := [i for i, c in children if _holds(c, tag)]:
        return alike[-1] + 1
    body = next((i for i, c in children if _holds(c, "body")), len(pieces))
    if tag == "body" or body == len(pieces):
        return end
    return max((i + 1 for i, _ in children if i < body), default=0)


def _holds(element: Element, tag: str) -> bool:
    """Whether it is of a kind, or brings one into the body that it stands in."""
    if element.tag == tag or element.tag == "body":
        return element.tag == tag
    inside = element.included.root() if element.included else element
    return any(_holds(e, tag) for e in inside.elements())
