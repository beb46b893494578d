"""Kinds of columns whose names say nothing: their motions in; kinds out.

A speed is the derivative of its position, and a position follows its command.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..log_map import COMMAND, ColumnRule
from ..model_facts import Place
from ..motion import compare_command, compare_speed
from .assignment import Column

# correlations from which a column is the derivative of another, and follows it; chosen:
# joints that are moved together have less. Where speeds show which columns are
# positions, what such a one follows needs the first alone
_DERIVES, _FOLLOWS = 0.9, 0.95
_WEAKEST = 1 / 3  # times a command, by which a position follows it at least; chosen
_MOST = 100  # columns that are compared with one another; chosen: ten thousand pairs


def find_kinds(columns: Sequence[Column], places: Sequence[Place]) -> list[Column]:
    """Give columns without known names the kind that follows from their motion.

    Args:
        columns: of one log, whose names say nothing.

    Returns:
        The same; each that was recognized with a rule that states its kind.
    """
    moving = [c for c in columns if np.nanstd(c.values) > 0][:_MOST]
    speeds = _pair_speeds(moving)
    positions = set(speeds.values())
    leads = _pair_commands(moving, positions)
    positions |= set(leads.values())
    count = sum(place.kind == "joint_position" for place in places)
    if not positions and len(moving) == count:
        positions = set(range(count))
    kinds = {
        **dict.fromkeys(speeds, "joint_velocity"),
        **dict.fromkeys(leads, COMMAND),
        **dict.fromkeys(positions, "joint_position"),
    }
    rules = {kind: ColumnRule(kind, []) for kind in kinds.values()}
    found = {id(moving[k]): rules[kind] for k, kind in kinds.items()}
    return [replace(c, rule=found.get(id(c))) for c in columns]


def _pair_speeds(columns: Sequence[Column]) -> dict[int, int]:
    """The number of the position by that of its speed, the closest pairs first."""
    fits = {
        (i, j): abs(compare_speed(c.time, c.values, speed.values).correlation)
        for j, speed in enumerate(columns)
        for i, c in enumerate(columns)
        if i != j and c.stream == speed.stream
    }
    found = dict[int, int]()
    for i, j in sorted(fits, key=lambda pair: -fits[pair]):
        # what swings evenly is like the derivative of its derivative, too
        is_free = i not in found and not {i, j} & {*found.values()} and j not in found
        if fits[i, j] > _DERIVES and is_free:
            found[j] = i
    return found


def _pair_commands(columns: Sequence[Column], known: set[int]) -> dict[int, int]:
    """The number of the position by that of its command.

    Args:
        known: numbers of those that are positions; empty where none is known.
    """
    found = dict[int, tuple[float, int]]()
    least = _DERIVES if known else _FOLLOWS
    for j in known or range(len(columns)):
        position = columns[j]
        for i, command in enumerate(columns):
            if i in known or i == j:
                continue
            line = compare_command(
                (command.time, command.values), (position.time, position.values)
            )
            follows = _WEAKEST < line.slope < 1 / _WEAKEST and line.lag > 0
            if follows and line.correlation > max(least, found.get(i, (0,))[0]):
                found[i] = line.correlation, j
    return {i: j for i, (_, j) in found.items() if j not in found}
