"""What corrects a fault: keys of a log's map, or MJCF of the model."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

SKIP = "skip"  # the key of a column that is to be left out


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
        unit: of its numbers; "" where they are plain.
    """

    xml: str
    unit: str = ""

    def __str__(self) -> str:
        """The element, with the unit behind it."""
        return f"{self.xml} [{self.unit}]" if self.unit else self.xml


Correction = ColumnCorrection | ModelCorrection | str  # a str says what to do


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
