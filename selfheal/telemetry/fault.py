"""What is wrong with a log: a fault of one of the `KINDS`, and what corrects it."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import RecordingError, UnknownNameError
from .registry import KINDS

# of a fault that refuses a diagnosis, the largest p-value; chosen: one log in a
# thousand is refused for nothing at most
DECISIVE_P_VALUE = 1e-3
# of a message that lists faults; chosen: a screen
MAX_LISTED = 8

SKIP = "skip"  # key of a correction: the column is to be left out
COUNTED = "counted, not estimated"


@dataclass(frozen=True)
class ColumnCorrection:
    """How a log's map is to read a column (`selfheal.logs.log_map.ColumnRule`).

    Attributes:
        name: of the signal, or of the actuator whose command it is.
        changes: keys of the column's rule and their values; `SKIP` leaves it out.
            Factors multiply what the rule has.
        is_command: whether it is an actuator's.
    """

    name: str
    changes: Mapping[str, Any]
    is_command: bool = False

    def __str__(self) -> str:
        """The line for a map."""
        rule = '[[signals]] kind = "command",' if self.is_command else "[[signals]]"
        if SKIP in self.changes:
            said = "leave the column out"
        else:
            said = ", ".join(f"{k} = {_format(v)}" for k, v in self.changes.items())
        return f"{rule} of {json.dumps(self.name)}: {said}"


@dataclass(frozen=True)
class ModelCorrection:
    """An element of the MJCF as it should be: attributes that it lacks stay.

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
    """One fault of a log, or of a range that the model states.

    Attributes:
        kind: a name of `KINDS`.
        episodes: ids in which it was seen.
        columns: names of the signals, or of the actuators whose command it is.
        target: joint, actuator, body or sensor of the first column; may be empty.
        seen: one sentence with numbers and units.
        p_value: probability to see this in a log without the fault [1]; `basis` says
            by which test.
        basis: of the p-value.
        corrections: of the log's map or of the model.
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


def list_decisive(faults: Sequence[Fault], skip: Collection[str] = ()) -> list[Fault]:
    """The faults for which a diagnosis is refused; `skip` are kinds to let pass.

    Raises:
        UnknownNameError: a kind that there is not.
    """
    for name in skip:
        if name not in KINDS:
            raise UnknownNameError("kind of fault", name, KINDS)
    return [f for f in faults if f.is_decisive and f.kind not in skip]


def list_tolerable(faults: Sequence[Fault], skip: Collection[str] = ()) -> list[Fault]:
    """The faults that a diagnosis mentions, and goes on."""
    return [f for f in faults if not f.is_decisive and f.kind not in skip]


def refuse_faulty(
    file: str, faults: Sequence[Fault], skip: Collection[str] = ()
) -> None:
    """Refuse a recording whose faults make any physics meaningless.

    Args:
        skip: kinds that are not asked about.

    Raises:
        RecordingError: lists the faults and what corrects them.
    """
    found = list_decisive(faults, skip)
    if not found:
        return
    said = [f.describe() for f in found[:MAX_LISTED]]
    if len(found) > MAX_LISTED:
        said.append(f"{len(found) - MAX_LISTED} more")
    kinds = " ".join(f"--no-check {k}" for k in dict.fromkeys(f.kind for f in found))
    raise RecordingError(
        f"{file}: log and model contradict each other, and no physics can be "
        f"identified from it: {'. '.join(said)}. Would fit: a corrected log, or {kinds}"
    )


def format_columns(names: Sequence[str]) -> str:
    """Names as a sentence has them, short enough for a message."""
    return " and ".join(repr(n if len(n) <= 60 else n[:57] + "...") for n in names)


def correct_factor(
    name: str, factor: float, *, is_command: bool = False
) -> ColumnCorrection:
    """A column that is to be multiplied.

    Args:
        name: of the signal or the actuator.
        factor: of its values [1].
        is_command: whether it is an actuator's.
    """
    changes = {"sign": -1} if factor == -1 else {"scale": factor}
    return ColumnCorrection(name, changes, is_command)


def _format(value: Any) -> str:
    """A value as TOML."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_format, value))}]"
    return f"{value:.6g}" if isinstance(value, float) else json.dumps(value)
