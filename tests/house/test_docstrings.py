"""Docstrings can be read alone, and say shapes and units; room by room."""

import ast
import inspect

import pytest

from tests.support.docstrings.coverage import (
    NEEDED,
    RULES,
    SHAPE,
    UNITS,
    RoomReader,
    list_rooms,
    measure_room,
)
from tests.support.docstrings.text import Docstring, count_words, split_sentences


@pytest.mark.parametrize("room", list_rooms())
def test_the_docstrings_of_a_room_say_what_they_must(room):
    found = measure_room(room)
    gaps = [f"{r}: {g}" for r in RULES if found.share(r) < NEEDED[r]
            for g in found.gaps[r]]  # fmt: skip
    assert not gaps, "\n".join(gaps)


def test_shapes_and_units_are_told_from_other_brackets():
    shapes = "(W, C)", "(N)", "(..., 3)", "(*B, 2)", "(A, P, 3)", "(N, 4 + P)", "(3)"
    units = "[rad]", "[m/s]", "[1]", "[kg m^2]", "[m or rad]", "[1/deg]", "[mm]"
    others = "(see below)", "(papers.md 1.3)", "[W, C]", "(s)", "[t0, t1]", "[key]"
    for text in (*shapes, *units, *others, "(rad)", "rad"):
        said = f"targets: {text} of the joints"
        assert bool(SHAPE.search(said)) == (text in shapes), text
        assert bool(UNITS.search(said)) == (text in units), text


GOOD = '''
def turn(angles: Floats, count: int, length: float) -> Floats:
    """Turn links.

    Args:
        angles: (N, P) of the joints, which may be
            several [rad].
        count: of links.
        length: of a link [m].

    Returns:
        (N, 3) position of the tip [m].
    """
'''


def _read(text):
    tree = ast.parse(text)
    classes = {n.name: n for n in tree.body if isinstance(n, ast.ClassDef)}
    reader = RoomReader({"Floats"}, {"known"}, classes)
    reader._read_body(tree, "module")
    return {rule: gaps for rule, gaps in reader.coverage.gaps.items() if gaps}


def test_a_docstring_that_says_all_has_no_gap():
    assert _read(GOOD) == {}


@pytest.mark.parametrize(
    ("old", "new", "rule"),
    [
        ("(N, P) of", "of", "shapes"),
        ("(N, 3) position", "position", "shapes"),
        ("several [rad]", "several", "units"),
        ("of a link [m]", "of a link", "units"),
        ("count: of links", "number: of links", "names"),
        ("count: of links", "count, angles: of links", "names"),
        ("Turn links.", "The same for links.", "opening"),
        ("Turn links.", f"Turn {30 * 'many '}links.", "sentences"),
        ("Turn links.", "Turn links; see `bygone`.", "references"),
        ('"""', "'''", ""),
    ],
)
def test_what_is_missing_is_a_gap(old, new, rule):
    assert old in GOOD
    assert set(_read(GOOD.replace(old, new))) <= {rule}
    assert not rule or rule in _read(GOOD.replace(old, new))


def test_a_function_without_a_docstring_is_a_gap():
    assert "docstring" in _read("def turn(angles: int) -> int:\n    return angles\n")


CLASSES = '''
class Solver:
    """Solves."""

    def solve(self, angles: Floats) -> None:
        """Solve for angles (N) [rad]."""

class Damped(Solver):
    """Solves with a damping."""

    damping: float = 0.1
    """Of a step [1]."""

class Exact(Damped):
    description = "It solves."

    def solve(self, angles: Floats) -> None:
        pass
'''


@pytest.mark.parametrize(
    ("old", "new", "gaps"),
    [
        ("", "", set()),
        ("Damped(Solver)", "Damped", {"docstring", "shapes", "units"}),
        ('"""Solve for angles (N) [rad]."""', "pass", {"docstring", "shapes", "units"}),
        ('description = "It solves."', "", {"docstring"}),
    ],
)
def test_an_override_inherits_its_docstring(old, new, gaps):
    assert old in CLASSES
    assert set(_read(CLASSES.replace(old, new))) == gaps


@pytest.mark.parametrize(("unit", "gaps"), [("[1]", set()), ("", {"units"})])
def test_a_field_may_have_a_docstring_of_its_own(unit, gaps):
    text = CLASSES.replace("class Damped", "@dataclass\nclass Damped")
    assert set(_read(text.replace("[1]", unit))) == gaps


def test_sentences_end_at_sections_entries_and_blank_lines():
    (node,) = ast.parse(GOOD).body
    text = ast.get_docstring(node)
    assert text == inspect.cleandoc(node.body[0].value.value)
    parsed = Docstring.parse(text)
    assert parsed.entries["angles"].endswith("be several [rad].")
    assert max(count_words(s) for s in split_sentences(text)) == 11
