"""Edits of an MJCF's text: takes the user's file, gives it back with little changed.

The file is read into pieces that together are exactly its text; an edit replaces the
few that it speaks of. MuJoCo's reader forgives more than XML does ("--" in a comment,
a bare "&"), and so does this one.
"""

import difflib
import inspect
import math
import os
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import mujoco

from ..errors import ModelError, UnknownNameError

_SINGLE = 2.0**-25  # half a unit in the last place of a single-precision number


@dataclass(frozen=True)
class Set:
    """Give an element attributes, or take them away.

    Attributes:
        tag: "joint" (a freejoint too), "geom", "site", "body", "inertial" (of the body
            named), a section ("actuator", "sensor", ...: any element in it), or one
            of the settings ("option", "compiler", ...; made where missing).
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
        name: of the parent.
        xml: the new text; where it stands sets its indentation.
        first: before everything else in the parent.
    """

    tag: str
    name: str | int
    xml: str
    first: bool = False


@dataclass(frozen=True)
class Rename:
    """Change an element's tag, and attributes as `Set` does.

    Attributes:
        tag: as in `Set`.
        name: as in `Set`.
        to: the new tag.
        attributes: values as MJCF writes them, None to remove one.
    """

    tag: str
    name: str | int
    to: str
    attributes: Mapping[str, str | None]


def number(value: float | Iterable[float]) -> str:
    """A number or several as MJCF text, in the six to nine digits of single precision.

    Raises:
        ModelError: one of them is not finite.
    """
    values = value if isinstance(value, Iterable) else [value]
    return " ".join(_digits(float(v)) for v in values)


def _digits(value: float) -> str:
    if not math.isfinite(value):
        raise ModelError(f"{value} cannot be written into a model")
    texts = (f"{value + 0.0:.{digits}g}" for digits in (6, 7, 8))  # + 0: no -0
    close = (t for t in texts if abs(float(t) - value) <= _SINGLE * abs(value))
    return next(close, f"{value:.9g}")


def difference(given: str, new: str) -> str:
    """What changed between two texts, as a unified diff; empty where nothing did."""
    lines = difflib.unified_diff(
        given.splitlines(), new.splitlines(), "given", "patched.xml", lineterm=""
    )
    return "\n".join(lines)


