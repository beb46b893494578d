"""Units and signs of matched columns together: matches in; conversions out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..log_map import COMMAND
from ..model_facts import Place
from ..motion import Relation, compare_command, compare_speed
from ..units import find_unit
from .assignment import Column, Match
from .unit_guesses import (
    OTHER_UNIT,
    STRONG,
    UnitGuess,
    find_flipped,
    find_limits,
    guess_moving_unit,
    guess_position_units,
)


@dataclass
class Relations:
    """How columns go with positions; each pair is compared once.

    Attributes:
        known: what was found, by the columns, and by whether they are speeds.
    """

    known: dict[tuple[int, int, bool], Relation] = field(default_factory=dict)

    def find(self, column: Column, position: Column, place: Place) -> Relation:
        """How a column goes with a position; see `relate`.

        Args:
            column: of speeds, or of commands; it lives as long as this.
            position: column of the joint's position; likewise.
            place: to which the first one belongs.
        """
        key = id(column), id(position), place.unit.endswith("/s")
        if key not in self.known:
            self.known[key] = relate(column, position, place)
        return self.known[key]


def guess_conversions(
    matches: Sequence[Match], relations: Relations
) -> list[UnitGuess]:
    """The unit of each match; those of positions first, for the others hang on them."""
    found = dict[int, UnitGuess]()
    ranges = {m.place.joint: (m.place.low, m.place.high) for m in matches
              if m.place.kind == "joint_position"
              and np.isfinite(m.place.high - m.place.low)}  # fmt: skip
    groups = _group_alike(matches, relations)
    for members in groups:
        guessed = guess_position_units([matches[k] for k in members], ranges)
        found |= dict(zip(members, guessed, strict=True))
    told = {k: unit for k, m in enumerate(matches)
            if (unit := _take_rule(m, ranges))}  # fmt: skip
    found |= told
    positions = {m.place.joint: k for k, m in enumerate(matches)
                 if m.place.kind == "joint_position"}  # fmt: skip
    scaled = {
        k: _scale(relations.find(m.column, matches[p].column, m.place), found[p])
        for k, m in enumerate(matches)
        if m.place.kind in (COMMAND, "joint_velocity")
        and (p := positions.get(m.place.joint)) is not None
    }
    for k, match in enumerate(matches):
        place = match.place
        is_speed = place.unit.endswith("/s")
        if place.kind == COMMAND and k in scaled and not is_speed:
            better = guess_moving_unit(match.column, place, scaled[k])
            position = positions[place.joint]
            if better is not None:
                pair = {k, position}
                is_alike = k in told or any(pair <= {*g} for g in groups)
                is_sure = found[k].unit == better.unit and found[k].sure > 0.5
                if not is_alike or is_sure:
                    found[k] = better
                if scaled[k].slope < 0:
                    found |= _settle_signs(matches, found, position, k)
    for k, match in enumerate(matches):
        if match.place.unit.endswith("/s"):
            guessed_unit = guess_moving_unit(match.column, match.place, scaled.get(k))
            assert guessed_unit is not None  # of a speed
            joint = positions.get(match.place.joint)
            sign = found[joint].sign if joint is not None else 1
            found[k] = replace(guessed_unit, sign=sign * guessed_unit.sign)
        elif k not in found:
            found[k] = _take_stated_unit(match)
    return [found[k] for k in range(len(matches))]


def _group_alike(matches: Sequence[Match], relations: Relations) -> list[list[int]]:
    """Numbers of positions and of servos' commands that may be taken in one unit.

    A command and its reading are, unless what follows is many times as large.
    """
    groups = list[list[int]]()
    for unit in ("rad", "m"):
        positions, commands = (
            [k for k, m in enumerate(matches) if (m.place.kind, m.place.unit) == of]
            for of in (("joint_position", unit), (COMMAND, unit))
        )
        columns = {matches[k].place.joint: matches[k].column for k in positions}
        slopes = [
            abs(line.slope)
            for k in commands
            if matches[k].place.joint in columns
            and abs((line := relations.find(
                matches[k].column, columns[matches[k].place.joint], matches[k].place
            )).correlation) > STRONG
        ]  # fmt: skip
        if slopes and abs(np.log(np.median(slopes))) > np.log(OTHER_UNIT):
            groups += [positions, commands]
        else:
            groups.append(positions + commands)
    return [members for members in groups if members]


def _settle_signs(
    matches: Sequence[Match],
    found: Mapping[int, UnitGuess],
    position: int,
    command: int,
) -> dict[int, UnitGuess]:
    """Units of a position and a command that move against each other.

    Args:
        found: units by number of the match.
    """
    pair = position, command
    first, second = ((matches[k], found[k]) for k in pair)
    flipped = find_flipped(first, second)
    if not flipped:
        why = "position and command move against each other: one needs sign = -1"
        return {k: replace(found[k], sure=0.5, why=why) for k in pair}
    why = "position and command move against each other, and this one leaves its limits"
    turned = position if flipped == "position" else command
    return {turned: replace(found[turned], sign=-1, sure=0.8, why=why)}


def _take_rule(
    match: Match, ranges: Mapping[int, tuple[float, float]]
) -> UnitGuess | None:
    """What a preset states of a column; None where it leaves the unit open.

    Args:
        ranges: of joints that have limits, by their number.
    """
    rule, limits = match.column.rule, find_limits(match.place, ranges)
    why = "the preset states it"
    if rule and rule.from_range and limits:
        return UnitGuess("", 1, (rule.from_range, limits), 0.95, why)
    if rule and rule.unit:
        unit = find_unit(rule.unit)
        if unit and match.place.unit in ("", unit.si):
            return UnitGuess(rule.unit, 1, None, 0.95, why)
    return None


def _take_stated_unit(match: Match) -> UnitGuess:
    """The unit that a log states, where it fits."""
    name = match.column.facts.unit
    unit = find_unit(name) if name else None
    if unit is not None and match.place.unit in ("", unit.si):
        return UnitGuess(name, sure=0.95, why="the log states its unit")
    return UnitGuess("", sure=0.6, why="no unit is stated")


def _scale(relation: Relation, unit: UnitGuess) -> Relation:
    """A relation of a position in its column's unit as one in SI units."""
    known = find_unit(unit.unit)
    factor = known.factor if known else 1.0
    if unit.ranges:
        (low, high), (bottom, top) = unit.ranges
        factor = (top - bottom) / (high - low)
    return Relation(relation.slope * factor, relation.correlation, relation.lag)


def relate(column: Column, position: Column, place: Place) -> Relation:
    """How speeds or commands go with positions.

    Args:
        column: of speeds, or of commands.
        place: to which the first one belongs.

    Returns:
        The line of the position in its column's unit over the command, or over the
        integral of the speed.
    """
    if not place.unit.endswith("/s"):
        return compare_command(
            (column.time, column.values), (position.time, position.values)
        )
    if column.stream == position.stream:
        return compare_speed(position.time, position.values, column.values)
    valid = np.isfinite(position.values)
    if valid.sum() < 2 or not column.time.size:
        return Relation(0.0, 0.0)
    at = np.interp(column.time, position.time[valid], position.values[valid])
    return compare_speed(column.time, at, column.values)
