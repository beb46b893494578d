"""The units of columns that state none: values and limits in; units and signs out."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import fmean

import numpy as np

from ..base import Floats
from ..model_facts import Place
from ..motion import Relation, find_step, measure_share_inside
from ..units import find_unit
from .assignment import Column, Match
from .words import read_words

_CANDIDATES = {
    "rad": ("rad", "deg", "turn"),
    "m": ("m", "mm", "cm"),
    "rad/s": ("rad/s", "deg/s", "rpm", "turn/s"),
    "m/s": ("m/s", "mm/s"),
}
Ends = tuple[float, float]  # of a range
SHARE = "share"  # of a range: the unit of joints from -100 to 100
_FULL, _WHOLE = 100.0, 100.5  # a whole share [%], and with rounding; LeRobot's
_LARGE = 4 * math.pi  # that no joint is in radians; chosen: two turns, as of ten meters
_FEW = 0.8  # share of values within limits, from which degrees are likely; chosen
_ENOUGH = 0.97  # share of values that a range has to hold; chosen
_CLOSE = math.log(1.6)  # of a slope to that of a unit; chosen: units are further apart
# ratio of a reading to its command from which they have two units; chosen: a weak drive
# follows by less than a third, units are further apart
OTHER_UNIT = 5.0
STRONG = 0.8  # correlation from which a slope gives the unit; chosen


@dataclass(frozen=True)
class UnitGuess:
    """How a column is to be converted.

    Attributes:
        unit: of it; "" where ranges say it.
        ranges: of the column and of the joint, where it is a share of that.
        sure: probability that it is right.
    """

    unit: str
    sign: int = 1
    ranges: tuple[Ends, Ends] | None = None
    sure: float = 0.5
    why: str = ""

    def convert(self, values: Floats) -> Floats:
        """Values (n) of the column in the model's unit, but for the sign."""
        if self.ranges is None:
            return values * get_factor(self.unit)
        (low, high), (bottom, top) = self.ranges
        return bottom + (values - low) * (top - bottom) / (high - low)


@dataclass(frozen=True)
class GuessedTarget:
    """Columns that a proposed map takes for one thing in the model.

    Attributes:
        columns: one, or each of a vector, with the stream's name where the log has
            several.
        sure: probability that they are right.
    """

    columns: Sequence[str]
    target: str
    unit: UnitGuess
    sure: float
    why: str


@dataclass(frozen=True)
class GuessedLine:
    """A rule of a proposed map.

    Attributes:
        kind: of the contract or "command".
        order: of quaternions.
        missing: what stands for no reading, where rows of it were seen.
    """

    kind: str
    targets: Sequence[GuessedTarget]
    order: str = "wxyz"
    missing: float | None = None

    @property
    def columns(self) -> list[str]:
        """Columns of all targets."""
        return [name for target in self.targets for name in target.columns]


def guess_position_units(
    matches: Sequence[Match], ranges: Mapping[int, Ends]
) -> list[UnitGuess]:
    """The unit of columns of positions, and of commands of position servos.

    Columns of a group have one unit unless the limits of their joints contradict
    it: the gripper of an arm in degrees may be in percent. A command and its reading
    have one unit.

    Args:
        matches: columns that may be taken to have one unit.
        ranges: of joints that have limits, by their number.
    """
    si = matches[0].place.unit
    stated = [find_stated(m.column, si) for m in matches]
    if len(known := {*stated} - {""}) == 1:
        common = UnitGuess(min(known), sure=0.95, why="the log states it of others")
    else:
        common = _guess_common_unit(matches, ranges)
    found = []
    for unit, match in zip(stated, matches, strict=True):
        beside = [
            m.column
            for m in matches
            if m.place.joint == match.place.joint and _overlap(m.column, match.column)
        ]
        found.append(
            UnitGuess(unit, sure=0.99, why="the log states it")
            if unit
            else _guess_share(beside, ranges.get(match.place.joint), common) or common
        )
    return found


def _overlap(one: Column, other: Column) -> bool:
    """Whether a command and a reading have values in common, as in one unit."""
    lows = [np.nanmin(c.values, initial=np.inf) for c in (one, other)]
    highs = [np.nanmax(c.values, initial=-np.inf) for c in (one, other)]
    return bool(max(lows) <= min(highs))