def patched(
    path: str | os.PathLike[str],
    edits: Sequence[Set | Insert | Rename],
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
        UnknownNameError: a tag that no edit can speak of.
    """
    tree = _Tree(path)
    found = [None if isinstance(e.name, str) else tree.by_id(e) for e in edits]
    for edit, element in zip(edits, found, strict=True):
        _apply(tree, edit, element)
    _relocate(tree, os.path.realpath(folder))
    return tree.document.text()


def tags(path: str | os.PathLike[str], tag: str) -> list[tuple[str | None, str]]:
    """Name and tag of all elements that an edit with this tag can speak of.

    In the order of the text, what is included in place; errors as `patched` says.
    """
    return [(_name(e), e.tag) for e in _Tree(path).candidates(tag)]


# the text as pieces

_NAME = r"""[^\s=<>/"']+"""
_ATTRIBUTE = rf"""(\s*)({_NAME})(\s*=\s*)("[^"]*"|'[^']*')"""
_MARKUP = re.compile(
    r"(?P<aside><!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|<!(?!--|\[CDATA\[)[^>]*>)"
    rf"|</(?P<close>{_NAME})\s*>"
    rf"|<(?P<open>{_NAME})(?P<attributes>(?:{_ATTRIBUTE})*)(?P<space>\s*)(?P<end>/?)>",
    re.DOTALL,
)
_ENTITIES = {"quot": '"', "amp": "&", "apos": "'", "lt": "<", "gt": ">"}


@dataclass
class _Attribute:
    """The pieces of ` name="value"`."""

    space: str
    name: str
    equals: str
    quoted: str

    @property
    def value(self) -> str:
        return re.sub(r"&(#?\w+);", _character, self.quoted[1:-1])

    def write(self, value: str) -> None:
        quote = self.quoted[0]
        raw = value.replace("&", "&amp;").replace("<", "&lt;")
        raw = raw.replace(quote, "&quot;" if quote == '"' else "&apos;")
        self.quoted = f"{quote}{raw}{quote}"

    def text(self) -> str:
        return f"{self.space}{self.name}{self.equals}{self.quoted}"


def _character(entity: re.Match[str]) -> str:
    """What an entity stands for; itself where MuJoCo does not know it either."""
    code = entity[1]
    if digits := re.fullmatch(r"#(\d+)|#x([\da-fA-F]+)", code):
        return chr(int(digits[1]) if digits[1] else int(digits[2], 16))
    return _ENTITIES.get(code, entity[0])


@dataclass(eq=False)
class _Element:
    """An element of the text; a file as a whole is one without a tag.

    Attributes:
        tag: empty for a file.
        home: folder of the file that it was read from.
        attributes: in their order.
        space: before the end of its start tag.
        close: its end tag; None where it closes itself.
        children: elements, and the text and comments between them.
        parent: what it lies in; for an included file the `<include>`.
        included: the file that an `<include>` stands for.
    """

    tag: str
    home: str
    attributes: list[_Attribute] = field(default_factory=list)
    space: str = ""
    close: str | None = ""
    children: "list[str | _Element]" = field(default_factory=list)
    parent: "_Element | None" = None
    included: "_Element | None" = None

    def get(self, name: str) -> str | None:
        """An attribute's value; None without it."""
        return next((a.value for a in self.attributes if a.name == name), None)

    def news(self, attributes: Mapping[str, str | None]) -> dict[str, str | None]:
        """Those that would change it; one that has its value keeps its spelling."""
        return {n: v for n, v in attributes.items() if not _same(n, self.get(n), v)}

    def set(self, attributes: Mapping[str, str | None]) -> None:
        """Change, add and (None) remove attributes."""
        for name, value in self.news(attributes).items():
            old = next((a for a in self.attributes if a.name == name), None)
            if value is None:
                self.attributes = [a for a in self.attributes if a is not old]
                continue
            if old is None:
                quote = self.attributes[-1].quoted[0] if self.attributes else '"'
                old = _Attribute(" ", name, "=", 2 * quote)
                self.attributes.append(old)
            old.write(value)

    def text(self) -> str:
        """All of it, as it stands in the file."""
        if not self.tag:
            return self.inner()
        start = f"<{self.tag}{''.join(a.text() for a in self.attributes)}{self.space}"
        return f"{start}/>" if self.close is None else f"{start}>{self.inner()}"

    def inner(self) -> str:
        """What follows its start tag."""
        texts = (c if isinstance(c, str) else c.text() for c in self.children)
        return "".join(texts) + (self.close or "")

    def root(self) -> "_Element":
        """A file's outermost element."""
        return next(c for c in self.children if isinstance(c, _Element))

    def elements(self) -> "Iterator[_Element]":
        """Its children, those of an included file in the place of the `<include>`."""
        for child in self.children:
            if isinstance(child, _Element):
                if child.included:
                    yield from child.included.root().elements()
                else:
                    yield child

    def walk(self) -> "Iterator[_Element]":
        """Everything below it: `<include>`, then what it includes."""
        for child in self.children:
            if isinstance(child, _Element):
                yield child
                yield from (child.included.root() if child.included else child).walk()

    def includes(self) -> "list[_Element]":
        """Every `<include>` that leads to it, the outermost first."""
        above = self.parent.includes() if self.parent else []
        return [*above, self] if self.included else above


def _same(name: str, old: str | None, new: str | None) -> bool:
    """Whether two values are one: the same text, or the same numbers."""
    if old is None or new is None or name == "name" or old == new:
        return old == new
    try:
        numbers = [[float(v) for v in text.split()] for text in (old, new)]
    except ValueError:
        return False
    return numbers[0] == numbers[1]


def _parse(text: str, home: str, where: str) -> _Element:
    """A text as the file's element."""
    top = document = _Element("", home)
    position = 0
    for found in _MARKUP.finditer(text):
        between = text[position : found.start()]
        if "<" in between or (found["close"] or top.tag) != top.tag:
            break
        position = found.end()
        top.children += [between] if between else []
        if found["aside"]:
            top.children.append(found[0])
        elif found["close"] and top.parent:
            top.close, top = found[0], top.parent
        else:
            child = _start(found, top)
            top.children.append(child)
            top = top if found["end"] else child
    if top is not document or "<" in text[position:]:
        line = text.count("\n", 0, position) + 1
        inside = f"in <{top.tag}>, " if top.tag else ""
        raise ModelError(f"{where}: no well-formed XML: {inside}after line {line}")
    document.children.append(text[position:])
    if not any(isinstance(c, _Element) for c in document.children):
        raise ModelError(f"{where}: no XML: it has no element")
    return document


def _start(found: re.Match[str], parent: _Element) -> _Element:
    """The element that a start tag opens."""
    attributes = [
        _Attribute(*parts) for parts in re.findall(_ATTRIBUTE, found["attributes"])
    ]
    close = None if found["end"] else ""
    return _Element(
        found["open"], parent.home, attributes, found["space"], close, parent=parent
    )


# the model as a tree of files

_BODIES = ("worldbody", "body")
_SETTINGS = ("compiler", "option", "size", "statistic", "visual")
_SECTIONS = ("actuator", "contact", "equality", "keyframe", "sensor", "tendon")
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


class _Tree:
    """A model's files, the included ones where they are included."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = os.fspath(path)
        self.home = os.path.realpath(os.path.dirname(os.path.abspath(path)))
        text = _read(self.path)
        self.document = _parse(text, self.home, self.path)
        if self.document.root().tag == "robot":
            text = _from_urdf(self.path)
            self.document = _parse(text, self.home, self.path)
        self.root = self.document.root()
        if self.root.tag != "mujoco":
            tag = self.root.tag
            raise ModelError(f"{self.path}: <{tag}> is no model; <mujoco> or <robot>")
        self.twins: dict[str, tuple[mujoco.MjModel, dict[str | None, _Element]]] = {}
        self.newline = "\r\n" if "\r\n" in text else "\n"
        self._include(self.document, {os.path.realpath(self.path)})

    def _include(self, file: _Element, seen: set[str]) -> None:
        """Read what a file includes."""
        for element in [e for e in file.walk() if e.tag == "include"]:
            path = _first(element.get("file") or "", self.home, element.home)
            if os.path.realpath(path) in seen:  # MuJoCo refuses it too
                raise ModelError(f"{self.path}: {path} is included twice")
            seen.add(os.path.realpath(path))
            text = _read(path).removeprefix("\ufeff")
            text = text.replace("\r\n", "\n").replace("\n", self.newline)
            element.included = _parse(text, os.path.dirname(path), path)
            element.included.parent = element
            self._include(element.included, seen)

    def sections(self, tag: str) -> list[_Element]:
        """The model's outermost elements of a tag."""
        return [e for e in self.root.elements() if e.tag == tag]

    def candidates(self, tag: str) -> list[_Element]:
        """All elements of the text that an edit with this tag can speak of."""
        if tag in _SECTIONS:
            return [e for s in self.sections(tag) for e in s.elements()]
        if tag in ("mujoco", *_SETTINGS):
            raise ModelError(f"{self.path}: a <{tag}> has no name; say '' for it")
        if tag not in _KINDS:
            raise UnknownNameError("tag", tag, ("mujoco", *_SETTINGS, *_KINDS))
        tags = {"joint": ("joint", "freejoint"), "body": ("worldbody", "body")}
        return [e for e in self._things() if e.tag in tags.get(tag, (tag,))]

    def _things(self) -> Iterator[_Element]:
        """Bodies and what is in them, without what MuJoCo multiplies."""
        stack = self.sections("worldbody")[::-1]
        while stack:
            element = stack.pop()
            yield element
            if element.tag in ("worldbody", "body", "frame"):
                stack += list(element.elements())[::-1]

    def find(self, tag: str, name: str) -> _Element:
        """The element of a name; of several (worlds) the last of the main file."""
        found = [e for e in self.candidates(tag) if _name(e) == name]
        if not found:
            raise ModelError(self._missing(tag, name))
        return next((e for e in found[::-1] if not e.includes()), found[-1])

    def _missing(self, tag: str, name: str) -> str:
        names = [_name(e) for e in self.candidates(tag)]
        there = [repr(n) for n in names if n is not None]
        unnamed = f"{names.count(None)} without a name" if None in names else ""
        there += [unnamed] if unnamed else []
        makers = sorted({e.tag for e in self._things() if e.tag in _MAKERS})
        made = f"; what {', '.join(f'<{m}>' for m in makers)} makes has no text"
        return (
            f"{self.path}: the text has no {tag} {name!r}; there are: "
            f"{', '.join(there) or 'none'}{made if makers else ''}"
        )

    def by_id(self, edit: Set | Insert | Rename) -> _Element:
        """The element that has an id in the compiled model: MuJoCo is asked."""
        tag, index = edit.tag, int(edit.name)
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

    def _twin(self, tag: str) -> "tuple[mujoco.MjModel, dict[str | None, _Element]]":
        """The same model with a name for all of a kind, and what has which name."""
        twin, names = _Tree(self.path), {}
        pairs = zip(self.candidates(tag), twin.candidates(tag), strict=True)
        for k, (own, its) in enumerate(pairs):
            if _name(twin.own(its)) is None:
                _bearer(its).set({"name": f"unnamed element {k}"})
            names[_name(its)] = own
        return twin.compiled(), names

    def compiled(self) -> "mujoco.MjModel":
        """The model as MuJoCo reads it."""
        with tempfile.TemporaryDirectory() as folder:
            _relocate(self, os.path.realpath(folder))
            path = Path(folder) / "model.xml"
            path.write_bytes(self.document.text().encode())
            try:
                return mujoco.MjModel.from_xml_path(str(path))
            except ValueError as error:
                raise ModelError(_refusal(self.path, error)) from error

    def own(self, element: _Element) -> _Element:
        """Bring an element into the main file, with the files that it lies in."""
        for include in element.includes():
            file, above = include.included, include.parent
            assert file and above
            indent, root = _indent(include), file.root()
            margin = "" if indent is None else self.newline + indent
            at = file.children.index(root)
            pieces: list[str | _Element] = []
            for note in _notes(file.children[:at]):
                pieces += [note, margin]
            pieces += _trimmed(root.children)
            for note in _notes(file.children[at:]):
                pieces += [margin, note]
            _put(above, above.children.index(include), pieces, replaced=1)
        return element

    def section(self, tag: str, first: bool = False) -> _Element:
        """A section or a setting of the main file; made where it has none."""
        found = self.sections(tag)
        if found and (first or not found[-1].includes()):
            return self.own(found[0 if first else -1])
        return self.insert(self.root, f"<{tag}/>", first=False)

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

    def insert(self, parent: _Element, xml: str, first: bool) -> _Element:
        """Put a text into an element of the main file; gives its first element."""
        margin = self._margin(parent)
        lines = inspect.cleandoc(xml).splitlines()
        text = (margin or self.newline).join(lines)
        pieces = _parse(text, self.home, f"text to insert, {xml!r}").children
        new = next(p for p in pieces if isinstance(p, _Element))
        if parent.close is None:
            parent.space, parent.close = "", f"</{parent.tag}>"
        at = 0 if first else _place(parent, new.tag)
        at = _after_note(parent.children, at)
        rest = "".join(p for p in parent.children[at:] if isinstance(p, str))
        first_child = not any(isinstance(p, _Element) for p in parent.children)
        end = []  # the end tag gets a line of its own with the first child
        if margin and first_child and "\n" not in rest:
            end = [self.newline + (_indent(parent) or "")]
        _put(parent, at, [margin, *pieces, *end])
        return new

    def _margin(self, parent: _Element) -> str:
        """What stands before a child: a line's end and indentation; "" in a line."""
        children = [c for c in parent.children if isinstance(c, _Element)]
        indents = [i for c in children if (i := _indent(c)) is not None]
        if indents:
            return self.newline + indents[0]
        base = _indent(parent)
        if children or base is None:
            return ""
        tops = (_indent(c) for c in self.root.children if isinstance(c, _Element))
        step = next((t for t in tops if t), "").removeprefix(_indent(self.root) or "")
        return self.newline + base + (step or "  ")


def _apply(tree: _Tree, edit: Set | Insert | Rename, element: _Element | None) -> None:
    """Make one edit; `element` where its id has told which it is."""
    general = edit.name == "" and edit.tag in (*_SETTINGS, *_SECTIONS)
    if isinstance(edit, Set) and general:
        tree.configure(edit.tag, edit.attributes)
        return
    if edit.tag == "mujoco" and edit.name == "":
        element = tree.root
    elif general:
        first = isinstance(edit, Insert) and edit.first
        element = tree.section(edit.tag, first)
    elif element is None:
        element = tree.find(edit.tag, str(edit.name))
    if isinstance(edit, Insert):
        tree.insert(tree.own(element), edit.xml, edit.first)
        return
    if isinstance(edit, Rename) and element.tag != edit.to:
        tree.own(element).tag = edit.to
        element.close = f"</{edit.to}>" if element.close else None
    if element.news(edit.attributes):
        tree.own(element).set(edit.attributes)


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
        spec = mujoco.MjSpec.from_file(path)
        spec.compile()
        return spec.to_xml()
    except ValueError as error:
        raise ModelError(_refusal(path, error)) from error


def _refusal(path: str, error: Exception) -> str:
    return f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}"


def _bearer(element: _Element) -> _Element:
    """The element whose name an edit says: of an inertia the body."""
    bearer: _Element | None = element
    while element.tag == "inertial" and bearer and bearer.tag not in _BODIES:
        bearer = bearer.parent
    return bearer or element


def _name(element: _Element) -> str | None:
    bearer = _bearer(element)
    return "world" if bearer.tag == "worldbody" else bearer.get("name")


def _indent(element: _Element) -> str | None:
    """The space before an element that begins its line; None for another one."""
    assert element.parent
    pieces = element.parent.children
    at = pieces.index(element)
    before = pieces[at - 1] if at else ""
    start, line_end, indent = (
        before.rpartition("\n") if isinstance(before, str) else ("", "", "x")
    )
    if line_end and not indent.strip():
        return indent
    return None if element.parent.tag else ""


def _notes(pieces: Iterable[str | _Element]) -> list[str]:
    """The comments among them."""
    return [p for p in pieces if isinstance(p, str) and p.startswith("<!--")]


def _is_space(piece: str | _Element) -> bool:
    return isinstance(piece, str) and not piece.strip()


def _trimmed(pieces: Sequence[str | _Element]) -> list[str | _Element]:
    """Pieces without the space around them."""
    kept = [i for i, piece in enumerate(pieces) if not _is_space(piece)]
    return list(pieces[kept[0] : kept[-1] + 1]) if kept else []


def _put(
    parent: _Element, at: int, pieces: Sequence[str | _Element], replaced: int = 0
) -> None:
    """Make pieces children of an element."""
    for piece in pieces:
        if isinstance(piece, _Element):
            piece.parent = parent
    parent.children[at : at + replaced] = pieces


def _place(parent: _Element, tag: str) -> int:
    """Where a child belongs: after its kind, before bodies, settings at the front."""
    pieces = parent.children
    children = [(i, c) for i, c in enumerate(pieces) if isinstance(c, _Element)]
    end = max((i for i, p in enumerate(pieces) if not _is_space(p)), default=-1) + 1
    if parent.tag == "mujoco" and tag in _SETTINGS:
        return max((i + 1 for i, c in children if c.tag in _SETTINGS[:2]), default=0)
    if parent.tag not in (*_BODIES, "frame"):
        return end
    if alike := [i for i, c in children if _holds(c, tag)]:
        return alike[-1] + 1
    body = next((i for i, c in children if _holds(c, "body")), len(pieces))
    if tag == "body" or body == len(pieces):
        return end
    return max((i + 1 for i, _ in children if i < body), default=0)


def _holds(element: _Element, tag: str) -> bool:
    """Whether it is of a kind, or brings one into the body that it stands in."""
    if element.tag == tag or element.tag == "body":
        return element.tag == tag
    inside = element.included.root() if element.included else element
    return any(_holds(e, tag) for e in inside.elements())


def _after_note(pieces: Sequence[str | _Element], at: int) -> int:
    """Past a comment that ends the same line."""
    line = at
    while line < len(pieces) and isinstance(piece := pieces[line], str):
        if piece.startswith("<!--"):
            at = line + 1
        elif piece.strip() or "\n" in piece:
            break
        line += 1
    return at


# where files are

_FILES = {
    **dict.fromkeys(("mesh", "hfield", "skin", "flexcomp"), ("meshdir", ("file",))),
    "texture": (
        "texturedir",
        ("file", *(f"file{s}" for s in "right left up down front back".split())),
    ),
}


def _first(name: str, *folders: str) -> str:
    """The first folder that has a file; MuJoCo looks in the main model's first."""
    places = [os.path.join(folder, name) for folder in folders]
    return next((p for p in places if os.path.isfile(p)), places[0])


def _way(path: str, folder: str) -> str:
    """A relative path as a model writes it."""
    return Path(os.path.relpath(path, folder)).as_posix()


def _point(element: _Element, target: str, folder: str) -> None:
    """Make an element's `file` lead from a folder to where it shall."""
    name = element.get("file") or ""
    leads = os.path.normpath(os.path.join(folder, name))
    if leads != os.path.normpath(target):
        element.set({"file": _way(target, folder)})


def _relocate(tree: _Tree, folder: str) -> None:
    """Make every path lead from `folder` to the file that it led to."""
    for element in [e for e in tree.root.walk() if e.included]:
        path, above = element.get("file") or "", element.parent
        target = _first(path, tree.home, element.home)
        if above and above.includes() and target != _first(path, folder, element.home):
            tree.own(above)  # only the model's own folder led to it
    for element in [e for e in tree.root.walk() if e.tag == "model"]:
        if not (name := element.get("file")):
            continue  # MuJoCo will say so
        target = _first(name, element.home, tree.home)
        if not element.includes() or target != _first(name, element.home, folder):
            _point(tree.own(element), target, folder)
    _relocate_assets(tree, folder)
    for element in [e for e in tree.root.walk() if e.includes() == [e]]:
        target = _first(element.get("file") or "", tree.home, element.home)
        _point(element, target, folder)


def _relocate_assets(tree: _Tree, folder: str) -> None:
    """Move the folders of meshes and textures, as seen from where the text will lie."""
    owners = {kind: _owner(tree, kind) for kind in ("meshdir", "texturedir")}
    used = [k for k, owner in owners.items() if _leads(tree, k, _value(owner))]
    if folder == tree.home:
        return
    moved = {owner: _value(owner) for k in used if (owner := owners[k])}
    for (element, attribute), value in moved.items():
        if not os.path.isabs(value):
            way = _way(os.path.join(tree.home, value), folder)
            tree.own(element).set({attribute: way})
    for kind in used:  # again: owning may have brought more into the main file
        _leads(tree, kind, moved[owner] if (owner := owners[kind]) else "")
    if bare := [kind for kind in used if not owners[kind]]:
        attribute = bare[0] if len(bare) == 1 else "assetdir"
        tree.section("compiler").set({attribute: _way(tree.home, folder)})


def _owner(tree: _Tree, kind: str) -> tuple[_Element, str] | None:
    """The compiler and the attribute that have the last word on a folder."""
    for element in tree.sections("compiler")[::-1]:
        for attribute in (kind, "assetdir"):
            if element.get(attribute) is not None:
                return element, attribute
    return None


def _value(owner: tuple[_Element, str] | None) -> str:
    return (owner[0].get(owner[1]) or "") if owner else ""


def _leads(tree: _Tree, kind: str, value: str) -> bool:
    """Whether a folder leads to any file; an inlined element is made to use it.

    MuJoCo looks for the file of an included element in that folder first, then beside
    the file that includes it.
    """
    base, leads = os.path.join(tree.home, value), False
    strips = any(c.get("strippath") == "true" for c in tree.sections("compiler"))
    for element in tree.root.walk():
        its_kind, attributes = _FILES.get(element.tag, ("", ()))
        for attribute in attributes if its_kind == kind else ():
            name = element.get(attribute) or ""
            name = os.path.basename(name) if strips else name
            if not name or os.path.isabs(name):
                continue
            path = _first(name, base, element.home)
            if path != os.path.join(base, name):
                if element.includes():
                    continue  # it stays beside the file that includes it
                element.set({attribute: _way(path, base)})
            leads = True
    return leads
