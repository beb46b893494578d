"""Robots of the other cases as values: a model, its sensors, and how it is moved."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.other_cases.motions import Motion, Rng


@dataclass(frozen=True)
class Sensor:
    """What one sensor says.

    Attributes:
        kind: of contract section 1.
        target: what it is a reading of.
        unit: of it.
        noise: its standard deviation.
        bias: added to what is true, to each column its own where there are several.
        step: of an encoder, 0: none.
    """

    kind: str
    target: str
    unit: str
    noise: float
    bias: float | tuple[float, ...] = 0.0
    step: float = 0.0


@dataclass(frozen=True)
class Robot:
    """A given model, its sensors and its motion.

    Attributes:
        name: of it.
        xml: the model as the user has it.
        signals: by name.
        motion: what commands it.
        seconds: of an episode.
        episodes: of a recording.
        rate: [Hz] of the samples.
        start: sets the first state of an episode; None: the model's own.
        fine: [s] step of the hidden robot, 0: a fifth of the given one.
        piece: [s] of the pieces of a test, where open loop does not hold longer; 0:
            whole episodes.
    """

    name: str
    xml: str
    signals: Mapping[str, Sensor]
    motion: Motion
    seconds: float
    episodes: int
    rate: float
    start: Callable[[Any, Rng], None] | None = None
    fine: float = 0.0
    piece: float = 0.0


def measure_angle(
    joint: str, noise: float, bias: float = 0.0, step: float = 0.0
) -> Sensor:
    """A sensor of a hinge's position.

    Args:
        joint: name of the hinge.
        noise: [rad] standard deviation.
        bias: [rad] added to each reading.
        step: [rad] of the encoder, 0: none.
    """
    return Sensor("joint_position", joint, "rad", noise, bias, step)


def measure_speed(joint: str, noise: float) -> Sensor:
    """A sensor of a hinge's velocity, with noise [rad/s]."""
    return Sensor("joint_velocity", joint, "rad/s", noise)


def measure_slide(joint: str, noise: float) -> Sensor:
    """A sensor of a slide's position, with noise [m]."""
    return Sensor("joint_position", joint, "m", noise)


def measure_pose(body: str, place: float, turn: float) -> dict[str, Sensor]:
    """A camera's two signals of a body: its position and orientation.

    Args:
        body: name of the body.
        place: [m] noise of the position.
        turn: [1] noise of the quaternion.
    """
    return {
        "pos": Sensor("body_position", body, "m", place),
        "ori": Sensor("body_orientation", body, "quaternion", turn),
    }
