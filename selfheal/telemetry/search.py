"""What else a log could mean: takes joints, tries mends, gives the one that explains.

A mend is tried in what explains the motion: the balance of torques, or simulations
where there is none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..recording.data import Floats
from .fault import ColumnCorrection, correct_factor, format_columns
from .joints import JointColumns
from .pairs import SHARES, list_units, name_unit
from .states import Mend

MAX_P_VALUE = 1e-3  # of a mend, times the number of mends that were tried
SCREENED = 4  # rows of which one is evaluated first; chosen: a quarter of the time
CLEARLY = 0.5  # nats by which one mend is told from another; chosen
MIN_GAIN = 1.5  # nats by which a mend must explain more; chosen: concealed physics
# gains nothing by a wrong sign
DEGREE = float(np.pi / 180)


@dataclass(frozen=True)
class Candidate:
    """One thing that could be wrong with the columns about a joint or two.

    Attributes:
        kind: of the fault.
        mend: what it would be read as instead.
        signals: whose reading changes.
        commands: actuators whose command changes.
        target: joint or actuator.
        corrections: of the map.
        text: what is wrong, as the end of a sentence.
    """

    kind: str
    mend: Mend
    signals: tuple[str, ...]
    commands: tuple[str, ...]
    target: str
    corrections: tuple[ColumnCorrection, ...]
    text: str


class Explained(Protocol):
    """How well a mended log explains the motion."""

    @property
    def worst(self) -> float:
        """The largest share unexplained."""

    def select_changed(self, other: Any) -> Floats:
        """Shares unexplained (n) of what `other` explains differently [1]."""

    def gain_over(self, other: Any) -> tuple[float, float]:
        """Nats by which this explains more, and how likely by chance."""


class Explainer(Protocol):
    """What tells how well a mended log explains the motion."""

    def evaluate(self, mend: Mend, every: int = 1) -> Any:
        """How well, in each so many rows: an `Explained`."""


@dataclass(frozen=True)
class Found:
    """A mend that explains the motion far better.

    Attributes:
        best: the candidate.
        others: as good ones.
        after: what it leaves.
        given, left: largest share unexplained before, and mean share after [1].
        gain: [nats].
        p_value: of the gain, times the number of mends that were tried.
    """

    best: Candidate
    others: tuple[Candidate, ...]
    after: Explained
    given: float
    left: float
    gain: float
    p_value: float


def find_best(
    explainer: Explainer, mend: Mend, options: Sequence[Candidate],
    min_left: float, max_left: float,
) -> Found | None:  # fmt: skip
    """The candidate that explains the motion far better, and those as good.

    Args:
        explainer: of the motion.
        mend: that is made already.
        options: the candidates.
        min_left: share that the log as it is must leave.
        max_left: share that a mend may leave.
    """
    base = explainer.evaluate(mend)
    if base.worst < min_left:
        return None
    coarse, good = explainer.evaluate(mend, SCREENED), []
    for option in options:
        both = mend.then(option.mend)
        if explainer.evaluate(both, SCREENED).gain_over(coarse)[0] < MIN_GAIN / 2:
            continue
        after = explainer.evaluate(both)
        gain, p = after.gain_over(base)
        p = min(1.0, p * len(options))
        given = float(base.select_changed(after).max(initial=0.0))
        # as the gain is in nats
        left = float(np.exp(np.log(after.select_changed(base)).mean()))
        if gain >= MIN_GAIN and p < MAX_P_VALUE:
            good.append(Found(option, (), after, given, left, gain, p))
    if not good:
        return None
    first, *rest = sorted(good, key=lambda g: -g.gain)
    if not (first.given > min_left and first.left < max_left):
        return None  # and what explains less is wrong, too
    others = tuple(g.best for g in rest if first.gain - g.gain < CLEARLY)
    return Found(
        first.best, others, first.after, first.given, first.left, first.gain,
        first.p_value,
    )  # fmt: skip


def list_candidates(
    joints: Mapping[str, JointColumns], names: Sequence[str]
) -> list[Candidate]:
    """All signs, units and exchanges of some joints' columns.

    Args:
        joints: by name.
        names: of those that are asked about.
    """
    found = []
    for name in names:
        joint = joints[name]
        read = _list_read(joint)
        found.append(make_candidate(joints, "sign", name, "", read, 1.0))
        found.append(make_candidate(joints, "unit", name, "", read, 1 / DEGREE))
        if joint.commands:
            both = (*read, "command")
            servo = joint.servo is not None
            parts = both if servo else ("command",)
            found.append(make_candidate(joints, "sign", name, "", parts, 1))
            if servo:
                found.append(make_candidate(joints, "unit", name, "", both, 1 / DEGREE))
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            read = _list_read(joints[one])
            found.append(make_candidate(joints, "exchange", one, other, read, 1.0))
            if joints[one].commands and joints[other].commands:
                found.append(
                    make_candidate(joints, "exchange", one, other, ("command",), 1.0)
                )
    return found


def make_candidate(
    joints: Mapping[str, JointColumns], kind: str, joint: str, partner: str,
    parts: tuple[str, ...], ratio: float,
) -> Candidate:  # fmt: skip
    """A candidate: a kind of fault in some of the columns about a joint.

    Args:
        joints: by name.
        kind: "sign", "unit" or "exchange".
        joint: name.
        partner: the other joint of an exchange; else "".
        parts: of "position", "velocity", "command": what is read otherwise.
        ratio: what was written over what is right, for a unit.
    """
    pairs = [(joint, partner or joint)] + [(partner, joint)] * bool(partner)
    factor = {"sign": -1.0, "unit": 1 / abs(ratio)}.get(kind, 1.0)
    span = joints[joint].span
    unit = name_unit(ratio, span) if kind == "unit" else ""
    if unit:
        factor = 1 / list_units(span)[unit]
    positions, commands, signals, acting, corrections = {}, {}, [], [], []
    for to, source in pairs:
        one, other = joints[to], joints[source]
        if "position" in parts:
            positions[to] = (source, factor)
        for part in ("position", "velocity"):
            name = getattr(other, part)
            if part in parts and name:
                signals.append(name)
                corrections.append(_correct(kind, name, factor, one, unit))
        if "command" in parts:
            for a, b in zip(one.commands, other.commands, strict=False):
                commands[a] = (b, factor)
                acting.append(b)
                corrections.append(_correct(kind, b, factor, one, unit, a))
    mend = Mend(positions, commands)
    columns = format_columns([*signals, *acting])
    text = {
        "sign": f"{columns}: the sign is the other one",
        "unit": f"{columns}: the unit is {unit or 'another one'}",
        "exchange": f"{columns} are exchanged",
    }[kind]
    return Candidate(
        kind, mend, tuple(signals), tuple(acting), joint, tuple(corrections), text
    )


def _list_read(joint: JointColumns) -> tuple[str, ...]:
    return ("position", "velocity") if joint.velocity else ("position",)


def correct_share(
    name: str, joint: JointColumns, unit: str, *, is_command: bool = False
) -> ColumnCorrection:
    """How a column is read that is a share of its joint's range.

    Args:
        name: of the signal or the actuator.
        joint: that has a range.
        unit: a name of `SHARES`.
        is_command: whether it is an actuator's.
    """
    low, high = joint.range or (0.0, 1.0)
    ends = {"from_range": [0.0, SHARES[unit]], "to_range": [low, high]}
    return ColumnCorrection(name, ends, is_command)


def _correct(
    kind: str, name: str, factor: float, joint: JointColumns, unit: str,
    actuator: str = "",
) -> ColumnCorrection:  # fmt: skip
    """How a column is read otherwise.

    Args:
        kind: of the fault.
        name: of the signal or the actuator.
        factor: of the column.
        joint: which it then is of.
        unit: that it is in; "" where that is unknown.
        actuator: which it then commands; "" of a signal.
    """
    is_command = bool(actuator)
    if kind == "exchange":
        targets = {"targets": [actuator or joint.name]}
        return ColumnCorrection(name, targets, is_command)
    if unit in SHARES:
        return correct_share(name, joint, unit, is_command=is_command)
    return correct_factor(name, factor, is_command=is_command)
