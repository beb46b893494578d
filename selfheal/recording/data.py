"""The nouns of contract section 1: arrays in, frozen records of one robot out."""

from collections.abc import Container, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError
from ..printable import quote_name

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Signal:
    """Readings of one sensor.

    Attributes:
        values: (T) or (T, d) [unit]; NaN where a sample is missing.
        kind: a name of `KINDS`.
        target: joint, actuator, body or sensor of the model, as the kind says; may be
            empty for supply voltage and temperature.
        unit: one that fits the kind.
    """

    values: Floats
    kind: str
    target: str
    unit: str

    def __repr__(self) -> str:
        of = f" of {self.target}" if self.target else ""
        return f"<Signal: {self.kind}{of} [{self.unit}], shape {self.values.shape}>"


@dataclass(frozen=True, eq=False)
class Episode:
    """One uninterrupted run.

    Attributes:
        time: (T) [s] strictly increasing, perhaps irregular.
        ctrl: (T, nu) commands, one column a control, each held from its sample to the
            next.
        ctrl_names: actuator of each column of `ctrl`. One with several controls, as
            MuJoCo's <pid>, has its name on each, in MuJoCo's order; or each is named
            after what it commands, too (`controls.Control.full_name`, "servo_vel").
        qpos0: (nq) or None, position at time[0].
        qvel0: (nv) or None, velocity at time[0].
    """

    time: Floats
    ctrl: Floats
    ctrl_names: tuple[str, ...]
    signals: Mapping[str, Signal]
    qpos0: Floats | None = None
    qvel0: Floats | None = None
    motion: str | None = None

    def __repr__(self) -> str:
        seconds = np.ptp(self.time) if self.time.size else 0.0
        return (
            f"<Episode, {seconds:.1f} s; samples: {self.time.size}, "
            f"commands: {len(self.ctrl_names)}, signals: {len(self.signals)}>"
        )


class EpisodeTable(Protocol):
    """What is checked and written: a `Recording`, or a part of one."""

    @property
    def episodes(self) -> Mapping[str, Episode]:
        """Episodes by id."""

    @property
    def robot(self) -> str | None:
        """Label or None."""

    @property
    def source(self) -> str | None:
        """Where the data come from, or None."""

    @property
    def file(self) -> str:
        """Name for messages."""


@dataclass(frozen=True)
class Kind:
    """What the contract says of one kind of signal.

    Attributes:
        target: the sort of thing it belongs to.
        units: those that fit; empty where the model's sensor decides.
        width: columns; 0 for a scalar (T) signal, None where the sensor decides.
        may_lack_target: True where an empty target has a meaning.
    """

    target: str
    units: tuple[str, ...]
    width: int | None = 0
    may_lack_target: bool = False


KINDS: Mapping[str, Kind] = {
    "joint_position": Kind("joint", ("rad", "m")),
    "joint_velocity": Kind("joint", ("rad/s", "m/s")),
    "joint_torque": Kind("actuator", ("N m", "N")),
    "body_position": Kind("body", ("m",), 3),
    "body_orientation": Kind("body", ("quaternion", "unit quaternion", "1"), 4),
    "body_linear_velocity": Kind("body", ("m/s",), 3),
    "body_angular_velocity": Kind("body", ("rad/s",), 3),
    "sensor": Kind("sensor", (), None),
    "supply_voltage": Kind("actuator", ("V",), may_lack_target=True),
    "temperature": Kind("actuator", ("degC",), may_lack_target=True),
}


@dataclass(frozen=True)
class Location:
    """Where in a recording something is; every complaint starts with it."""

    file: str
    episode: str | None = None
    signal: str | None = None

    def make_error(self, problem: str) -> RecordingError:
        """The exception that says `problem` of this place."""
        place = self.file
        if self.episode is not None:
            place += f", episode {quote_name(self.episode)}"
        if self.signal is not None:
            place += f", signal {quote_name(self.signal)}"
        return RecordingError(f"{place}: {problem}")


def name_signal(kind: str, target: str, taken: Container[str]) -> str:
    """A name for a signal that no other has: "elbow_position", say."""
    word = kind.removeprefix("joint_").removeprefix("body_")
    parts = [target, "" if kind == "sensor" else word]
    name = "_".join(filter(None, parts)).replace("/", "_").replace("\0", "_")
    while name in taken or name in ("", ".", ".."):
        name += "_"
    return name
