"""The units of columns that state none: values and limits in; units and signs out."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..model_facts import Place
from ..motion import Relation, measure_share_inside
from ..units import find_unit
from .assignment import Column, Match

Floats = NDArray[np.float64]
_CANDIDATES = {"rad": ("rad", "deg", "turn"), "m": ("m", "mm", "cm")}
_SPEEDS = {"rad/s": ("rad/s", "deg/s", "rpm", "turn/s"), "m/s": ("m/s", "mm/s")}
_ENOUGH = 0.97  # share of values that a range has to hold; chosen
_CLOSE = math.log(1.6)  # of a slope to that of a unit; chosen: units are further apart
_STRONG = 0.8  # correlation from which a slope tells the unit; chosen


@dataclass(frozen=True)
class UnitGuess:
    """How a column is to be converted.

    Attributes:
        unit: of it; "" where ranges say it.
        sign: 1 or -1.
        ranges: of the column and of the model, where it is a share of a range.
        sure: probability that it is right.
        why: in a few words.
    """

    unit: str
    sign: int = 1
    ranges: tuple[tuple[float, float], tuple[float, float]] | None = None
    sure: float = 0.5
    why: str = ""


def guess_position_units(matches: Sequence[Match]) -> list[UnitGuess]:
    """The unit of each column of positions, or of commands of position servos.

    Columns of a group have one unit unless the limits of their joints speak against
    it: the gripper of an arm in degrees may be in percent.
    """
    stated = [_find_stated(m.column, m.place.unit) for m in matches]
    common = _guess_common_unit(matches)
    return [
        UnitGuess(unit, sure=0.99, why="the log states it")
        if unit
        else _guess_percent(match.column, match.place, common) or common
        for unit, match in zip(stated, matches, strict=True)
    ]


def _find_stated(column: Column, si: str) -> str:
    """The unit that a log states, if it fits one of the contract; else ""."""
    found = find_unit(column.facts.unit) if column.facts.unit else None
    return column.facts.unit if found and found.si == si else ""


def _guess_common_unit(matches: Sequence[Match]) -> UnitGuess:
    """The unit in which most columns are within the limits of their joints."""
    si = matches[0].place.unit
    names = _CANDIDATES.get(si, (si,))
    limited = [m for m in matches if np.isfinite(m.place.high - m.place.low)]
    if not limited:
        return _guess_by_size(matches, si)
    shares = {}
    for name in names:
        unit = find_unit(name)
        factor = unit.factor if unit else 1.0
        inside = [measure_share_inside(m.column.values * factor, m.place.low,
                                       m.place.high) for m in limited]  # fmt: skip
        shares[name] = float(np.mean(inside))
    first = names[0]
    if shares[first] >= _ENOUGH:
        # degrees of a small motion are within limits in radians, too, but not back
        return UnitGuess(first, sure=0.9, why="within the joints' ranges")
    best = max(shares, key=lambda name: shares[name])
    if shares[best] > shares[first] + 0.1:
        why = (f"in {best} {shares[best]:.0%} of it is within the joints' ranges, in "
               f"{first} {shares[first]:.0%}")  # fmt: skip
        return UnitGuess(best, sure=0.95, why=why)
    why = f"{shares[first]:.0%} of it is within the joints' ranges"
    return UnitGuess(first, sure=0.6, why=why)


def _guess_by_size(matches: Sequence[Match], si: str) -> UnitGuess:
    """The unit of positions without limits, by how large they are."""
    values = np.concatenate([m.column.values for m in matches])
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    names = _CANDIDATES.get(si, (si,))
    # chosen: two turns of a joint; ten meters
    if len(names) > 1 and largest > (4 * math.pi if si == "rad" else 10.0):
        return UnitGuess(names[1], sure=0.8, why=f"up to {largest:.4g}")
    return UnitGuess(names[0], sure=0.7, why=f"up to {largest:.4g}")


def _guess_percent(column: Column, place: Place, common: UnitGuess) -> UnitGuess | None:
    """A column that is a share of its range while the common unit does not fit it."""
    if not np.isfinite(place.high - place.low):
        return None
    values = column.values[np.isfinite(column.values)]
    unit = find_unit(common.unit)
    if unit is None or not values.size:
        return None
    inside = measure_share_inside(values * unit.factor, place.low, place.high)
    least, most = float(values.min()), float(values.max())
    # a gripper among joints in degrees is in percent, as LeRobot's are
    is_gripper = common.unit == "deg" and "gripper" in column.facts.own and least > -5
    if (inside > 0.5 and not is_gripper) or least < -105 or most > 105 or most < 5:
        return None
    low = 0.0 if least > -5 else -100.0
    return UnitGuess(
        "", 1, ((low, 100.0), (place.low, place.high)), 0.7,
        f"{least:.3g} to {most:.3g}, and {inside:.0%} within the range in "
        f"{common.unit}: percent?",
    )  # fmt: skip


def guess_speed_unit(
    column: Column, place: Place, relation: Relation | None
) -> UnitGuess:
    """The unit and the sign of a column of speeds.

    Args:
        column: of speeds.
        place: whose it is.
        relation: of the position in SI units over the integral of the column; None
            where there is no position.
    """
    names = _SPEEDS.get(place.unit, (place.unit,))
    stated = _find_stated(column, place.unit)
    if relation is None or abs(relation.correlation) < _STRONG:
        if stated:
            return UnitGuess(stated, sure=0.95, why="the log states it")
        return UnitGuess(names[0], sure=0.6, why="no position that moves to compare")
    distance = {name: abs(math.log(abs(relation.slope) / _get_factor(name)))
                for name in ((stated,) if stated else names)}  # fmt: skip
    best = min(distance, key=lambda name: distance[name])
    sign = 1 if relation.slope > 0 else -1
    why = f"the position changes by {relation.slope:.3g} of its integral"
    sure = 0.97 if distance[best] < _CLOSE else 0.4
    return UnitGuess(best, sign, None, sure, why)


def guess_command_unit(
    column: Column, place: Place, relation: Relation | None
) -> UnitGuess | None:
    """The unit of the command of a position servo.

    Args:
        column: of commands.
        place: whose it is.
        relation: of the position in SI units over the column; None where there is
            none.

    Returns:
        None where no position follows it.
    """
    names = _CANDIDATES.get(place.unit, ())
    if not names or relation is None or abs(relation.correlation) < _STRONG:
        return None
    stated = _find_stated(column, place.unit)
    distance = {name: abs(math.log(abs(relation.slope) / _get_factor(name)))
                for name in ((stated,) if stated else names)}  # fmt: skip
    best = min(distance, key=lambda name: distance[name])
    if distance[best] > 2 * _CLOSE:
        return None
    why = (f"the position follows it {relation.lag * 1000:.0f} ms later by "
           f"{relation.slope:.3g} {place.unit} for each 1 of it")  # fmt: skip
    return UnitGuess(best, 1, None, 0.95, why)


def find_flipped(
    position: tuple[Match, UnitGuess], command: tuple[Match, UnitGuess]
) -> str:
    """Which of two columns that move against each other counts the other way.

    The limits of the joint and of the command tell, where they are not symmetric.

    Args:
        position: of a joint, and its unit.
        command: of the joint's position servo, and its unit.

    Returns:
        "position", "command", or "" where limits do not tell.
    """
    gain = dict[str, float]()
    for name, (match, unit) in (("position", position), ("command", command)):
        place, values = match.place, match.column.values * _get_factor(unit.unit)
        limits = place if np.isfinite(place.high - place.low) else position[0].place
        asis, flipped = (measure_share_inside(sign * values, limits.low, limits.high)
                         for sign in (1, -1))  # fmt: skip
        gain[name] = flipped - asis
    best = max(gain, key=lambda name: gain[name])
    return best if gain[best] > 0.1 else ""


def _get_factor(name: str) -> float:
    unit = find_unit(name)
    return unit.factor if unit else 1.0
