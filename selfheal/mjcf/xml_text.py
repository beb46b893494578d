"""XML text: takes a text, gives elements whose parts together are exactly the text.

MuJoCo's reader forgives more than XML does ("--" in a comment, a bare "&"), and so does
this one.
"""

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..errors import ModelError

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
    """The parts of ` name="value"`."""

    space: str
    name: str
    equals: str
    quoted: str

    @property
    def value(self) -> str:
        """The value, without quotes and with entities decoded."""
        return re.sub(r"&(#?\w+);", _decode_entity, self.quoted[1:-1])

    def write(self, value: str) -> None:
        """Replace the value; the kind of quotes stays."""
        quote = self.quoted[0]
        raw = value.replace("&", "&amp;").replace("<", "&lt;")
        raw = raw.replace(quote, "&quot;" if quote == '"' else "&apos;")
        self.quoted = f"{quote}{raw}{quote}"

    def to_text(self) -> str:
        """The attribute as it stands in the text."""
        return f"{self.space}{self.name}{self.equals}{self.quoted}"


def _decode_entity(entity: re.Match[str]) -> str:
    """Character that an entity means; the entity where MuJoCo does not know it."""
    code = entity[1]
    if digits := re.fullmatch(r"#(\d+)|#x([\da-fA-F]+)", code):
        return chr(int(digits[1]) if digits[1] else int(digits[2], 16))
    return _ENTITIES.get(code, entity[0])


@dataclass(eq=False)
class Element:
    """An element of the text; a file as a whole is one without a tag.

    Attributes:
        tag: of the element; empty for a file.
        home: folder of the file that the element was read from.
        space: between the attributes and the end of the start tag.
        close: the end tag; None where the element closes itself.
        children: elements, and the text and comments between them.
        parent: element that holds this one; of an included file the `<include>`.
        included: file that an `<include>` stands for.
    """

    tag: str
    home: str
    attributes: list[_Attribute] = field(default_factory=list)
    space: str = ""
    close: str | None = ""
    children: "list[str | Element]" = field(default_factory=list)
    parent: "Element | None" = None
    included: "Element | None" = None

    def get(self, name: str) -> str | None:
        """Value of an attribute; None without it."""
        return next((a.value for a in self.attributes if a.name == name), None)

    def get_path(self, name: str) -> str:
        """Value of an attribute as a path of this system; empty without it."""
        return os.fsdecode((self.get(name) or "").encode(errors="surrogateescape"))

    def find_changes(
        self, attributes: Mapping[str, str | None]
    ) -> dict[str, str | None]:
        """Attributes that would change the element; equal numbers are no change."""
        return {
            n: v for n, v in attributes.items() if not _is_same_value(n, self.get(n), v)
        }

    def set(self, attributes: Mapping[str, str | None]) -> None:
        """Change, add or (None) remove attributes."""
        for name, value in self.find_changes(attributes).items():
            old = next((a for a in self.attributes if a.name == name), None)
            if value is None:
                self.attributes = [a for a in self.attributes if a is not old]
                continue
            if old is None:
                quote = self.attributes[-1].quoted[0] if self.attributes else '"'
                old = _Attribute(" ", name, "=", 2 * quote)
                self.attributes.append(old)
            old.write(value)

    def to_text(self) -> str:
        """The element as it stands in the text."""
        texts: list[str] = []
        # no recursion: a model may be nested more deeply than Python calls
        stack: list[str | Element] = [self]
        while stack:
            piece = stack.pop()
            if isinstance(piece, str):
                texts.append(piece)
                continue
            if piece.tag:
                texts.append(piece.start_tag())
            if piece.close is not None:
                stack += [piece.close, *piece.children[::-1]]
        return "".join(texts)

    def start_tag(self) -> str:
        """The start tag as it stands in the text."""
        attributes = "".join(a.to_text() for a in self.attributes)
        end = "/>" if self.close is None else ">"
        return f"<{self.tag}{attributes}{self.space}{end}"

    def root(self) -> "Element":
        """Outermost element of a file."""
        return next(c for c in self.children if isinstance(c, Element))

    def own_elements(self) -> "list[Element]":
        """Child elements, with an `<include>` as such."""
        return [c for c in self.children if isinstance(c, Element)]

    def elements(self) -> "Iterator[Element]":
        """Child elements, those of an included file in place of the `<include>`."""
        stack = self.own_elements()[::-1]
        while stack:
            child = stack.pop()
            if child.included:
                stack += child.included.root().own_elements()[::-1]
            else:
                yield child

    def walk(self) -> "Iterator[Element]":
        """All elements below; after an `<include>` those of its file."""
        stack = self.own_elements()[::-1]
        while stack:
            child = stack.pop()
            yield child
            inside = child.included.root() if child.included else child
            stack += inside.own_elements()[::-1]

    def list_includes(self) -> "list[Element]":
        """Every `<include>` that leads to this element, the outermost first."""
        found, element = [], self
        while element.parent:
            element = element.parent
            found += [element] if element.included else []
        return [*found[::-1], *([self] if self.included else [])]


