"""Broken documents: a file's content and a seed in; another content out.

A format takes its files apart into a tree of dictionaries, lists and leaves, and writes
such a tree. What is done to a tree is the same for all of them.
"""

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

Mutate = Callable[[bytes, int], bytes]
Rng = np.random.Generator
_FILES = Path(__file__).parent / "files"
ODD = json.loads((_FILES / "odd.json").read_text())  # what is short of odd values
# chances to replace all of a part, and to change what a member of it holds; chosen
_WHOLE, _DESCENT = 0.05, 0.75


def make_mutation(
    name: str,
    decode: Callable[[bytes], Any],
    encode: Callable[[Any], bytes],
    draw_odd: Callable[[Any, Rng], Any],
) -> Mutate:
    """What changes a value of a file's tree, or a few, and writes it anew.

    Args:
        encode: the content of a tree, whatever it holds where; what took the place of
            all of it is JSON.
    """

    def mutate(content: bytes, seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        tree = decode(content)
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            tree = change_tree(tree, draw_odd, rng)
        if isinstance(tree, dict | list):
            return encode(tree)
        return _nest(json.dumps(tree, default=str))

    mutate.__name__ = name
    return mutate


def choose(options: Any, rng: Rng) -> Any:
    """One of some options, of any types."""
    return options[int(rng.integers(len(options)))]


def change_tree(tree: Any, draw_odd: Callable[[Any, Rng], Any], rng: Rng) -> Any:
    """A tree with one of its values changed, at a depth drawn on the way."""
    if not isinstance(tree, dict | list) or not tree or rng.random() < _WHOLE:
        return draw_odd(tree, rng)
    tree = tree.copy()
    keys = list(tree) if isinstance(tree, dict) else list(range(len(tree)))
    key = choose(keys, rng)
    if rng.random() < _DESCENT:
        tree[key] = change_tree(tree[key], draw_odd, rng)
        return tree
    kind = rng.integers(5)
    if kind == 0:
        del tree[key]
    elif kind == 1:
        tree[key] = draw_odd(tree[key], rng)
    elif kind == 2:
        tree[key] = tree[choose(keys, rng)]
    elif isinstance(tree, dict):
        tree[f"{key}2" if kind == 3 else ""] = tree.pop(key)
    elif kind == 3:
        tree.insert(key, tree[choose(keys, rng)])
    else:
        del tree[key:]
    return tree


# ---- JSON and TOML

_DEEP = "nested deeply"  # stands for lists in lists until the text is written
_ODD: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1e307, -1e307, 10**400, 2**63),
    *(float("nan"), float("inf"), "", "nan", "no such name", "joint:no_such"),
    *("../../etc/passwd", 100_000 * "x", [], {}, [None], {"": None}, [[]]),
    *(1000 * [0.5], _DEEP),
)


