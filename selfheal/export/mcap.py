"""MCAP, which Foxglove and PlotJuggler open: messages in JSON, a topic for each group.

Topics are `/ctrl`, `/signals` and `/predicted`, of which a message is a sample, and
`/episode`, of which a message begins an episode.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..extras import import_extra
from ..recording import Episode, Recording
from ..recording.data import Floats
from ..recording.table import PREDICTED, SIGNALS

if TYPE_CHECKING:
    from mcap.writer import Writer

_PAUSE = 1.0  # [s] between episodes, so that a plot shows a gap; chosen
_NUMBER = {"type": "number"}


def write_mcap(path: Path, recording: Recording, predicted: Recording | None) -> None:
    """Write an MCAP, in which episodes follow one another.

    A message has `time`, the episode's own [s], and a field for each command or signal;
    one that was not read is left out.

    Raises:
        InputError: the library is not installed.
    """
    writers = import_extra("mcap.writer", "logs", "MCAP")
    parts = {n: _list_groups(recording, predicted, n) for n in recording.episodes}
    topics: dict[str, dict[str, object]] = {
        "episode": {"id": {"type": "string"}, "time": _NUMBER}
    }
    for groups in parts.values():
        for group, columns in groups.items():
            topics.setdefault(group, {}).update(_describe(columns))
    with path.open("wb") as file:
        writer = writers.Writer(file)
        writer.start(library="selfheal")
        channels = {name: _register(writer, name, f) for name, f in topics.items()}
        start = 0.0
        for name, groups in parts.items():
            time = recording.episodes[name].time
            stamps = np.rint(1e9 * (start + time - time[0]))
            begun = {"id": name, "time": time[0]}
            _add(writer, channels["episode"], stamps[0], begun)
            for group, columns in groups.items():
                for stamp, message in zip(
                    stamps, _list_messages(time, columns), strict=True
                ):
                    _add(writer, channels[group], stamp, message)
            start += time[-1] - time[0] + _PAUSE
        writer.finish()


def _list_groups(
    recording: Recording, predicted: Recording | None, name: str
) -> dict[str, dict[str, tuple[Floats, str]]]:
    """What an episode's messages hold, by topic."""
    episode = recording.episodes[name]
    groups = {"ctrl": _name_commands(episode), SIGNALS: _name_signals(episode)}
    if predicted:
        groups[PREDICTED] = _name_signals(predicted.episodes[name])
    return groups


def _register(writer: "Writer", topic: str, fields: Mapping[str, object]) -> int:
    """Number of a new channel whose messages have these fields."""
    form = json.dumps({"type": "object", "properties": dict(fields)}).encode()
    schema = writer.register_schema(f"selfheal.{topic}", "jsonschema", form)
    return writer.register_channel(f"/{topic}", "json", schema)


def _add(
    writer: "Writer", channel: int, stamp: float, message: Mapping[str, object]
) -> None:
    """Add a message."""
    text = json.dumps(message, allow_nan=False).encode()
    writer.add_message(channel, int(stamp), text, int(stamp))


def _name_commands(episode: Episode) -> dict[str, tuple[Floats, str]]:
    """Commands (T), or (T, d) of an actuator with several, and their unit by name."""
    names = np.array(episode.ctrl_names, dtype=object)
    columns = {name: episode.ctrl[:, names == name] for name in episode.ctrl_names}
    return {n: (c[:, 0] if c.shape[1] == 1 else c, "") for n, c in columns.items()}


def _name_signals(episode: Episode) -> dict[str, tuple[Floats, str]]:
    """Values (T) or (T, d) of signals, and their units by name."""
    return {name: (s.values, s.unit) for name, s in episode.signals.items()}


def _describe(columns: Mapping[str, tuple[Floats, str]]) -> dict[str, object]:
    """JSON schema of each field of a message."""
    fields: dict[str, object] = {"time": {**_NUMBER, "description": "s"}}
    for name, (values, unit) in columns.items():
        form = _NUMBER if values.ndim == 1 else {"type": "array", "items": _NUMBER}
        fields[name] = {**form, "description": unit}
    return fields


def _list_messages(
    time: Floats, columns: Mapping[str, tuple[Floats, str]]
) -> Iterator[dict[str, object]]:
    """A message for each sample.

    Args:
        time: (T) [s].
        columns: values (T) or (T, d), and their units, by name.
    """
    for k, stamp in enumerate(time.tolist()):
        message: dict[str, object] = {"time": stamp}
        for name, (values, _) in columns.items():
            value = np.atleast_1d(values[k])
            if np.isfinite(value).any():
                known = [x if np.isfinite(x) else None for x in value.tolist()]
                message[name] = known if values.ndim > 1 else known[0]
        yield message
