"""Senses: recordings of a walking robot in, arrays of its channels out."""

import numpy as np

from ..body.body import BELLY_SENSOR, Anatomy, Floats
from ..engine.walk import Channels, list_channels
from ..errors import RecordingError
from ..recording import Episode, Recording


def list_signals_over_time(anatomy: Anatomy) -> dict[str, tuple[str, str, str]]:
    """Kind, target and unit by the name of each signal that may be read over time."""
    found = {
        "vertical": ("sensor", "vertical", "1"),
        "clearance": ("sensor", "clearance", "m"),
        "torso_position": ("body_position", "torso", "m"),
        "torso_orientation": ("body_orientation", "torso", "quaternion"),
    }
    for joint in anatomy.joints:
        found[f"{joint}_position"] = ("joint_position", joint, "rad")
        found[f"{joint}_velocity"] = ("joint_velocity", joint, "rad/s")
        found[f"{joint}_torque"] = ("joint_torque", f"{joint}_servo", "N m")
    return found


def read_channels(
    recording: Recording, anatomy: Anatomy, episode: str | None = None
) -> tuple[Floats, Floats]:
    """Read the channels of one episode; see `engine.walk.list_channels`.

    Args:
        episode: name of the episode; None = the first.

    Returns:
        Time (S) [s] and channels (S, C); a signal that is missing is NaN.

    Raises:
        RecordingError: none of the signals is there, or one has too many columns.
    """
    name = episode or next(iter(recording.episodes))
    e, channels = recording.episodes[name], list_channels(anatomy)
    where = f"{recording.file}, episode {name!r}"
    for sensor in dict.fromkeys(channels.sensors):
        _check_shape(e, sensor, where)
    columns = [_read_channel(e, channels, k) for k in range(len(channels.names))]
    values = np.stack(columns, axis=1)
    if np.isnan(values).all():
        raise RecordingError(
            f"{where}: none of the signals "
            f"{', '.join(dict.fromkeys(channels.sensors))} is in it"
        )
    return e.time, values


def _check_shape(episode: Episode, sensor: str, where: str) -> None:
    """Refuse a signal with another number of columns than its sensor has."""
    signal = episode.signals.get(sensor)
    wanted = (3,) if sensor in ("vertical", "torso_position") else ()
    if signal is not None and signal.values.shape[1:] != wanted:
        fits = ", ".join(map(str, (episode.time.size, *wanted)))
        raise RecordingError(
            f"{where}, signal {sensor!r}: shape {signal.values.shape}; would fit: "
            f"({fits}{',' * (not wanted)})"
        )


def _read_channel(episode: Episode, channels: Channels, k: int) -> Floats:
    """(S) one channel."""
    name, signal = channels.names[k], episode.signals.get(channels.sensors[k])
    if signal is None:
        return np.full(len(episode.time), np.nan)
    v = signal.values
    if name == "tilt left/right":
        return -np.degrees(np.arcsin(np.clip(v[:, 1], -1, 1)))
    if name == "tilt forward/back":
        return np.degrees(np.arcsin(np.clip(v[:, 0], -1, 1)))
    if name == "clearance":
        # a dead sensor reads 0, not less
        return 1000 * np.maximum(v - BELLY_SENSOR, 0)
    if name in ("x", "y"):
        return 1000 * v[:, "xy".index(name)]
    return v if name.endswith("_touch") else np.degrees(v)


def read_position(recording: Recording) -> Floats:
    """(S, 3) of the torso [m]."""
    (episode,) = recording.episodes.values()
    return episode.signals["torso_position"].values


def read_orientation(recording: Recording) -> Floats:
    """(S, 4) of the torso, quaternion."""
    (episode,) = recording.episodes.values()
    return episode.signals["torso_orientation"].values