def find_stated(column: Column, si: str) -> str:
    """The unit that a log states, if it fits one of the contract; else ""."""
    found = find_unit(column.facts.unit) if column.facts.unit else None
    return column.facts.unit if found and found.si == si else ""


def _guess_common_unit(
    matches: Sequence[Match], ranges: Mapping[int, Ends]
) -> UnitGuess:
    """The unit in which most columns are within the limits of their joints."""
    si = matches[0].place.unit
    names = _CANDIDATES.get(si, (si,))
    limits = [find_limits(match.place, ranges) for match in matches]
    if not any(limits):
        return _guess_by_size(matches, si)
    inside = {
        name: fmean(
            measure_share_inside(m.column.values * get_factor(name), *ends)
            for m, ends in zip(matches, limits, strict=True)
            if ends
        )
        for name in names
    }
    first, best = names[0], max(inside, key=lambda name: inside[name])
    if inside[first] >= _ENOUGH:
        # degrees of a small motion are within limits in radians, too, but not back
        return UnitGuess(first, sure=0.9, why="within the joints' ranges")
    if si == "rad" and (share := _guess_normalized(matches, inside["deg"])):
        return share
    if inside[best] > inside[first] + 0.1:
        why = f"in {best} {inside[best]:.0%} is within the joints' ranges"
        why += f", in {first} {inside[first]:.0%}"
        return UnitGuess(best, sure=0.95, why=why)
    why = f"{inside[first]:.0%} is within the joints' ranges"
    return UnitGuess(first, sure=0.6, why=why)


def find_limits(place: Place, ranges: Mapping[int, Ends]) -> Ends | None:
    """The limits of a place, or of its joint; None where there are none."""
    if np.isfinite(place.high - place.low):
        return place.low, place.high
    return ranges.get(place.joint)


def _guess_normalized(matches: Sequence[Match], in_degrees: float) -> UnitGuess | None:
    """Whether joints are in shares of their ranges, from -100 to 100, as LeRobot's.

    Both are within limits. Encoders of one kind step alike in degrees, not in shares.

    Args:
        in_degrees: share of values that are within limits in degrees.
    """
    arm = [m.column for m in matches if not _is_gripper(m.column)]
    values = [c.values[np.isfinite(c.values)] for c in arm]
    largest = max((np.abs(v).max(initial=0.0) for v in values), default=0.0)
    usual = any({"observation", "action"} & {*c.facts.tokens} for c in arm)
    if not _LARGE < largest <= _WHOLE or not (usual or in_degrees < _FEW):
        return None
    read = [m.column for m in matches if m.place.kind == "joint_position"]
    steps = [find_step(c.values) for c in read if not _is_gripper(c)]
    steps = [step for step in steps if step]
    alike = len(steps) > 1 and max(steps) < 1.005 * min(steps)
    said = f"from -100 to 100, and {in_degrees:.0%} within the ranges in degrees"
    if alike and in_degrees > _FEW:
        return UnitGuess("deg", sure=0.95, why=f"{said}; all step by {steps[0]:.4g}")
    if len(steps) > 1 and not alike:
        said += f"; encoders step by {min(steps):.3g} to {max(steps):.3g}"
        return UnitGuess(SHARE, sure=0.95, why=said)
    clipped = any((np.abs(v) == _FULL).any() for v in values)
    if clipped or in_degrees < _ENOUGH:
        said += "; clipped at 100" * clipped
        return UnitGuess(SHARE, sure=0.9, why=said)
    why = f"{said}: degrees, or shares of each range (--preset lerobot-so101)?"
    return UnitGuess("deg", sure=0.5, why=why)


def _guess_by_size(matches: Sequence[Match], si: str) -> UnitGuess:
    """The unit of positions without limits, by how large they are."""
    values = np.concatenate([m.column.values for m in matches])
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    names = _CANDIDATES.get(si, (si,))
    is_large = len(names) > 1 and largest > (_LARGE if si == "rad" else 10.0)
    sure, why = 0.8 if is_large else 0.7, f"up to {largest:.4g}"
    return UnitGuess(names[is_large], sure=sure, why=why)


def _is_gripper(column: Column) -> bool:
    return not read_words().grippers.isdisjoint(column.facts.own)


