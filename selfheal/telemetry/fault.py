"""What is wrong with a log: the kinds of faults, what each means, what corrects it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from ..errors import RecordingError, UnknownNameError
from .correction import Correction

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
        corrections: of the log's map or of the model.
        alternatives: columns that may be at fault instead, as far as these data tell.
    """

    kind: str
    episodes: tuple[str, ...]
    columns: tuple[str, ...]
    target: str
    seen: str
    p_value: float
    basis: str
    corrections: tuple[Correction, ...]
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
        f"{file}: log and model contradict each other, and no physics can be told from "
        f"it: {'. '.join(said)}. Would fit: a corrected log, or {kinds}"
    )


def format_columns(names: Sequence[str]) -> str:
    """Names as a sentence has them, short enough for a message."""
    return " and ".join(repr(n if len(n) <= 60 else n[:57] + "...") for n in names)
