"""A recording as a table: a column for each command and signal, a row for each sample.

Names are as in the file: `ctrl/servo`, `signals/knee_position`; an element of a vector,
or of an actuator with several controls, has its number, as `signals/gyro[0]`.
"""

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from .data import Episode, EpisodeTable, Floats

if TYPE_CHECKING:
    import pyarrow

SIGNALS, PREDICTED = "signals", "predicted"  # first parts of columns' names
_UNIT = b"unit"  # of a field's metadata


def list_commands(episode: Episode) -> dict[str, tuple[Floats, str]]:
    """Values (T) and unit of each command's column, by its name."""
    counts, seen = Counter(episode.ctrl_names), Counter[str]()
    found = dict[str, tuple[Floats, str]]()
    for name, values in zip(episode.ctrl_names, episode.ctrl.T, strict=True):
        number = f"[{seen[name]}]" if counts[name] > 1 else ""
        seen[name] += 1
        found[f"ctrl/{name}{number}"] = values, ""  # the actuator's own unit
    return found


def list_signals(
    episode: Episode, group: str = SIGNALS
) -> dict[str, tuple[Floats, str]]:
    """Values (T) and unit of each signal's column, by its name.

    Args:
        group: `SIGNALS` or `PREDICTED`; of these a column without any value is left
            out, for no model predicts it.
    """
    found = dict[str, tuple[Floats, str]]()
    for name, signal in episode.signals.items():
        columns = np.atleast_2d(signal.values.T)
        for k, values in enumerate(columns):
            number = f"[{k}]" if signal.values.ndim > 1 else ""
            column = f"{group}/{name}{number}"
            while column in found:  # another signal has the name of an element
                column += "_"
            found[column] = values, signal.unit
    is_wanted = group == SIGNALS
    return {k: c for k, c in found.items() if is_wanted or np.isfinite(c[0]).any()}


def list_columns(
    recording: EpisodeTable, predicted: EpisodeTable | None, name: str
) -> dict[str, tuple[Floats, str]]:
    """Values (T) and unit of all columns of an episode, by their names."""
    episode = recording.episodes[name]
    beside = list_signals(predicted.episodes[name], PREDICTED) if predicted else {}
    return {**list_commands(episode), **list_signals(episode), **beside}


def build_table(
    recording: EpisodeTable, predicted: EpisodeTable | None = None
) -> "pyarrow.Table":
    """Arrow's table of all episodes, null where a sample is missing.

    Its first columns are `episode` and `time`; `find_unit` has a column's unit.

    Raises:
        InputError: a signal has one unit in an episode and another one elsewhere.
    """
    import pyarrow as pa

    parts = {n: list_columns(recording, predicted, n) for n in recording.episodes}
    units = _merge_units(recording, parts)
    fields = [
        pa.field(name, pa.float64(), metadata={_UNIT: unit.encode()})
        for name, unit in {"time": "s", **units}.items()
    ]
    schema = pa.schema([pa.field("episode", pa.string()), *fields])
    tables = []
    for name, columns in parts.items():
        time = recording.episodes[name].time
        arrays = [
            pa.array(columns[c][0], from_pandas=True)  # NaN becomes null
            if c in columns
            else pa.nulls(time.size, pa.float64())
            for c in units
        ]
        labels = pa.repeat(name, time.size)
        tables.append(
            pa.Table.from_arrays([labels, pa.array(time), *arrays], schema=schema)
        )
    return pa.concat_tables(tables) if tables else schema.empty_table()


def _merge_units(
    recording: EpisodeTable,
    parts: Mapping[str, Mapping[str, tuple[Floats, str]]],
) -> dict[str, str]:
    """The unit of each column of any episode."""
    units = dict[str, str]()
    for episode, columns in parts.items():
        for name, (_, unit) in columns.items():
            if units.setdefault(name, unit) != unit:
                raise InputError(
                    f"{recording.file}: {name} is in {unit!r} in episode {episode!r} "
                    f"and in {units[name]!r} before; would fit: one unit"
                )
    return units


def find_unit(field: "pyarrow.Field") -> str:
    """The unit of a column of `build_table`; empty where it is not known."""
    return (field.metadata or {}).get(_UNIT, b"").decode()