def _draw_odd_json(value: Any, rng: Rng) -> Any:
    """Another number, or something else."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if number and abs(value) < 1e300 and rng.random() < 0.4:
        return value * float(rng.choice([-1, 0.5, 2, 1e3, 1e6, 1e12, 1e-12]))
    return choose(_ODD, rng)


def _decode_json(content: bytes) -> Any:
    try:
        return json.loads(content)
    except (ValueError, RecursionError):  # as of one that was nested before
        return None


def _nest(text: str) -> bytes:
    """A text with the deep lists that it speaks of."""
    return text.replace(f'"{_DEEP}"', 100_000 * "[" + 100_000 * "]").encode(
        errors="replace"
    )


def _encode_toml(tree: Any) -> bytes:
    """Members in TOML; the tree may be a list."""
    members = tree if isinstance(tree, dict) else {"version": tree}
    lines = (f"{json.dumps(k)} = {_format_toml(v)}\n" for k, v in members.items())
    return _nest("".join(lines))


def _format_toml(value: Any) -> str:
    """A value in TOML, whose tables are inline; there is no null."""
    if isinstance(value, dict):
        members = (f"{json.dumps(k)} = {_format_toml(v)}" for k, v in value.items())
        return f"{{{', '.join(members)}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_format_toml, value))}]"
    if isinstance(value, bool | str):
        return json.dumps(value)
    return str(value or 0)


mutate_json = make_mutation(
    "mutate_json",
    _decode_json,
    lambda tree: _nest(json.dumps(tree)),
    _draw_odd_json,
)
mutate_lines = make_mutation(
    "mutate_lines",
    lambda content: [_decode_json(line) for line in content.splitlines()],
    lambda tree: _nest(
        "".join(
            f"{json.dumps(x)}\n" for x in (tree if isinstance(tree, list) else [tree])
        )
    ),
    _draw_odd_json,
)
mutate_toml = make_mutation(
    "mutate_toml",
    lambda content: tomllib.loads(content.decode()),
    _encode_toml,
    _draw_odd_json,
)


# ---- tables as text

_CELLS = (
    *(cell.encode("latin-1") for cell in ODD["cells"]),
    *(10_000 * b"9", 300_000 * b"x"),
)
_CODES = ("utf-16", "utf-32", "latin-1", "utf-8-sig", "cp500")
_SHARE = 0.1  # of texts that get another encoding; chosen


def mutate_text(content: bytes, seed: int) -> bytes:
    """Change cells, lines or the encoding of a text, at one place or a few."""
    changed = _mutate_cells(content, seed)
    rng = np.random.default_rng([seed, 1])
    if rng.random() > _SHARE:
        return changed
    code = choose(_CODES, rng)
    return content.decode(errors="replace").encode(code, errors="replace")


def _join(parts: Any, between: bytes) -> bytes:
    """Lines, or cells; what took the place of them alone."""
    return between.join(parts) if isinstance(parts, list) else parts


_mutate_cells = make_mutation(
    "mutate_cells",
    lambda content: [re.split(rb"([,\t =])", line) for line in content.split(b"\n")],
    lambda tree: _join([_join(line, b"") for line in tree], b"\n"),
    lambda value, rng: choose(_CELLS, rng),
)


# ---- XML: an element is a list of its name, its attributes and its elements

_TEXTS = (*ODD["texts"], 70_000 * "n")
# an element of such a name stands for so many, one in the other, until the text is
# written: Python's trees are not made for that depth
_NESTS = {
    f"nest{depth}{tag}": (depth, tag)
    for depth in (2, 50, 300, 3000)
    for tag in ("frame", "body", "worldbody", "default")
}
_ENTITIES = "".join(
    f'<!ENTITY e{k} "{10 * f"&e{k - 1};"}">' if k else '<!ENTITY e0 "lol">'
    for k in range(10)
)
# what may stand before the root
_PREFIXES = (
    f"<!DOCTYPE mujoco [{_ENTITIES}]>\n",
    *ODD["prefixes"],
    1_000_000 * "\n",
)
_ODD_ELEMENT, _PREFIX = 0.25, 0.05  # shares of models that get such; chosen


def mutate_xml(content: bytes, seed: int) -> bytes:
    """Change elements or values of a whole XML text, or put odd ones in."""
    rng = np.random.default_rng([seed, 1])
    if rng.random() < _ODD_ELEMENT:
        content = _insert_odd(content, rng)
        changed = _mutate_elements(content, seed) if rng.random() < 0.5 else content
    else:
        changed = _mutate_elements(content, seed)
    text = changed.decode(errors="replace")
    for name, (depth, tag) in _NESTS.items():
        text = text.replace(f"<{name}>", depth * f"<{tag}>")
        text = text.replace(f"</{name}>", depth * f"</{tag}>")
    return (choose(_PREFIXES, rng) * (rng.random() < _PREFIX) + text).encode()


def _insert_odd(content: bytes, rng: Rng) -> bytes:
    """A model with one of the elements of odd.xml in the place that it is odd in."""
    root, odd = ET.fromstring(content), ET.parse(_FILES / "odd.xml").getroot()
    place, element = choose([(p.tag, e) for p in odd for e in p], rng)
    found = root if place == root.tag else root.find(place)
    (ET.SubElement(root, place) if found is None else found).append(element)
    return ET.tostring(root)


def _take_apart(element: ET.Element) -> list[Any]:
    return [element.tag, dict(element.attrib), *map(_take_apart, element)]


def _build(tree: list[Any]) -> ET.Element:
    """An element of a tree of which any part may be missing, or another."""
    tags = [part for part in tree if isinstance(part, str) and part.isidentifier()]
    element = ET.Element(tags[0] if tags else "no_such")
    for part in tree:
        if isinstance(part, dict):
            element.attrib |= {
                k or "a": v for k, v in part.items() if isinstance(v, str)
            }
        elif isinstance(part, list):
            element.append(_build(part))
    return element


def _draw_odd_xml(value: Any, rng: Rng) -> Any:
    """Another number among several, another text, or an element in many others."""
    if not isinstance(value, str):
        return [choose(list(_NESTS), rng), value]
    words = value.split()
    if words and all(re.fullmatch(r"[-+.\deE]+", word) for word in words):
        if rng.random() < 0.1:
            return " ".join((2 * words)[: rng.integers(2 * len(words))])
        words[rng.integers(len(words))] = choose(ODD["numbers"], rng)
        return " ".join(words)
    return choose(_TEXTS, rng)


_mutate_elements = make_mutation(
    "mutate_elements",
    lambda content: _take_apart(ET.fromstring(content)),
    lambda tree: ET.tostring(_build(tree)),
    _draw_odd_xml,
)
