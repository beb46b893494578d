"""Units and signs of matched columns together: matches in; conversions out."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..log_map import COMMAND
from ..model_facts import Place
from ..motion import Relation, compare_command, compare_speed
from ..units import find_unit
from .assignment import Column, Match
from .unit_guesses import (
    OTHER_UNIT,
    STRONG,
    Ends,
    UnitGuess,
    find_flipped,
    find_limits,
    get_factor,
    guess_command_unit,
    guess_position_units,
    guess_speed_unit,
    is_speed,
)

_POSITION = "joint_position"


class Relations:
    """How columns go with positions; each pair is compared once.

    Columns live as long as this.
    """

    def __init__(self) -> None:
        self._known = dict[tuple[int, int, bool], Relation]()

    def find(self, column: Column, position: Column, place: Place) -> Relation:
        """How a column of speeds or commands goes with one of positions.

        Args:
            place: to which the first one belongs.

        Returns:
            The line of the position in its column's unit over the command, or over the
            integral of the speed.
        """
        key = id(column), id(position), is_speed(place)
        if key not in self._known:
            relate = _relate_speed if key[2] else _relate_command
            self._known[key] = relate(column, position)
        return self._known[key]


def _relate_command(column: Column, position: Column) -> Relation:
    command, read = ((c.time, c.values) for c in (column, position))
    return compare_command(command, read)


def _relate_speed(column: Column, position: Column) -> Relation:
    if column.stream == position.stream:
        return compare_speed(position.time, position.values, column.values)
    valid = np.isfinite(position.values)
    if valid.sum() < 2 or not column.time.size:
        return Relation(0.0, 0.0)
    at = np.interp(column.time, position.time[valid], position.values[valid])
    return compare_speed(column.time, at, column.values)


def guess_conversions(
    matches: Sequence[Match], relations: Relations
) -> list[UnitGuess]:
    """The unit of each match; those of positions first: the others depend on them."""
    found = dict[int, UnitGuess]()
    read = {k: m.place for k, m in enumerate(matches) if m.place.kind == _POSITION}
    positions = {place.joint: k for k, place in read.items()}
    ends = {place.joint: (place.low, place.high) for place in read.values()}
    ranges = {j: pair for j, pair in ends.items() if np.isfinite(pair[1] - pair[0])}
    groups = _group_alike(matches, positions, relations)
    for members in groups:
        guessed = guess_position_units([matches[k] for k in members], ranges)
        found |= dict(zip(members, guessed, strict=True))
    by_rule = {k: _take_rule(match, ranges) for k, match in enumerate(matches)}
    found |= {k: unit for k, unit in by_rule.items() if unit}
    scaled = {
        k: _scale(relations.find(m.column, matches[p].column, m.place), found[p])
        for k, m in enumerate(matches)
        if m.place.kind in (COMMAND, "joint_velocity")
        and (p := positions.get(m.place.joint)) is not None
    }
    for k, relation in scaled.items():
        match, p = matches[k], positions[matches[k].place.joint]
        if match.place.kind != COMMAND or is_speed(match.place):
            continue
        better = guess_command_unit(match.column, match.place, relation)
        if better is not None:
            is_alike = by_rule[k] or any({k, p} <= {*members} for members in groups)
            is_sure = found[k].unit == better.unit and found[k].sure > 0.5
            if not is_alike or is_sure:
                found[k] = better
            if relation.slope < 0:
                found |= _settle_signs(matches, found, p, k)
    signs = {joint: found[k].sign for joint, k in positions.items()}
    for k, match in enumerate(matches):
        if is_speed(match.place):
            speed = guess_speed_unit(match.column, match.place, scaled.get(k))
            sign = signs.get(match.place.joint, 1) * speed.sign
            found[k] = replace(speed, sign=sign)
        elif k not in found:
            found[k] = _take_stated_unit(match)
    return [found[k] for k in range(len(matches))]


def _group_alike(
    matches: Sequence[Match], joints: Mapping[int, int], relations: Relations
) -> list[list[int]]:
    """Numbers of positions and of servos' commands that may be taken in one unit.

    A command and its reading are, unless what follows is many times as large.

    Args:
        joints: numbers of positions by their joints.
    """
    groups = list[list[int]]()
    for unit in ("rad", "m"):
        positions, commands = (
            [k for k, m in enumerate(matches) if (m.place.kind, m.place.unit) == of]
            for of in (("joint_position", unit), (COMMAND, unit))
        )
        lines = [
            relations.find(m.column, matches[joints[m.place.joint]].column, m.place)
            for m in (matches[k] for k in commands)
            if joints.get(m.place.joint) in positions
        ]
        slopes = [abs(line.slope) for line in lines if abs(line.correlation) > STRONG]
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
    """Units of a position and a command that move against each other."""
    pair = position, command
    first, second = ((matches[k], found[k]) for k in pair)
    flipped = find_flipped(first, second)
    if not flipped:
        why = "position and command move against each other: one needs sign = -1"
        return {k: replace(found[k], sure=0.5, why=why) for k in pair}
    why = "position and command move against each other, and this one leaves its limits"
    turned = position if flipped == "position" else command
    return {turned: replace(found[turned], sign=-1, sure=0.8, why=why)}


def _take_rule(match: Match, ranges: Mapping[int, Ends]) -> UnitGuess | None:
    """What a preset states of a column; None where it leaves the unit open."""
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
    factor = get_factor(unit.unit)
    if unit.ranges:
        (low, high), (bottom, top) = unit.ranges
        factor = (top - bottom) / (high - low)
    return replace(relation, slope=relation.slope * factor)
