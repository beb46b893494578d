"""Recordings of arrays in memory: arrays or a table by name in; a checked one out."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import InputError, UnknownNameError
from .check import validate
from .data import KINDS, Episode, Recording, Signal
from .model import ModelNames, check_against_model

# targets by kind, what is measured of each
Table = Mapping[str, Mapping[str, Any]]


def build_recording(
    time: Any,
    ctrl: Mapping[str, Any],
    signals: Table,
    *,
    names: ModelNames | None = None,
    episode: str = "000",
    qpos0: Any = None,
    qvel0: Any = None,
    motion: str | None = None,
    robot: str | None = None,
    source: str | None = None,
) -> Recording:
    """A recording of one episode; see `Recording.from_arrays`.

    Args:
        time: (T) [s].
        ctrl: (T) by actuator.
        signals: (T) or (T, d) by kind and target.
        names: of the model, which has the units; None: those of hinges.
        episode: its id.
        qpos0: (nq) position at time[0], or None.
        qvel0: (nv) velocity at time[0], or None.
        motion: label or None.
        robot: label or None.
        source: where the data come from, or None.

    Raises:
        RecordingError: it breaks the contract.
        UnknownNameError: a kind that is none.
        InputError: an array that holds no numbers, or rows that do not fit.
    """
    stamps = _to_floats("time", time)
    columns = [_to_floats(f"ctrl of {name!r}", ctrl[name]) for name in ctrl]
    for name, column in zip(ctrl, columns, strict=True):
        if column.shape != stamps.shape:
            raise InputError(
                f"ctrl of {name!r} has shape {column.shape}; would fit: {stamps.shape}"
            )
    made = dict[str, Signal]()
    for kind, table in signals.items():
        if kind not in KINDS:
            raise UnknownNameError("kind of signal", kind, KINDS)
        for target, values in table.items():
            signal = Signal(
                _to_floats(f"{kind} of {target!r}", values),
                kind, target, _find_unit(kind, target, names),
            )  # fmt: skip
            made[name_signal(kind, target, made)] = signal
    held = np.stack(columns, axis=1) if columns else np.empty((stamps.size, 0))
    part = Episode(
        stamps, held, tuple(ctrl), made,
        None if qpos0 is None else _to_floats("qpos0", qpos0),
        None if qvel0 is None else _to_floats("qvel0", qvel0),
        motion,
    )  # fmt: skip
    recording = Recording({episode: part}, robot, source)
    validate(recording)
    if names is not None:
        check_against_model(recording, names)
    return recording


def read_table(
    frame: Any, time: str, ctrl: Mapping[str, str], signals: Table
) -> tuple[Any, dict[str, Any], dict[str, dict[str, Any]]]:
    """Arrays of a table's columns, as `build_recording` takes them.

    Args:
        frame: pandas or polars data frame, or anything that gives a column by name.
        time: name of the column of times [s].
        ctrl: names of columns by actuator.
        signals: names of columns, or a list of them for a vector, by kind and target.

    Returns:
        time (T), ctrl (T) by actuator, signals (T) or (T, d) by kind and target.

    Raises:
        UnknownNameError: a column that the table does not have.
    """
    columns = [str(name) for name in frame.columns]

    def take(name: Any) -> Any:
        if not isinstance(name, str):
            return np.stack([take(part) for part in name], axis=1)
        if name not in columns:
            raise UnknownNameError("column", name, columns)
        return np.asarray(frame[name])

    return (
        take(time),
        {actuator: take(name) for actuator, name in ctrl.items()},
        {kind: {target: take(name) for target, name in table.items()}
         for kind, table in signals.items()},
    )  # fmt: skip


def name_signal(kind: str, target: str, taken: Mapping[str, Any]) -> str:
    """A name for a signal that no other has: "elbow_position", say.

    Args:
        kind: of the contract.
        target: of the model, or "".
        taken: names that others have.
    """
    word = kind.removeprefix("joint_").removeprefix("body_")
    parts = [target, "" if kind == "sensor" else word]
    name = "_".join(filter(None, parts)).replace("/", "_").replace("\0", "_")
    while name in taken or name in ("", ".", ".."):
        name += "_"
    return name


def find_names(model: str | os.PathLike[str] | None) -> ModelNames | None:
    """The names of a model at a path; None where there is no path."""
    from .names import read_names

    return None if model is None else read_names(model)


def _find_unit(kind: str, target: str, names: ModelNames | None) -> str:
    """The unit of a signal: the model's where it says one."""
    known = names.targets[KINDS[kind].target].get(target) if names else None
    stated = known.units.get(kind) if known else None
    return stated or (*KINDS[kind].units, "1")[0]


def _to_floats(what: str, values: Any) -> np.ndarray:
    """An array (...) of float64."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} is no array of numbers: {error}") from error
