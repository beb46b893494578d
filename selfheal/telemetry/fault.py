"""What is wrong with a log: the kinds of faults, what each means, how it is mended."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from ..errors import RecordingError, UnknownNameError

# of a fault that refuses a diagnosis, the largest p-value; chosen: one log in a
# thousand is refused for nothing at most
DECISIVE_P_VALUE = 1e-3
# of a message that lists faults; chosen: a screen
MAX_LISTED = 8

# by kind: whether it makes physics meaningless
KINDS: Mapping[str, bool] = {
    "sign": True,
    "unit": True,
    "exchange": True,
    "frozen": True,
    "zeros": True,
    "derivative": True,
    "quaternion_order": True,
    "sensor_frame": True,
    "actuator_type": True,
    "no_actuator": True,
    "free_base": True,
    "permanent_contact": False,
    "saturated": False,
    "delay": False,
    "jitter": False,
    "gap": False,
    "duplicate": False,
    "joint_range": False,
    "command_range": False,
    "torque_is_command": False,
    "stale": False,
    "clock_drift": False,
    "odd_episode": False,
}


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
        mend: lines for the log's map, or the attribute of the MJCF that is wrong.
        alternatives: columns that may be at fault instead, as far as these data tell.
    """

    kind: str
    episodes: tuple[str, ...]
    columns: tuple[str, ...]
    target: str
    seen: str
    p_value: float
    basis: str
    mend: str
    alternatives: tuple[str, ...] = ()

    @property
    def is_decisive(self) -> bool:
        """Whether it is sure and makes any physics meaningless."""
        return KINDS[self.kind] and self.p_value <= DECISIVE_P_VALUE

    def describe(self) -> str:
        """What was seen, and what mends it, in one line."""
        return f"{self.kind}: {self.seen}; mend: {', '.join(self.mend.splitlines())}"


def list_decisive(faults: Sequence[Fault], skip: Collection[str] = ()) -> list[Fault]:
    """The faults for which a diagnosis is refused.

    Args:
        faults: of a recording.
        skip: kinds that are not asked about.

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
        file: name of the recording.
        faults: of it.
        skip: kinds that are not asked about.

    Raises:
        RecordingError: lists the faults and the lines that mend them.
    """
    found = list_decisive(faults, skip)
    if not found:
        return
    said = [f.describe() for f in found[:MAX_LISTED]]
    if len(found) > MAX_LISTED:
        said.append(f"{len(found) - MAX_LISTED} more")
    kinds = " ".join(f"--no-check {k}" for k in dict.fromkeys(f.kind for f in found))
    raise RecordingError(
        f"{file}: log and model contradict each other, and no physics can be told from "
        f"it: {'. '.join(said)}. Would fit: a mended log, or {kinds}"
    )


def write_mend(table: str, name: str, key: str, value: float | str | bool) -> str:
    """What in a log's map changes how a column is read (`selfheal.logs.log_map`).

    Args:
        table: "signals" or "ctrl".
        name: of the signal or the actuator.
        key: what is changed: "sign", "scale", "delay", "order", "columns", "targets",
            "skip", "repeats", or "missing".
        value: to what; a list is a text.
    """
    rule = "[[signals]]" if table == "signals" else '[[signals]] kind = "command",'
    place = f"{rule} of {json.dumps(name)}"
    if key == "skip":
        return f"{place}: leave the column out"
    if key == "repeats":
        return f"{place}: leave repeated cells empty in the log, or the column out"
    is_list = isinstance(value, str) and value.startswith("[")
    text = f"{value:.6g}" if isinstance(value, float) else json.dumps(value)
    if key == "scale" and value == -1:
        key, text = "sign", "-1"
    return f"{place}: {key} = {value if is_list else text}"


def format_columns(names: Sequence[str]) -> str:
    """Names as a sentence has them, short enough for a message."""
    return " and ".join(repr(n if len(n) <= 60 else n[:57] + "...") for n in names)
