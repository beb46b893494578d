"""Documents: takes a model's path, reads its files, finds and changes elements."""

import inspect
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

from ..errors import ModelError, UnknownNameError
from ..mujoco_files import explain_mesh
from ..printable import join_names, quote_name
from ..recording import read_spec
from .xml_text import (
    Element,
    find_indentation,
    is_space,
    list_comments,
    parse,
    replace_children,
    skip_trailing_comments,
    trim_spaces,
)

_BODIES = ("worldbody", "body")
SETTINGS = ("compiler", "option", "size", "statistic", "visual")
SECTIONS = ("actuator", "contact", "equality", "keyframe", "sensor", "tendon")
# elements that have an id in a compiled model, and can be edited by it
WITH_IDS = ("body", "inertial", "joint", "geom", "site", *SECTIONS)
MAKERS = ("replicate", "composite", "flexcomp", "attach")


class MjcfDocument:
    """A model as a tree of elements, with included files in their places.

    Attributes:
        home: folder of the model, without links.
        file: the main file, as an element without a tag.
        newline: how the main file ends its lines.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        text: str | None = None,
        *,
        in_place: bool,
    ) -> None:
        """Read a model's files.

        Args:
            text: that stands for the file's, in its folder.
            in_place: whether the user's own files are edited where they are: those in
                the model's folder are not inlined, and a URDF stays one.
        """
        self._in_place, self._included = in_place, dict[str, Element]()
        self.path = os.fspath(path)
        self.home = os.path.realpath(os.path.dirname(os.path.abspath(path)))
        text = _read_text(self.path) if text is None else text
        self.file = parse(text, self.home, self.path)
        stays_urdf = in_place and self.file.root().tag == "robot"
        if self.file.root().tag == "robot" and not in_place:
            text = _from_urdf(self.path)
            self.file = parse(text, self.home, self.path)
        self.root = self.file.root()
        if self.root.tag != "mujoco" and not stays_urdf:
            tag = self.root.tag
            raise ModelError(f"{self.path}: <{tag}> is no model; <mujoco> or <robot>")
        self.newline = "\r\n" if "\r\n" in text else "\n"
        self._include(self.file, {os.path.realpath(self.path)})

    def _include(self, file: Element, seen: set[str]) -> None:
        """Read the files that a file includes, and those that they include."""
        stack = _find_includes(file)[::-1]
        while stack:
            element = stack.pop()
            path = find_file(element.get_path("file"), self.home, element.home)
            if os.path.realpath(path) in seen:  # MuJoCo refuses it too
                raise ModelError(f"{self.path}: {path} is included twice")
            seen.add(os.path.realpath(path))
            text = _read_text(path)
            if not (is_own := self._is_edited(path)):
                text = text.removeprefix("\ufeff").replace("\r\n", "\n")
                text = text.replace("\n", self.newline)
            element.included = parse(text, os.path.dirname(path), path)
            element.included.parent = element
            if is_own:
                self._included[os.path.relpath(path, self.home)] = element.included
            stack += _find_includes(element.included)[::-1]

    def _is_edited(self, path: str) -> bool:
        """Whether an included file is edited where it is."""
        inside = os.path.relpath(path, self.home)
        return self._in_place and not inside.startswith(os.pardir)

    def list_texts(self) -> dict[str, str]:
        """Texts of the edited files, by their paths from the model's folder."""
        files = {os.path.basename(self.path): self.file, **self._included}
        return {name: file.to_text() for name, file in files.items()}

    def list_sections(self, tag: str) -> list[Element]:
        """The model's outermost elements of a tag."""
        return [e for e in self.root.elements() if e.tag == tag]

    def list_elements(self, tag: str) -> list[Element]:
        """List all elements that an edit with a tag can mean, in the text's order.

        Raises:
            ModelError: a setting, which has no name.
            UnknownNameError: no edit has this tag.
        """
        if tag in SECTIONS:
            return [e for s in self.list_sections(tag) for e in s.elements()]
        if tag in ("mujoco", *SETTINGS):
            raise ModelError(f"{self.path}: a <{tag}> has no name; say '' for it")
        if tag not in WITH_IDS:
            raise UnknownNameError("tag", tag, ("mujoco", *SETTINGS, *WITH_IDS))
        tags = {"joint": ("joint", "freejoint"), "body": ("worldbody", "body")}
        return [e for e in self._walk_bodies() if e.tag in tags.get(tag, (tag,))]

    def _walk_bodies(self) -> Iterator[Element]:
        """Elements in bodies, depth first, without those that MuJoCo multiplies."""
        stack = self.list_sections("worldbody")[::-1]
        while stack:
            element = stack.pop()
            yield element
            if element.tag in ("worldbody", "body", "frame"):
                stack += list(element.elements())[::-1]

    def find(self, tag: str, name: str) -> Element:
        """Find an element by name; of several (worlds) the last of the main file."""
        found = [e for e in self.list_elements(tag) if name_of(e) == name]
        if not found:
            raise ModelError(self.describe_missing(tag, name))
        return next((e for e in found[::-1] if not e.list_includes()), found[-1])

    def describe_missing(self, tag: str, name: str) -> str:
        """Say that the text has no element of a name, and which names it has."""
        names = [name_of(e) for e in self.list_elements(tag)]
        valid = [quote_name(n) for n in names if n is not None]
        unnamed = f"{names.count(None)} without a name" if None in names else ""
        valid += [unnamed] if unnamed else []
        makers = sorted({e.tag for e in self._walk_bodies() if e.tag in MAKERS})
        hint = f"; what {', '.join(f'<{m}>' for m in makers)} makes has no text"
        return (
            f"{self.path}: the text has no {tag} {quote_name(name)}; there are: "
            f"{join_names(valid) or 'none'}{hint if makers else ''}"
        )

    def inline(self, element: Element) -> Element:
        """Inline the files that hold an element, in place of their `<include>`.

        A file that is edited where it is stays there.
        """
        for include in element.list_includes():
            file, above = include.included, include.parent
            assert file and above
            if file in self._included.values():
                continue
            indent, root = find_indentation(include), file.root()
            margin = "" if indent is None else self.newline + indent
            at = file.children.index(root)
            pieces: list[str | Element] = []
            for note in list_comments(file.children[:at]):
                pieces += [note, margin]
            pieces += trim_spaces(root.children)
            for note in list_comments(file.children[at:]):
                pieces += [margin, note]
            replace_children(above, above.children.index(include), pieces, replaced=1)
        return element

    def get_section(self, tag: str, *, first: bool) -> Element:
        """A section or setting of a tag, made if there is none.

        Args:
            first: whether it is the model's first one, which is inlined; else it is the
                main file's last one.
        """
        found = self.list_sections(tag)
        if first and found:
            return self.inline(found[0])
        if found and not found[-1].list_includes():
            return found[-1]
        return self.insert(self.root, f"<{tag}/>", first=False)

    def list_default_classes(self) -> dict[str, Element]:
        """The main file's default classes by their names, the outermost first."""
        tops = [e for e in self.root.own_elements() if e.tag == "default"]
        found = {(e.get("class") or "main"): e for e in tops}
        for top in tops:
            inner = (e for e in top.walk() if e.tag == "default")
            found |= {str(e.get("class")): e for e in inner}
        return found

    def uses_degrees(self) -> bool:
        """Whether the text counts angles in degrees, as MJCF does by default."""
        angles = [e.get("angle") for e in self.list_sections("compiler")]
        return next((a for a in angles[::-1] if a), "degree") == "degree"

    def configure(self, tag: str, attributes: Mapping[str, str | None]) -> None:
        """Change attributes of a setting, each in the last element that states it."""
        for name, value in attributes.items():
            holders = [e for e in self.list_sections(tag) if e.get(name) is not None]
            if value is None:
                for holder in holders:
                    self.inline(holder).set({name: None})
            elif not holders:
                self.get_section(tag, first=False).set({name: value})
            elif holders[-1].find_changes({name: value}):
                self.inline(holders[-1]).set({name: value})

    def insert(self, parent: Element, xml: str, first: bool) -> Element:
        """Put a text into an element of the main file.

        Args:
            xml: the text; its indentation is adapted.

        Returns:
            The text's first element.
        """
        margin = self._margin(parent)
        lines = inspect.cleandoc(xml).splitlines()
        text = (margin or self.newline).join(lines)
        pieces = parse(text, self.home, f"text to insert, {xml!r}").children
        new = next(p for p in pieces if isinstance(p, Element))
        if parent.close is None:
            parent.space, parent.close = "", f"</{parent.tag}>"
        at = 0 if first else _find_place(parent, new.tag)
        at = skip_trailing_comments(parent.children, at)
        rest = "".join(p for p in parent.children[at:] if isinstance(p, str))
        first_child = not any(isinstance(p, Element) for p in parent.children)
        end = []  # the end tag gets a line of its own with the first child
        if margin and first_child and "\n" not in rest:
            end = [self.newline + (find_indentation(parent) or "")]
        replace_children(parent, at, [margin, *pieces, *end])
        return new

    def _margin(self, parent: Element) -> str:
        """Line end and indentation before a child; "" where children share a line."""
        children = parent.own_elements()
        indents = [i for c in children if (i := find_indentation(c)) is not None]
        if indents:
            return self.newline + indents[0]
        base = find_indentation(parent)
        if children or base is None:
            return ""
        tops = (find_indentation(c) for c in self.root.own_elements())
        step = next((t for t in tops if t), "").removeprefix(
            find_indentation(self.root) or ""
        )
        return self.newline + base + (step or "  ")


