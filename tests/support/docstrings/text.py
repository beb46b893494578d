"""The text of a docstring: its sections, its entries and its sentences."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

_SECTION = re.compile(
    r"^(Args|Returns|Yields|Raises|Attributes|Example|Examples|Note):\s*(.*)$"
)
_ENTRY = re.compile(
    r"^\*{0,2}([A-Za-z_]\w*(?:, (?:\w+|\.\.\.))*)(?: \([^)]*\))?:\s*(.*)$"
)


@dataclass(frozen=True)
class Docstring:
    """A docstring in its parts.

    Attributes:
        text: what stands before the first section.
        sections: name of a section -> its text.
        entries: name of an argument or attribute -> its description.
    """

    text: str
    sections: dict[str, str]
    entries: dict[str, str]

    @classmethod
    def parse(cls, docstring: str) -> "Docstring":
        """Split a docstring as `inspect.cleandoc` gives it."""
        sections: dict[str, list[str]] = {"": []}
        name = ""
        for line in docstring.split("\n"):
            if found := _SECTION.match(line):
                name = found[1]
                sections[name] = [found[2]]
            else:
                sections[name].append(line)
        entries: dict[str, str] = {}
        for part in ("Args", "Attributes"):
            last: list[str] = []
            for line in sections.get(part, ()):
                text, indent = line.strip(), len(line) - len(line.lstrip())
                if found := _ENTRY.match(text) if indent == 4 else None:
                    # a documentation site takes an argument's entry as one name
                    last = found[1].split(", ") if part != "Args" else [found[1]]
                    entries |= dict.fromkeys(last, found[2])
                for name in () if found else last:
                    entries[name] += f" {text}"
        joined = {name: "\n".join(lines) for name, lines in sections.items()}
        return cls(joined.pop(""), joined, entries)

    def describe(self, name: str) -> str:
        """The description of an argument, an attribute, or the "return"."""
        if name == "return":
            given = [self.sections.get(n, "") for n in ("Returns", "Yields")]
            return self.text + " ".join(given)
        whole = " ".join([self.text, *self.sections.values()])
        return self.entries.get(name, whole)


def split_sentences(docstring: str) -> Iterator[str]:
    """The sentences of a docstring; indented formulas and literal blocks left out."""
    paragraph: list[str] = []
    for line in [*docstring.split("\n"), ""]:
        text = line.strip()
        formula = line.startswith("    ") and re.search(r"\s(=|~|<=|:=|->)\s", line)
        formula = formula or "+--" in text  # a line of a drawn tree
        starts = _ENTRY.match(text) or _SECTION.match(text) or text.startswith("- ")
        if not text or formula or starts:
            whole = re.sub(r"`[^`]*`", "code", " ".join(paragraph))
            yield from re.split(r"(?<=[.?!])\s+(?=[A-Z`(\"'0-9])", whole)
            paragraph = []
        if text and not formula:
            paragraph.append(text)


def count_words(sentence: str) -> int:
    """The number of words of a sentence; signs that stand alone are none."""
    return sum(any(c.isalnum() for c in word) for word in sentence.split())
