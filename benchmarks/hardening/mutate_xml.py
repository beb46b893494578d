"""Broken models: an MJCF or URDF text and a seed in; another text out."""

import copy
import re
from xml.etree import ElementTree as ET

import numpy as np

from benchmarks.hardening.odd_xml import ODD_ELEMENTS, ODD_PREFIXES

_NUMBERS = ("nan", "inf", "-inf", "0", "-1", "-0.5", "1e308", "1e400", "1e-308", "1e12",
            "1e-12", "abc", "", "0x10", "1,5", "99999999999")  # fmt: skip
_TEXTS = ("", "no_such", "é", 70_000 * "n", "world", "true", "a b", "/", "..", "%s")
# an element of such a name stands for so many, one in the other, until the text is
# written: Python's trees are not made for that depth
_NESTS = {f"nest{depth}{tag}": (depth, tag) for depth in (2, 50, 300, 3000)
          for tag in ("frame", "body", "worldbody", "default")}  # fmt: skip


def mutate_xml(content: bytes, seed: int) -> bytes:
    """Change an element or a value of a whole XML text, or a few."""
    rng = np.random.default_rng(seed)
    root = ET.fromstring(content)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        _CHANGES[rng.integers(len(_CHANGES))](root, rng)
    text = ET.tostring(root, encoding="unicode")
    for name, (depth, tag) in _NESTS.items():
        text = text.replace(f"<{name}>", depth * f"<{tag}>")
        text = text.replace(f"</{name}>", depth * f"</{tag}>")
    if rng.random() < 0.05:
        text = ODD_PREFIXES[rng.integers(len(ODD_PREFIXES))] + text
    return text.encode()


def _draw(root: ET.Element, rng: np.random.Generator) -> tuple[ET.Element, ET.Element]:
    """An element and its parent; the root twice where it is alone."""
    pairs = [(parent, child) for parent in root.iter() for child in parent]
    return pairs[rng.integers(len(pairs))] if pairs else (root, root)


def _drop(root: ET.Element, rng: np.random.Generator) -> None:
    parent, child = _draw(root, rng)
    if parent is not child:
        parent.remove(child)


def _duplicate(root: ET.Element, rng: np.random.Generator) -> None:
    parent, child = _draw(root, rng)
    parent.append(copy.deepcopy(child))


def _move(root: ET.Element, rng: np.random.Generator) -> None:
    _, child = _draw(root, rng)
    place, _ = _draw(root, rng)
    place.append(copy.deepcopy(child))


def _rename(root: ET.Element, rng: np.random.Generator) -> None:
    _, child = _draw(root, rng)
    names = sorted({e.tag for e in root.iter()} | {"frame", "no_such", "include"})
    child.tag = names[rng.integers(len(names))]


def _nest(root: ET.Element, rng: np.random.Generator) -> None:
    """Put an element into many others, one in the other."""
    parent, child = _draw(root, rng)
    if parent is not child:
        parent.remove(child)
        names = list(_NESTS)
        ET.SubElement(parent, names[rng.integers(len(names))]).append(child)


def _change_value(root: ET.Element, rng: np.random.Generator) -> None:
    """Change a value: one number of several, how many there are, or a text."""
    named = [e for e in root.iter() if e.attrib]
    if not named:
        return
    element = named[rng.integers(len(named))]
    keys = sorted(element.attrib)
    key = keys[rng.integers(len(keys))]
    words, chance = element.attrib[key].split(), rng.random()
    numeric = all(re.fullmatch(r"[-+.\deE]+", word) for word in words) and words
    if chance < 0.1:
        del element.attrib[key]
    elif numeric and chance < 0.75:
        words[rng.integers(len(words))] = _NUMBERS[rng.integers(len(_NUMBERS))]
        element.attrib[key] = " ".join(words)
    elif numeric and chance < 0.85:
        element.attrib[key] = " ".join((2 * words)[: rng.integers(2 * len(words))])
    else:
        element.attrib[key] = _TEXTS[rng.integers(len(_TEXTS))]


def _swap_values(root: ET.Element, rng: np.random.Generator) -> None:
    """Give an element the attribute of another one."""
    named = [e for e in root.iter() if e.attrib]
    if not named:
        return
    giver, taker = (named[rng.integers(len(named))] for _ in range(2))
    keys = sorted(giver.attrib)
    key = keys[rng.integers(len(keys))]
    taker.attrib[key] = giver.attrib[key]


def _insert_odd(root: ET.Element, rng: np.random.Generator) -> None:
    place, text = ODD_ELEMENTS[rng.integers(len(ODD_ELEMENTS))]
    found = root if place == root.tag else root.find(place)
    if found is None:
        found = ET.SubElement(root, place)
    found.append(ET.fromstring(text))


_CHANGES = (_drop, _duplicate, _move, _rename, _nest, _change_value, _change_value,
            _change_value, _swap_values, _insert_odd, _insert_odd)  # fmt: skip