def is_urdf(path: str | os.PathLike[str]) -> bool:
    """Whether a model is a URDF; `ModelError`: it is no XML."""
    return parse(_read_text(os.fspath(path)), "", os.fspath(path)).root().tag == "robot"


def _find_includes(file: Element) -> list[Element]:
    """Every `<include>` of a file, in the text's order."""
    return [e for e in file.walk() if e.tag == "include"]


def find_file(name: str, *folders: str) -> str:
    """Path of a file in the first folder that has it, else in the first folder."""
    places = [os.path.join(folder, name) for folder in folders]
    return next((p for p in places if os.path.isfile(p)), places[0])


def _read_text(path: str) -> str:
    """Text of a file; a declared encoding other than UTF-8 becomes UTF-8.

    Raises:
        ModelError: the file cannot be read.
    """
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
    """MJCF text that MuJoCo makes of a URDF; `ModelError`: it cannot read it."""
    try:
        spec = read_spec(path)
        spec.compile()
        return spec.to_xml()
    except ValueError as error:
        raise ModelError(describe_refusal(path, error)) from error


def describe_refusal(path: str, error: Exception) -> str:
    """MuJoCo's reason for refusing a file, in one line, and a mesh's remedy."""
    reason = " ".join(str(error).split())
    return f"{path}: MuJoCo cannot read it: {reason}{explain_mesh(reason)}"