def _guess_share(
    columns: Sequence[Column], limits: Ends | None, common: UnitGuess
) -> UnitGuess | None:
    """How the columns of a joint are shares of its range, where they are.

    Args:
        common: unit of the columns of all joints.
    """
    values = np.concatenate([c.values[np.isfinite(c.values)] for c in columns])
    if limits is None or not values.size:
        return None
    least, most = float(values.min()), float(values.max())
    within = least >= -105 and most <= 105
    is_gripper = any(map(_is_gripper, columns)) and least > -5
    if common.unit == SHARE:
        low = 0.0 if is_gripper else -_FULL
        return replace(common, unit="", ranges=((low, _FULL), limits))
    inside = measure_share_inside(values * get_factor(common.unit), *limits)
    # a gripper among joints in degrees is in percent, as LeRobot's are
    is_usual = common.unit == "deg" and is_gripper
    if (inside > 0.5 and not is_usual) or not within or most < 5:
        return None
    why = "a gripper in percent of its range, as LeRobot's are"
    if not is_usual:
        within_range = f"{inside:.0%} within the range in {common.unit}"
        why = f"{least:.3g} to {most:.3g}, and {within_range}: percent?"
    low = 0.0 if least > -5 else -_FULL
    return UnitGuess("", 1, ((low, _FULL), limits), 0.7, why)


def is_speed(place: Place) -> bool:
    """Whether a place has speeds, measured or commanded."""
    return place.unit.endswith("/s")


def guess_speed_unit(
    column: Column, place: Place, relation: Relation | None
) -> UnitGuess:
    """The unit of a column of speeds, and its sign.

    Args:
        relation: of the position in SI units over the integral of the speed; None where
            there is no position.
    """
    stated, names = find_stated(column, place.unit), _list_candidates(column, place)
    if relation is None or abs(relation.correlation) < STRONG:
        if stated:
            return UnitGuess(stated, sure=0.95, why="the log states it")
        return UnitGuess(names[0], sure=0.6, why="no position that moves to compare")
    best, distance = _find_nearest(names, relation)
    sign = 1 if relation.slope > 0 else -1
    if distance < _CLOSE:
        return UnitGuess(best, sign, None, 0.97, "the position is its integral")
    why = f"the position changes by {relation.slope:.3g} of its integral"
    return UnitGuess(best, sign, None, 0.4, why)


def guess_command_unit(
    column: Column, place: Place, relation: Relation
) -> UnitGuess | None:
    """The unit of a position servo's commands; None where no position follows.

    Args:
        relation: of the position in SI units over the command.
    """
    names = _list_candidates(column, place)
    if place.unit not in _CANDIDATES or abs(relation.correlation) < STRONG:
        return None
    best, distance = _find_nearest(names, relation)
    if distance > 2 * _CLOSE:
        return None
    why = "the position follows it"
    if distance > _CLOSE:
        why += f" by {relation.slope:.3g} {place.unit} for each 1 of it"
    return UnitGuess(best, 1, None, 0.95, why)


def _list_candidates(column: Column, place: Place) -> Sequence[str]:
    """Units that a column may have: the stated one alone where one is."""
    stated = find_stated(column, place.unit)
    return (stated,) if stated else _CANDIDATES.get(place.unit, (place.unit,))


def _find_nearest(names: Sequence[str], relation: Relation) -> tuple[str, float]:
    """The unit whose factor is next to a slope, and the logarithm of their ratio."""
    slope = abs(relation.slope)
    distance = {name: abs(math.log(slope / get_factor(name))) for name in names}
    best = min(distance, key=lambda name: distance[name])
    return best, distance[best]


def find_flipped(
    position: tuple[Match, UnitGuess], command: tuple[Match, UnitGuess]
) -> str:
    """Which of two columns that move against each other has the other sign.

    It follows from the limits of joint and command, where these are not symmetric.

    Returns:
        "position", "command", or "" where the limits leave it open.
    """
    gain = dict[str, float]()
    for name, (match, unit) in (("position", position), ("command", command)):
        place, values = match.place, unit.convert(match.column.values)
        limits = place if np.isfinite(place.high - place.low) else position[0].place
        as_is, flipped = (
            measure_share_inside(sign * values, limits.low, limits.high)
            for sign in (1, -1)
        )
        gain[name] = flipped - as_is
    best = max(gain, key=lambda name: gain[name])
    return best if gain[best] > 0.1 else ""


def get_factor(name: str) -> float:
    """From a unit to the SI unit; 1 of one that nobody knows."""
    unit = find_unit(name)
    return unit.factor if unit else 1.0
