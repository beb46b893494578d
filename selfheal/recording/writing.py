"""Recordings to disk: takes episodes, whole or part by part; a file out."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import h5py
import numpy as np

from ..files import atomic_hdf5
from .check import check_episode
from .data import Episode, EpisodeTable, Floats, Location

FORMAT = "selfheal-recording"
VERSION = 1


def write(recording: EpisodeTable, path: str | os.PathLike[str]) -> None:
    """Check a recording and write it; the file appears whole or not at all.

    Raises:
        RecordingError: the recording breaks the contract; nothing is written.
        InputError: nothing can be written at `path`.
    """
    if not recording.episodes:
        raise Location(os.fspath(path)).make_error(
            "it holds no episode; at least one is needed"
        )
    for name, episode in recording.episodes.items():
        check_episode(name, episode, os.fspath(path))
    with open_writer(path, recording.robot, recording.source) as writer:
        for name, episode in recording.episodes.items():
            writer.append(name, episode)


@dataclass(frozen=True)
class Writer:
    """A recording that is being written; see `open_writer`."""

    episodes: h5py.Group
    path: str
    compression: str | None = "gzip"

    def append(self, name: str, part: Episode) -> None:
        """Check a part of an episode and write it behind what the episode has.

        Raises:
            RecordingError: the part breaks the contract.
        """
        check_episode(name, part, self.path)
        if name in self.episodes:
            _extend_episode(self.episodes[name], part)
        else:
            group = self.episodes.create_group(name, track_order=True)
            _write_episode(group, part, self.compression)


@contextmanager
def open_writer(
    path: str | os.PathLike[str],
    robot: str | None,
    source: str | None,
    *,
    compression: str | None = "gzip",
) -> Iterator[Writer]:
    """Begin a recording that is written part by part.

    Args:
        path: of the file, which appears whole at the end or not at all.
        compression: of arrays, as h5py has it; None writes thrice as fast.

    Raises:
        InputError: nothing can be written at `path`.
    """
    with atomic_hdf5(path) as root:
        root.attrs.update(format=FORMAT, version=VERSION)
        _set_labels(root, robot=robot, source=source)
        group = root.create_group("episodes", track_order=True)
        yield Writer(group, os.fspath(path), compression)


def _write_episode(
    group: h5py.Group, episode: Episode, compression: str | None
) -> None:
    _set_labels(group, motion=episode.motion)
    _write_rows(group, "time", episode.time, compression)
    ctrl = _write_rows(group, "ctrl", episode.ctrl, compression)
    ctrl.attrs["names"] = np.array(episode.ctrl_names, dtype=h5py.string_dtype())
    for name, state in (("qpos0", episode.qpos0), ("qvel0", episode.qvel0)):
        if state is not None:
            group.create_dataset(name, data=state, dtype="f8")
    signals = group.create_group("signals", track_order=True)
    for name, signal in episode.signals.items():
        dataset = _write_rows(signals, name, signal.values, compression)
        _set_labels(dataset, kind=signal.kind, target=signal.target, unit=signal.unit)


def _extend_episode(group: h5py.Group, part: Episode) -> None:
    values = {"time": part.time, "ctrl": part.ctrl}
    values |= {f"signals/{name}": s.values for name, s in part.signals.items()}
    for name, rows in values.items():
        dataset = group[name]
        if rows.size:
            dataset.resize(len(dataset) + len(rows), axis=0)
            dataset[-len(rows) :] = rows


def _set_labels(item: "h5py.HLObject", **texts: str | None) -> None:
    item.attrs.update({name: text for name, text in texts.items() if text is not None})


def _write_rows(
    group: h5py.Group, name: str, values: Floats, compression: str | None
) -> h5py.Dataset:
    """A dataset that can be extended.

    Args:
        values: (T, ...) its first rows.
    """
    if not values.size:  # it cannot be chunked, so neither compressed nor extended
        return group.create_dataset(name, data=values, dtype="f8")
    most = (None, *values.shape[1:])
    return group.create_dataset(
        name, data=values, dtype="f8", compression=compression, maxshape=most
    )
