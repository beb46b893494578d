"""Channels: what a robot's sensors say at rest, as numbers that bodies can differ in.

A sensor is named `tilt`, `clearance`, or by its kind and part, as `touch:shin` is. It
has one channel or three.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..body.body import Anatomy, Floats, Ints
from ..errors import InputError, UnknownNameError
from ..printable import quote_name

MAX_CLEARANCE = 0.5  # [m] range of the belly sensor; chosen, no pose reaches it upright
TOUCH_HEIGHT = 0.002  # [m] a foot this close to the floor touches it; chosen


@dataclass(frozen=True)
class SensorKind:
    """What a sensor measures.

    Attributes:
        weight: of a channel's error in the loss: what a degree of tilt is [1/unit].
        noise: by which a right prediction is off [unit].
        axes: of its channels; one without a name where it has one channel.
    """

    code: int
    unit: str
    weight: float
    noise: float
    axes: Sequence[str] = ("",)
    of_part: bool = True

    @property
    def width(self) -> int:
        """Channels."""
        return len(self.axes)


# A millimeter counts like half a degree, about the ratio of their residuals on the
# right body (2006 readings: 0.2 deg a tilt, 0.8 mm). Directions are in degrees, too. A
# foot that touches otherwise counts as a reading off by four degrees; chosen.
SENSOR_KINDS = {
    "tilt": SensorKind(0, "deg", 1.0, 0.2, ("left/right", "forward/back"), False),
    "clearance": SensorKind(1, "mm", 0.5, 0.5, of_part=False),
    "touch": SensorKind(2, "1", 4.0, 0.0),
    "gravity": SensorKind(3, "deg", 1.0, 0.3, "xyz"),
    "position": SensorKind(4, "mm", 0.5, 1.0, "xyz"),
    "torque": SensorKind(5, "N m", 20.0, 0.02),
}
# beyond which a miss is as good as another [in degrees of tilt]; chosen: farther off,
# a pose is another rest of the body, and how far says nothing more
CAP = 8.0
# loss of a pose that a body can rest in, though it comes to another: of random trees
# `statics` predicts another rest than `mujoco` in 5 % of poses, and one has 6 others
OTHER_REST = float(np.log(6 / 0.05))


class Loss(NamedTuple):
    """The error of an action: sum_c weight_c min(|predicted_c - measured_c|, cap_c).

    Attributes:
        weight: (C) of the channels [1/unit].
        cap: (C) beyond which a miss is as good as another [unit].
    """

    weight: Floats
    cap: Floats

    def __call__(self, predicted: Floats, measured: Floats) -> Floats:
        """Loss (...) of channels (..., C); one that is not known, NaN, is free."""
        gap = np.minimum(np.abs(predicted - measured), self.cap)
        return np.nansum(gap * self.weight, axis=-1)


@dataclass(frozen=True)
class Channels:
    """The channels (C) of an anatomy's sensors, in their order.

    Attributes:
        code: (C) of each one's kind.
        part: (C) 1..P, or 0 for the torso.
        axis: (C) 0, 1, 2 within its sensor.
        noise: (C) by which a right prediction is off [unit].
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    code: Ints
    part: Ints
    axis: Ints
    loss: Loss
    noise: Floats

    def __len__(self) -> int:
        return len(self.names)

    @property
    def error_name(self) -> str:
        """What `shown` is the error of: "tilt" or "sensor"."""
        return "tilt" if (self.code == SENSOR_KINDS["tilt"].code).any() else "sensor"

    @property
    def shown(self) -> Floats:
        """(C) weights of what a run states as its error: of tilts, or else of all."""
        is_tilt = self.code == SENSOR_KINDS["tilt"].code
        return is_tilt.astype(float) if is_tilt.any() else self.loss.weight

    def weigh_shown(self, values: Floats) -> Floats:
        """Channels (..., C) of the stated error, by their weights (..., K)."""
        shown = self.shown
        return values[..., shown > 0] * shown[shown > 0]


def parse_sensor(name: str, parts: tuple[str, ...]) -> tuple[SensorKind, int]:
    """Kind and part (0 for the torso) of a sensor.

    Raises:
        UnknownNameError: no such kind or part.
        InputError: a part is named for the torso's sensor, or none for a part's.
    """
    kind, _, part = name.partition(":")
    if kind not in SENSOR_KINDS:
        raise UnknownNameError("sensor", kind, SENSOR_KINDS)
    found = SENSOR_KINDS[kind]
    if not found.of_part:
        if part:
            said = f"sensor {quote_name(name)}: {kind} is the torso's"
            raise InputError(f"{said}; would fit: {kind}")
        return found, 0
    if part not in parts:
        raise UnknownNameError(f"part of sensor {kind}", part, parts)
    return found, parts.index(part) + 1


def list_channels(anatomy: Anatomy) -> Channels:
    """The channels of an anatomy's sensors.

    Raises:
        InputError: it has a sensor that says nothing of such a robot.
    """
    return _list_channels(anatomy.sensors, anatomy.parts, anatomy.fixed)


@lru_cache
def _list_channels(
    sensors: tuple[str, ...], parts: tuple[str, ...], fixed: bool
) -> Channels:
    """The channels of sensors; nothing that a fixed robot does ends in another rest."""
    rows, names = list[tuple[int, int, int, SensorKind]](), list[str]()
    for name in sensors:
        kind, part = parse_sensor(name, parts)
        if (name == "clearance" or name.startswith("touch")) and fixed:
            raise InputError(f"sensor {name!r} says nothing of a robot that is fixed")
        if name.startswith("torque") and not fixed:
            raise InputError(
                f"sensor {name!r}: torques are known of robots that are fixed, for a "
                "robot on the floor stands on forces that nothing tells apart"
            )
        rows += [(kind.code, part, k, kind) for k in range(kind.width)]
        names += [f"{name} {axis}".strip() for axis in kind.axes]
    kinds = [kind for *_, kind in rows]
    numbers = np.array([row[:3] for row in rows], np.int64).reshape(-1, 3)
    weight = np.array([kind.weight for kind in kinds])
    # the cap of lengths is as many millimeters as that of angles degrees
    degrees = np.array([k.weight if k.unit == "mm" else 1.0 for k in kinds])
    cap = np.full(len(rows), np.inf) if fixed else CAP / weight * degrees
    units = tuple(kind.unit for kind in kinds)
    noise = np.array([kind.noise for kind in kinds])
    code, owner, axis = numbers.T.copy()
    loss = Loss(weight, cap)
    return Channels(tuple(names), units, code, owner, axis, loss, noise)