def _is_same_value(name: str, old: str | None, new: str | None) -> bool:
    """Whether two values of an attribute are the same text or the same numbers."""
    if old is None or new is None or name == "name" or old == new:
        return old == new
    try:
        numbers = [[float(v) for v in text.split()] for text in (old, new)]
    except ValueError:
        return False
    return numbers[0] == numbers[1]


def parse(text: str, home: str, where: str) -> Element:
    """Parse a text into the element of its file.

    Args:
        where: what an error calls the text.

    Raises:
        ModelError: the text is no well-formed XML, or has no element.
    """
    top = document = Element("", home)
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
            child = _open_element(found, top)
            top.children.append(child)
            top = top if found["end"] else child
    if top is not document or "<" in text[position:]:
        line = text.count("\n", 0, position) + 1
        inside = f"in <{top.tag}>, " if top.tag else ""
        raise ModelError(f"{where}: no well-formed XML: {inside}after line {line}")
    document.children.append(text[position:])
    if not any(isinstance(c, Element) for c in document.children):
        raise ModelError(f"{where}: no XML: it has no element")
    return document


def _open_element(found: re.Match[str], parent: Element) -> Element:
    """Make the element that a start tag opens."""
    attributes = [
        _Attribute(*parts) for parts in re.findall(_ATTRIBUTE, found["attributes"])
    ]
    close = None if found["end"] else ""
    return Element(
        found["open"], parent.home, attributes, found["space"], close, parent=parent
    )


def find_indentation(element: Element) -> str | None:
    """Space before an element that begins its line; None where it does not."""
    assert element.parent
    pieces = element.parent.children
    at = pieces.index(element)
    before = pieces[at - 1] if at else ""
    _, line_end, indent = (
        before.rpartition("\n") if isinstance(before, str) else ("", "", "x")
    )
    if line_end and not indent.strip():
        return indent
    return None if element.parent.tag else ""


def format_path(path: str) -> str:
    """Text of a path of this system: whatever bytes it has, `encode_text` writes."""
    return os.fsencode(Path(path).as_posix()).decode(errors="surrogateescape")


def encode_text(text: str) -> bytes:
    """A text as UTF-8; in paths of other bytes, these."""
    return text.encode(errors="surrogateescape")


def list_comments(pieces: Iterable[str | Element]) -> list[str]:
    """Comments among the parts of a text."""
    return [p for p in pieces if isinstance(p, str) and p.startswith("<!--")]


def is_space(piece: str | Element) -> bool:
    """Whether a part of a text is nothing but space."""
    return isinstance(piece, str) and not piece.strip()


def trim_spaces(pieces: Sequence[str | Element]) -> list[str | Element]:
    """Parts of a text without the space around them."""
    kept = [i for i, piece in enumerate(pieces) if not is_space(piece)]
    return list(pieces[kept[0] : kept[-1] + 1]) if kept else []


def replace_children(
    parent: Element, at: int, pieces: Sequence[str | Element], replaced: int = 0
) -> None:
    """Replace children of an element.

    Args:
        at: index of the first child that is replaced.
    """
    for piece in pieces:
        if isinstance(piece, Element):
            piece.parent = parent
    parent.children[at : at + replaced] = pieces


def skip_trailing_comments(pieces: Sequence[str | Element], at: int) -> int:
    """Index of the first part, from `at`, after a comment that ends the same line."""
    line = at
    while line < len(pieces) and isinstance(piece := pieces[line], str):
        if piece.startswith("<!--"):
            at = line + 1
        elif piece.strip() or "\n" in piece:
            break
        line += 1
    return at
