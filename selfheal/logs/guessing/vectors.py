"""Columns x, y, z and w of one thing: their names in; whose vectors they are out."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..model_facts import Place
from .assignment import ELEMENT, Column, qualify
from .column_names import score_names
from .unit_guesses import GuessedLine, GuessedTarget, UnitGuess
from .words import read_words


def match_vectors(
    vectors: Mapping[tuple[str, str], Sequence[Column]],
    places: Mapping[str, Sequence[Place]],
    several: bool,
) -> tuple[list[GuessedLine], list[str]]:
    """Find what in a model vectors belong to.

    Args:
        vectors: columns by stream and name, x, y, z and perhaps w.
        several: whether the log holds several streams.

    Returns:
        Lines of a map, and remarks.
    """
    found, notes, taken = list[GuessedLine](), list[str](), set[tuple[str, str]]()
    for (stream, name), columns in vectors.items():
        tokens = columns[0].facts.tokens
        rule = columns[0].rule
        thing = _find_thing(tokens, len(columns), rule.kind if rule else "")
        values = np.stack([column.values for column in columns])
        if thing is None or not np.isfinite(values).any() or not values.any():
            continue
        _, kind = thing
        is_array = bool(ELEMENT.fullmatch(columns[0].name))
        if kind == "body_linear_velocity" and ("twist" in tokens or is_array):
            twist = f"{stream or name}: a twist's linear velocity is"
            notes.append(
                f"{f'{name}: it may be' if is_array else twist} in the body's frame, "
                "that of a recording in the world's: left out"
            )
            continue
        place, why = _find_place(columns[0], thing, places, taken)
        if place is None:
            continue
        taken.add((place.kind, place.name))
        names = [qualify(column, several) for column in columns]
        order, why_order = "xyzw" if len(columns) == 4 else "wxyz", "as ROS has it"
        if rule:
            order, why_order = rule.order, "the preset states it"
        elif is_array and len(columns) == 4:
            order = _guess_order(values)
            why_order = f"{order}, in which it is upright: or does it lie on its side?"
        elif is_array:
            why_order = "an array of three"
        guess = UnitGuess("", sure=0.9, why=why_order)
        why = f"{why}; {why_order}" if is_array else why
        target = GuessedTarget(names, place.name, guess, 0.8, why)
        found.append(GuessedLine(place.kind, [target], order))
    return found, notes


def _guess_order(values: np.ndarray) -> str:
    """Order of quaternions (4, n) of what mostly stands upright and faces ahead."""
    first, last = np.nanmean(np.abs(values[[0, 3]]), axis=1)
    return "wxyz" if first > last else "xyzw"


def _find_thing(
    tokens: Sequence[str], width: int, known: str
) -> tuple[str, str] | None:
    """Unit and kind of what a name says.

    Args:
        known: kind that a preset states; "" of none.
    """
    for thing in read_words().vectors:
        fits = (width == 4) == (thing.kind == "body_orientation")
        is_named = fits and not thing.words.isdisjoint(tokens)
        if thing.kind == known if known else is_named:
            return thing.unit, thing.kind
    return None


def _find_place(
    column: Column,
    thing: tuple[str, str],
    places: Mapping[str, Sequence[Place]],
    taken: set[tuple[str, str]],
) -> tuple[Place | None, str]:
    """The sensor or the body that a vector belongs to, and why."""
    unit, kind = thing
    width = 4 if kind == "body_orientation" else 3
    sensors, bodies = (
        [place for place in places.get(k, ()) if (k, place.name) not in taken]
        for k in ("sensor", kind)
    )
    sensors = [place for place in sensors if (place.unit, place.width) == (unit, width)]
    for options, what in ((sensors, "sensor"), (bodies, "body")):
        for place in options:
            if score_names(column.facts, place.name) > 0.3:
                return place, f"the name of the {what}"
    if sensors:
        return sensors[0], f"the model's first sensor in {unit}"
    return (bodies[0], "the model's first body") if bodies else (None, "")
