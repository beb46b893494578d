"""Checks of contract section 1: takes a Recording, returns nothing or refuses it."""

from collections.abc import Iterable

import numpy as np

from ..printable import join_names, quote_name
from .data import KINDS, Episode, EpisodeTable, Floats, Kind, Location, Signal

NORM_TOLERANCE = 0.01  # of a quaternion; chosen: two printed decimals still pass
MAX_MAGNITUDE = 1e10  # of any number in SI units; MuJoCo's mjMAXVAL of a state


def validate(recording: EpisodeTable) -> None:
    """Refuse what breaks the contract and needs no model to see.

    Raises:
        RecordingError: the first problem: file, episode, signal and what would fit.
    """
    if not recording.episodes:
        raise Location(recording.file).make_error(
            "it holds no episode; at least one is needed"
        )
    for name, episode in recording.episodes.items():
        check_episode(name, episode, recording.file)


def check_episode(name: str, episode: Episode, file: str) -> None:
    """Refuse an episode that breaks the contract.

    Raises:
        RecordingError: the first problem.
    """
    place = Location(file, name)
    _check_id(name, place)
    _check_time(episode.time, place)
    _check_ctrl(episode, place)
    _check_state(episode, place)
    for what in ("time", "ctrl", "qpos0", "qvel0"):
        _check_magnitude(what, getattr(episode, what), place)
    for signal_name, signal in episode.signals.items():
        where = Location(file, name, signal_name)
        _check_id(signal_name, where)
        _check_signal(signal, episode.time.size, where)


def format_names(names: Iterable[str]) -> str:
    """The names as a message shows them."""
    return join_names(quote_name(str(name)) for name in names) or "none"


def _check_id(name: str, place: Location) -> None:
    if name in ("", ".", "..") or "/" in name or "\0" in name:
        raise place.make_error(
            "the name must not be empty, '.', '..' or hold '/' or NUL"
        )


def _check_time(time: Floats, place: Location) -> None:
    if time.ndim != 1 or not time.size:
        raise place.make_error(
            f"time has shape {time.shape}; would fit: (T,) with T >= 1"
        )
    if not np.isfinite(time).all():
        row = int(np.argmin(np.isfinite(time)))
        raise place.make_error(
            f"time is {time[row]} at sample {row}; it must be finite"
        )
    steps = np.diff(time)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0)) + 1
        raise place.make_error(
            f"time must strictly increase, but goes from {time[row - 1]} to "
            f"{time[row]} s at sample {row}"
        )


def _check_ctrl(episode: Episode, place: Location) -> None:
    ctrl, names = episode.ctrl, episode.ctrl_names
    if ctrl.ndim != 2 or len(ctrl) != episode.time.size:
        raise place.make_error(
            f"ctrl has shape {ctrl.shape}; would fit: ({episode.time.size}, nu), one "
            "row a sample of time, one column a control"
        )
    if len(names) != ctrl.shape[1] or "" in names:
        raise place.make_error(
            f"ctrl has {ctrl.shape[1]} columns and the names {format_names(names)}; "
            "would fit: one actuator name a column"
        )
    if not np.isfinite(ctrl).all():
        row, column = np.argwhere(~np.isfinite(ctrl))[0]
        raise place.make_error(
            f"ctrl of {quote_name(names[column])} is {ctrl[row, column]} at sample "
            f"{row}; a command is never missing: repeat the one that was held"
        )


def _check_state(episode: Episode, place: Location) -> None:
    for name, state in (("qpos0", episode.qpos0), ("qvel0", episode.qvel0)):
        if state is None:
            continue
        if state.ndim != 1:
            raise place.make_error(
                f"{name} has shape {state.shape}; would fit: one axis"
            )
        if not np.isfinite(state).all():
            raise place.make_error(
                f"{name} is not finite; leave it out where the state is unknown"
            )


def _check_magnitude(what: str, values: Floats | None, place: Location) -> None:
    if values is not None and (beyond := np.abs(values) > MAX_MAGNITUDE).any():
        raise place.make_error(
            f"{what} holds {values[beyond][0]:.4g}; would fit: SI units, and no number "
            f"beyond {MAX_MAGNITUDE:g}"
        )


def _check_signal(signal: Signal, samples: int, place: Location) -> None:
    kind = KINDS.get(signal.kind)
    if kind is None:
        raise place.make_error(
            f"unknown kind {quote_name(signal.kind)}; valid: {', '.join(KINDS)}"
        )
    if not signal.unit or (kind.units and signal.unit not in kind.units):
        fits = format_names(kind.units) if kind.units else "the unit of that sensor"
        raise place.make_error(
            f"unit {quote_name(signal.unit)} does not fit kind {signal.kind!r}; would "
            f"fit: {fits}"
        )
    if not signal.target and not kind.may_lack_target:
        raise place.make_error(
            f"it lacks a target; would fit: the name of a {kind.target}"
        )
    _check_values(signal, kind, samples, place)


def _check_values(signal: Signal, kind: Kind, samples: int, place: Location) -> None:
    values = signal.values
    shape = (samples, *values.shape[1:2]) if kind.width is None else (samples,)
    shape = (samples, kind.width) if kind.width else shape
    if values.shape != shape or 0 in shape[1:]:
        fits = {
            0: f"({samples},)",
            None: f"({samples},) or ({samples}, d)",
        }.get(kind.width, f"({samples}, {kind.width})")
        raise place.make_error(
            f"shape {values.shape} does not fit kind {signal.kind!r} and {samples} "
            f"samples of time; would fit: {fits}"
        )
    if np.isinf(values).any():
        row = int(np.argwhere(np.isinf(values))[0][0])
        raise place.make_error(f"infinite at sample {row}; a missing sample is NaN")
    _check_magnitude("it", values, place)
    if signal.kind == "body_orientation":
        _check_norm(values, place)


def _check_norm(quaternion: Floats, place: Location) -> None:
    norm = np.linalg.norm(quaternion, axis=1)
    off = np.abs(norm - 1) > NORM_TOLERANCE  # False where a sample is missing
    if off.any():
        row = int(np.argmax(off))
        raise place.make_error(
            f"quaternion of length {norm[row]:.4g} at sample {row}; would fit: unit "
            f"quaternions w x y z, within {NORM_TOLERANCE}"
        )