def find_named_element(element: Element) -> Element:
    """The element that bears an element's name: of an inertia it is the body."""
    bearer: Element | None = element
    while element.tag == "inertial" and bearer and bearer.tag not in _BODIES:
        bearer = bearer.parent
    return bearer or element


def name_of(element: Element) -> str | None:
    """Name of an element in the text; None without one."""
    bearer = find_named_element(element)
    return "world" if bearer.tag == "worldbody" else bearer.get("name")


def _find_place(parent: Element, tag: str) -> int:
    """Index among the children where one with a tag belongs.

    After those of its kind, before bodies; settings at the front.
    """
    pieces = parent.children
    children = [(i, c) for i, c in enumerate(pieces) if isinstance(c, Element)]
    end = max((i for i, p in enumerate(pieces) if not is_space(p)), default=-1) + 1
    if parent.tag == "mujoco" and tag in SETTINGS:
        return max((i + 1 for i, c in children if c.tag in SETTINGS[:2]), default=0)
    if parent.tag not in (*_BODIES, "frame"):
        return end
    if alike := [i for i, c in children if _contains(c, tag)]:
        return alike[-1] + 1
    body = next((i for i, c in children if _contains(c, "body")), len(pieces))
    if tag == "body" or body == len(pieces):
        return end
    return max((i + 1 for i, _ in children if i < body), default=0)


def _contains(element: Element, tag: str) -> bool:
    """Whether an element has a tag, or holds one that MuJoCo puts beside it."""
    stack = [element]
    while stack:
        element = stack.pop()
        if element.tag == tag:
            return True
        if element.tag != "body":
            inside = element.included.root() if element.included else element
            stack += inside.elements()
    return False
