"""Readings at rest: the signals of a recording that read a robot's sensors."""

from collections.abc import Mapping

import numpy as np

from ..body.body import BELLY_SENSOR, Anatomy, Floats
from ..engine.channels import parse_sensor
from ..errors import RecordingError
from ..recording import Episode, Recording, Signal

# by kind of sensor: the signal that reads it, of which part or joint, and its unit
_SIGNALS = {
    "tilt": ("vertical", "1"),
    "clearance": ("clearance", "m"),
    "touch": ("{part}_touch", "1"),
    "gravity": ("{part}_vertical", "1"),
    "position": ("{part}_tip", "m"),
    "torque": ("{joint}_torque", "N m"),
}


def name_signal_of(sensor: str, anatomy: Anatomy) -> str:
    """The signal of a recording that reads a sensor.

    Args:
        sensor: its name, see `engine.channels`.
    """
    kind, _, part = sensor.partition(":")
    joint = anatomy.joints[anatomy.parts.index(part)] if part else ""
    return _SIGNALS[kind][0].format(part=part, joint=joint)


def count_columns(sensor: str, anatomy: Anatomy) -> int:
    """How many columns the signal of a sensor has: one, or x, y and z."""
    return 3 if parse_sensor(sensor, anatomy.parts)[0].width > 1 else 1


def read_rest_channels(recording: Recording, anatomy: Anatomy) -> Floats:
    """(C) channels of a recording of one action; NaN where a sensor gave nothing.

    A vertical is the world's in the frame of torso or part (3) [1], a tip is in the
    torso's frame (3) [m], torques are of joints [N m].

    Raises:
        RecordingError: a signal is missing, but for that of clearance, or its last
            sample.
    """
    (name, episode), *_ = recording.episodes.items()
    found = []
    for sensor in anatomy.sensors:
        signal, width = name_signal_of(sensor, anatomy), count_columns(sensor, anatomy)
        read = episode.signals.get(signal)
        last = np.full(1, np.nan) if read is None else np.atleast_1d(read.values[-1])
        if last.shape != (width,) or (np.isnan(last).any() and sensor != "clearance"):
            columns = " (x, y, z)" if width > 1 else ""
            raise RecordingError(
                f"{recording.file}, episode {name!r}: no reading of {signal!r}{columns}"
                f" at the last sample; identify needs {sensor} at rest"
            )
        found.append(_convert_reading(sensor, last))
    return np.concatenate(found)


def _convert_reading(sensor: str, read: Floats) -> Floats:
    """The channels of a sensor from what its signal says."""
    kind = sensor.partition(":")[0]
    if kind == "tilt":
        x, y, _ = np.clip(read, -1, 1)
        return np.array([-np.degrees(np.arcsin(y)), np.degrees(np.arcsin(x))])
    if kind == "gravity":
        return np.degrees(read / max(float(np.linalg.norm(read)), 1e-9))
    if kind == "clearance":
        return 1000 * (read - BELLY_SENSOR)
    return 1000 * read if kind == "position" else read


def revert_channels(sensor: str, channels: Floats) -> Floats:
    """What the signal (3) or (1) of a sensor says, by its channels (n)."""
    kind = sensor.partition(":")[0]
    if kind == "tilt":
        x, y = np.sin(np.radians(channels[1])), -np.sin(np.radians(channels[0]))
        return np.array([x, y, np.sqrt(max(0.0, 1 - x * x - y * y))])
    if kind == "gravity":
        return np.radians(channels)
    if kind == "clearance":
        return channels / 1000 + BELLY_SENSOR
    return channels / 1000 if kind == "position" else channels


def make_rest_episode(
    anatomy: Anatomy,
    time: Floats,
    target: Floats,
    read: Mapping[str, Floats],
    angles: Floats | None = None,
) -> Episode:
    """The episode of an action: from all joints at zero to a target, then at rest.

    Args:
        time: (3) of the start, of the target reached, and at rest [s].
        target: (P) of the joints [rad].
        read: by sensor, what its signal (3) or (1) says at rest.
        angles: (P) of the joints at rest [rad], where they are read.
    """
    signals = {}
    for sensor, values in read.items():
        name, kind = name_signal_of(sensor, anatomy), sensor.partition(":")[0]
        wide = count_columns(sensor, anatomy) > 1
        last, unit = np.reshape(values, (3,) if wide else ()), _SIGNALS[kind][1]
        if kind == "torque":
            servo = f"{name.removesuffix('_torque')}_servo"
            signals[name] = _make_rest_signal(last, "joint_torque", servo, unit)
        else:
            signals[name] = _make_rest_signal(last, "sensor", name, unit)
    if angles is not None:
        for joint, angle in zip(anatomy.joints, angles, strict=True):
            signal = _make_rest_signal(angle, "joint_position", joint, "rad")
            signals[f"{joint}_position"] = signal
    ctrl = np.array([0 * target, target, target])
    servos = tuple(f"{joint}_servo" for joint in anatomy.joints)
    return Episode(time, ctrl, servos, signals)


def _make_rest_signal(last: Floats, kind: str, target: str, unit: str) -> Signal:
    """A signal of three samples of which only the last was read."""
    values = np.full((3, *last.shape), np.nan)
    values[-1] = last
    return Signal(values, kind, target, unit)
