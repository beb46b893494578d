"""Columns x, y, z and w of one thing: their names in; whose vectors they are out."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..model_facts import Place
from .assignment import ELEMENT, Column
from .column_names import score_names
from .unit_guesses import GuessedLine, UnitGuess

# words of a name, the unit of a sensor that measures it, and the kind of a body's
# signal; ROS's sensor_msgs/Imu, geometry_msgs/Pose and nav_msgs/Odometry
_THINGS: tuple[tuple[frozenset[str], str, str], ...] = (
    (frozenset({"orientation", "quaternion", "quat", "rotation"}), "1",
     "body_orientation"),
    (frozenset({"angular", "ang", "gyro", "gyroscope", "omega"}), "rad/s",
     "body_angular_velocity"),
    (frozenset({"acceleration", "acc", "accel", "accelerometer"}), "m/s^2", ""),
    (frozenset({"position", "translation", "pos"}), "m", "body_position"),
    (frozenset({"linear", "velocity", "vel"}), "m/s", "body_linear_velocity"),
    (frozenset({"force"}), "N", ""),
    (frozenset({"torque"}), "N m", ""),
)  # fmt: skip
_WIDTHS = {"body_orientation": 4}


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
        unit, kind = thing
        is_array = bool(ELEMENT.fullmatch(columns[0].name))
        if kind == "body_linear_velocity" and ("twist" in tokens or is_array):
            what = f"{name}: it may be" if is_array else (
                f"{stream or name}: a twist's linear velocity is")  # fmt: skip
            notes.append(
                f"{what} in the body's frame, that of a recording in the world's: "
                "left out"
            )
            continue
        place, why = _find_place(columns[0], unit, kind, places, taken)
        if place is None:
            continue
        taken.add((place.kind, place.name))
        names = [f"{stream}:{c.name}" if several else c.name for c in columns]
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
        found.append(
            GuessedLine(place.kind, names, [place.name], [guess], [0.8], [why], order)
        )
    return found, notes


def _guess_order(values: np.ndarray) -> str:
    """Order of quaternions (4, n) of what mostly stands upright and faces ahead."""
    first, last = np.nanmean(np.abs(values[[0, 3]]), axis=1)
    return "wxyz" if first > last else "xyzw"


def _find_thing(
    tokens: Sequence[str], width: int, known: str
) -> tuple[str, str] | None:
    """Unit and kind of what a name speaks of.

    Args:
        known: kind that a preset states; "" of none.
    """
    for words, unit, kind in _THINGS:
        is_named = words & set(tokens) and (width == 4) == (kind == "body_orientation")
        if kind == known if known else is_named:
            return unit, kind
    return None


def _find_place(
    column: Column,
    unit: str,
    kind: str,
    places: Mapping[str, Sequence[Place]],
    taken: set[tuple[str, str]],
) -> tuple[Place | None, str]:
    """The sensor or the body that a vector belongs to, and why."""
    width = _WIDTHS.get(kind, 3)
    fitting = [
        p for p in places.get("sensor", ())
        if p.unit == unit and p.width == width and ("sensor", p.name) not in taken
    ]  # fmt: skip
    bodies = [p for p in places.get(kind, ()) if (kind, p.name) not in taken]
    for options, what in ((fitting, "sensor"), (bodies, "body")):
        named = [p for p in options if score_names(column.facts, p.name) > 0.3]
        if named:
            return named[0], f"the name of the {what}"
    if fitting:
        return fitting[0], f"the model's first sensor in {unit}"
    return (bodies[0], "the model's first body") if bodies else (None, "")
