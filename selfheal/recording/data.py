"""The nouns of contract section 1: arrays in, frozen records of one robot out."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Signal:
    """What one sensor said.

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
        signals: by name.
        qpos0: (nq) or None, position at time[0].
        qvel0: (nv) or None, velocity at time[0].
        motion: label or None.
    """

    time: Floats
    ctrl: Floats
    ctrl_names: tuple[str, ...]
    signals: Mapping[str, Signal]
    qpos0: Floats | None = None
    qvel0: Floats | None = None
    motion: str | None = None


@dataclass(frozen=True, eq=False)
class Recording:
    """What one robot did and felt.

    Attributes:
        episodes: by id.
        robot: label or None.
        source: where the data come from, or None.
        file: the file it was read from, for messages and for names of held-out
            episodes; not stored.
    """

    episodes: Mapping[str, Episode]
    robot: str | None = None
    source: str | None = None
    file: str = "recording"

    @classmethod
    def from_arrays(
        cls,
        time: Any,
        ctrl: Mapping[str, Any],
        signals: Mapping[str, Mapping[str, Any]],
        *,
        model: str | os.PathLike[str] | None = None,
        **more: Any,
    ) -> "Recording":
        """Make a recording of one episode of arrays, and check it.

        Args:
            time: (T) [s] strictly increasing.
            ctrl: command (T) by name of the actuator, in the actuator's own unit.
            signals: (T), or (T, d) of a vector, by kind of `KINDS` and by name of
                the joint, actuator, body or sensor; NaN where a sample is missing.
            model: MJCF or URDF that the names are checked against; it tells slides
                (m, m/s, N) from hinges (rad, rad/s, N m), which are assumed without.
            **more: `episode` (its id), `qpos0` (nq), `qvel0` (nv), `motion`, `robot`,
                `source`: see `Episode` and `Recording`.

        Raises:
            RecordingError: it breaks the contract; says where and what would fit.
            InputError: an array that holds no numbers, or a name that is none.
        """
        from .build import build_recording, find_names

        return build_recording(time, ctrl, signals, names=find_names(model), **more)

    @classmethod
    def from_dataframe(
        cls,
        frame: Any,
        time: str,
        ctrl: Mapping[str, str],
        signals: Mapping[str, Mapping[str, Any]],
        **more: Any,
    ) -> "Recording":
        """Make a recording of one episode of a table, and check it.

        Args:
            frame: pandas or polars data frame.
            time: name of the column of times [s].
            ctrl: name of a column by actuator.
            signals: name of a column, or a list of names for a vector, by kind and
                target.
            **more: as `from_arrays` takes it.

        Raises:
            RecordingError: it breaks the contract.
            InputError: the table lacks a column, or one holds no numbers.
        """
        from .build import read_table

        return cls.from_arrays(*read_table(frame, time, ctrl, signals), **more)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Check this recording and write it, whole or not at all.

        Raises:
            RecordingError: it breaks the contract; nothing is written.
            InputError: nothing can be written there.
        """
        from .store import write

        write(self, path)


@dataclass(frozen=True)
class Kind:
    """What the contract says of one kind of signal.

    Attributes:
        target: the sort of thing it belongs to.
        units: those that fit; empty where the model's sensor decides.
        width: columns; 0 for a plain (T) signal, None where the sensor decides.
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
            place += f", episode {self.episode!r}"
        if self.signal is not None:
            place += f", signal {self.signal!r}"
        return RecordingError(f"{place}: {problem}")
