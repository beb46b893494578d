"""What else a log could mean: takes joints, tries hypotheses, gives the one that holds.

A hypothesis is tried in what explains the motion: the balance of torques, or
simulations where there is none.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from .fault import Changes, ColumnCorrection, format_columns, multiply
from .joints import JointColumns
from .relations import SHARES, UNITS, list_units, name_unit
from .residuals import Explainer
from .states import ColumnMap

MAX_P_VALUE = 1e-3  # of a hypothesis, times the number of those that were tried
SCREENED = 4  # rows of which one is evaluated first; chosen: a quarter of the time
CLEARLY = 0.5  # nats by which hypotheses are distinguished; chosen
MIN_GAIN = 1.5  # nats by which one must explain more; chosen: concealed physics
# gains nothing by a wrong sign


@dataclass(frozen=True)
class Hypothesis:
    """One thing that could be wrong with the columns about a joint or two.

    Attributes:
        column_map: how the columns would be read instead.
        columns: signals, and actuators whose command changes.
        text: what is wrong, as the end of a sentence.
    """

    kind: str
    column_map: ColumnMap
    columns: tuple[str, ...]
    target: str
    corrections: tuple[ColumnCorrection, ...]
    text: str


class Finding(NamedTuple):
    """A hypothesis that explains the motion far better.

    The shares [1] are the largest unexplained without it and the mean with it, the gain
    is in nats, the p-value times the number of hypotheses that were tried.
    """

    best: Hypothesis
    given: float
    left: float
    gain: float
    p_value: float


def find_best(
    explainer: Explainer, column_map: ColumnMap, options: Sequence[Hypothesis]
) -> tuple[Finding, tuple[Hypothesis, ...]] | None:
    """The hypothesis that explains the motion far better, and those as good."""
    min_left, max_left = explainer.limits
    base = explainer.evaluate(column_map)
    if base.worst < min_left:
        return None
    coarse, good = explainer.evaluate(column_map, SCREENED), []
    for option in options:
        both = column_map | option.column_map
        if explainer.evaluate(both, SCREENED).gain_over(coarse)[0] < MIN_GAIN / 2:
            continue
        after = explainer.evaluate(both)
        gain, p = after.gain_over(base)
        p = min(1.0, p * len(options))
        given = float(base.select_changed(after).max(initial=0.0))
        # as the gain is in nats
        left = float(np.exp(np.log(after.select_changed(base)).mean()))
        if gain >= MIN_GAIN and p < MAX_P_VALUE:
            good.append(Finding(option, given, left, gain, p))
    if not good:
        return None
    first, *rest = sorted(good, key=lambda g: -g.gain)
    if not (first.given > min_left and first.left < max_left):
        return None  # and what explains less is wrong, too
    return first, tuple(g.best for g in rest if first.gain - g.gain < CLEARLY)


def list_hypotheses(
    joints: Mapping[str, JointColumns], names: Sequence[str]
) -> Iterator[Hypothesis]:
    """All signs, units and exchanges of the columns of named joints."""
    degrees = UNITS["degrees"]
    for name in names:
        joint = joints[name]
        read = list_read(joint)
        yield suppose(joints, "sign", (name,), read)
        yield suppose(joints, "unit", (name,), read, degrees)
        if joint.commands:
            parts = (*read, "command") if joint.servo else ("command",)
            yield suppose(joints, "sign", (name,), parts)
            if joint.servo:
                yield suppose(joints, "unit", (name,), parts, degrees)
    for pair in combinations(names, 2):
        yield suppose(joints, "exchange", pair, list_read(joints[pair[0]]))
        if all(joints[name].commands for name in pair):
            yield suppose(joints, "exchange", pair, ("command",))


def list_read(joint: JointColumns) -> tuple[str, ...]:
    """Which of "position" and "velocity" are read of a joint."""
    return ("position", "velocity") if joint.velocity else ("position",)


def suppose(
    joints: Mapping[str, JointColumns],
    kind: str,
    pair: tuple[str, ...],
    parts: tuple[str, ...],
    ratio: float = 1.0,
) -> Hypothesis:
    """A hypothesis: a kind of fault in some of the columns about a joint.

    Args:
        kind: "sign", "unit" or "exchange".
        pair: names of the joint, and of the other one of an exchange.
        parts: of "position", "velocity", "command": what is read otherwise.
        ratio: what was written over what is right, for a unit.
    """
    first = joints[pair[0]]
    factor, unit = 1.0, ""
    if kind == "sign":
        factor = -1.0
    elif kind == "unit":
        unit = name_unit(ratio, first.span)
        factor = 1 / (list_units(first.span)[unit] if unit else abs(ratio))
    change = spread(first, unit) if unit in SHARES else multiply(factor)
    positions, commands = dict[str, tuple[str, float]](), dict[str, tuple[str, float]]()
    signals, sent = list[ColumnCorrection](), list[ColumnCorrection]()
    for to, source in zip(pair, pair[::-1], strict=True):
        one, other = joints[to], joints[source]
        of = Changes(targets=[to]) if kind == "exchange" else change
        if "position" in parts:
            positions[to] = (source, factor)
            signals.append(ColumnCorrection(other.position, of))
        if "velocity" in parts and other.velocity:
            signals.append(ColumnCorrection(other.velocity, of))
        if "command" in parts:
            for a, b in zip(one.commands, other.commands, strict=False):
                commands[a] = (b, factor)
                of = Changes(targets=[a]) if kind == "exchange" else change
                sent.append(ColumnCorrection(b, of, is_command=True))
    corrections = (*signals, *sent)
    columns = tuple(c.name for c in corrections)
    listed = format_columns(columns)
    text = {
        "sign": f"{listed}: the sign is the other one",
        "unit": f"{listed}: the unit is {unit or 'another one'}",
        "exchange": f"{listed} are exchanged",
    }[kind]
    column_map = ColumnMap(positions, commands)
    return Hypothesis(kind, column_map, columns, pair[0], corrections, text)


def spread(joint: JointColumns, unit: str) -> Changes:
    """The change of a column that is a share of its joint's range: one of `SHARES`."""
    return Changes(from_range=(0.0, SHARES[unit]), to_range=joint.range or (0.0, 1.0))
