"""What is wrong with a log: a fault of one of the `KINDS`, and what corrects it."""

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TypedDict

from ..errors import RecordingError, UnknownNameError
from .registry import KINDS

# of a fault that refuses a diagnosis, the largest p-value; chosen: one log in a
# thousand is refused for nothing at most
DECISIVE_P_VALUE = 1e-3
# of a message that lists faults; chosen: a screen
MAX_LISTED = 8

COUNTED = "counted, not estimated"


class Changes(TypedDict, total=False):
    """Keys of a column's rule in a map (`selfheal.logs.log_map.ColumnRule`).

    Factors multiply what the rule has, a delay is added; `columns` are places of the
    rule's columns, `skip` leaves the column out.
    """

    sign: int | list[int]
    scale: float
    delay: float
    missing: float
    order: str
    targets: list[str]
    columns: list[int]
    from_range: tuple[float, float]
    to_range: tuple[float, float]
    skip: bool


@dataclass(frozen=True)
class ColumnCorrection:
    """How a log's map is to read a signal, or the command of an actuator, by name."""

    name: str
    changes: Changes
    is_command: bool = False

    def __str__(self) -> str:
        """The line for a map."""
        rule = '[[signals]] kind = "command",' if self.is_command else "[[signals]]"
        if "skip" in self.changes:
            said = "leave the column out"
        else:
            said = ", ".join(f"{k} = {_format(v)}" for k, v in self.changes.items())
        return f"{rule} of {json.dumps(self.name)}: {said}"


@dataclass(frozen=True)
class ModelCorrection:
    """An element of the MJCF as it should be: attributes that are not in it stay.

    Attributes:
        xml: of the element; one without a name is to be added.
        unit: of its numbers; "" where they have none.
    """

    xml: str
    unit: str = ""

    def __str__(self) -> str:
        """The element, with the unit behind it."""
        return f"{self.xml} [{self.unit}]" if self.unit else self.xml


Correction = ColumnCorrection | ModelCorrection | str  # a str says what to do


@dataclass(frozen=True)
class Fault:
    """One fault of a log, or of a nominal range of the model.

    Attributes:
        kind: a name of `KINDS`.
        episodes: ids in which it was seen.
        columns: names of the signals, or of the actuators whose command it is.
        target: joint, actuator, body or sensor of the first column; may be empty.
        seen: one sentence with numbers and units.
        p_value: probability to see this in a log without the fault [1]; `basis` says
            by which test.
        alternatives: columns that may be at fault instead, as far as these data say.
    """

    kind: str
    episodes: tuple[str, ...]
    columns: tuple[str, ...]
    target: str
    seen: str
    p_value: float = 0.0
    basis: str = COUNTED
    corrections: tuple[Correction, ...] = ()
    alternatives: tuple[str, ...] = ()

    @property
    def is_decisive(self) -> bool:
        """Whether it is sure and makes any physics meaningless."""
        return KINDS[self.kind] and self.p_value <= DECISIVE_P_VALUE

    def describe(self) -> str:
        """What was seen, and what corrects it, in one line."""
        corrections = ", ".join(map(str, self.corrections))
        return f"{self.kind}: {self.seen}; correction: {corrections}"


def refuse_faulty(
    file: str, faults: Sequence[Fault], skip: Collection[str] = ()
) -> list[Fault]:
    """Refuse a recording whose faults make any physics meaningless; the others.

    Args:
        skip: kinds that are let pass.

    Raises:
        RecordingError: lists the faults and what corrects them.
        UnknownNameError: a kind that there is not.
    """
    for name in skip:
        if name not in KINDS:
            raise UnknownNameError("kind of fault", name, KINDS)
    judged = [f for f in faults if f.kind not in skip]
    decisive = [f for f in judged if f.is_decisive]
    if not decisive:
        return judged
    said = [f.describe() for f in decisive[:MAX_LISTED]]
    if len(decisive) > MAX_LISTED:
        said.append(f"{len(decisive) - MAX_LISTED} more")
    kinds = " ".join(f"--no-check {k}" for k in dict.fromkeys(f.kind for f in decisive))
    raise RecordingError(
        f"{file}: log and model contradict each other, and no physics can be "
        f"identified from it: {'. '.join(said)}. Would fit: a corrected log, or {kinds}"
    )


def format_columns(names: Sequence[str]) -> str:
    """Names as a sentence has them, short enough for a message."""
    return " and ".join(repr(n if len(n) <= 60 else n[:57] + "...") for n in names)


def multiply(factor: float) -> Changes:
    """The change of a column that is to be multiplied by a factor [1]."""
    return {"sign": -1} if factor == -1 else {"scale": factor}


def _format(value: object) -> str:
    """A value as TOML."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_format, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value)
