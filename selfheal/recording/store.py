"""Recordings from disk: takes a path, gives a checked Recording."""

import os
import shlex
from dataclasses import dataclass, replace

import h5py
import numpy as np

from ..files import (
    HDF5_ERRORS,
    MAX_VALUES,
    count_values,
    explain_unreadable,
)
from ..limited_reading import explain_dangerous
from ..printable import quote_name
from .check import format_names, validate
from .data import KINDS, Episode, Floats, Location, Signal
from .recording import Recording
from .writing import FORMAT, VERSION

# values that a file may state without storing them, and how much smaller it may store
# more; chosen: a short recording of fill values, and the limit of gzip
MAX_UNSTORED, MAX_COMPRESSION = 1_000_000, 1032
MODEL = "MODEL.xml"  # what a message names where no model is known
EPISODE_MEMBERS = ("time", "ctrl", "qpos0", "qvel0", "signals")


def read(path: str | os.PathLike[str], *, model: str = MODEL) -> Recording:
    """Read and check a recording; nothing outside the file is ever opened.

    Args:
        model: of the robot, for a message that says how a log is imported.

    Raises:
        RecordingError: it breaks the contract: file, episode, signal and what would
            fit. The size is checked from the headers, before any array is read.
    """
    file = Location(os.fspath(path))
    reason = explain_unreadable(path)
    if os.path.isdir(path) or (not reason and not h5py.is_hdf5(path)):
        reason = reason or "it is no HDF5 file, as recordings are"
        raise file.make_error(f"{reason}; {_explain_import(path, model)}")
    if reason := reason or explain_dangerous(path, f"{__name__}:load", "h5py"):
        raise file.make_error(reason)
    try:
        recording = load(path)
    except BlockingIOError as error:
        raise file.make_error("another process holds it open for writing") from error
    except PermissionError as error:
        raise file.make_error("it may not be read: permission denied") from error
    except (OSError, *HDF5_ERRORS) as error:
        raise file.make_error(f"it is damaged or not HDF5 ({error})") from error
    validate(recording)
    return recording


def _explain_import(path: str | os.PathLike[str], model: str = MODEL) -> str:
    """How a log of another kind becomes a recording."""
    words = ("selfheal", "recording", "import", os.fspath(path), "--model", model)
    command = shlex.join(words)
    return (
        f"a log of another kind is imported first: {command} --guess; then {command} "
        "--map map.toml --out recording.h5"
    )


def load(path: str | os.PathLike[str]) -> Recording:
    """Read a recording that is not checked, whatever that does to the process.

    Raises:
        RecordingError: something is missing in it.
        OSError, RuntimeError, KeyError, ValueError, TypeError: h5py's, of a file that
            is damaged.
    """
    with h5py.File(path, "r") as root:
        return _read_recording(root, Location(os.fspath(path)))


def open_recording(
    recording: Recording | str | os.PathLike[str], *, model: str = MODEL
) -> Recording:
    """A recording, checked: the one that is given, or the one at a path.

    Raises:
        RecordingError: it breaks the contract.
    """
    if not isinstance(recording, Recording):
        return read(recording, model=model)
    validate(recording)
    return recording


def _read_recording(root: h5py.File, file: Location) -> Recording:
    found = _read_label(root, "format", file)
    if found != FORMAT:
        raise file.make_error(
            f"format is {found!r}; would fit: {FORMAT!r}; {_explain_import(file.file)}"
        )
    version = root.attrs.get("version")
    if not isinstance(version, (int, np.integer)) or version != VERSION:
        raise file.make_error(
            f"version is {_to_python(version)!r}; this program reads {VERSION}"
        )
    episodes = _open_group(root, "episodes", file)
    opened = [
        _open_episode(episodes, name, Location(file.file, name)) for name in episodes
    ]
    _check_size(opened, file)
    return Recording(
        {str(episode.place.episode): _read_episode(episode) for episode in opened},
        robot=_read_label(root, "robot", file),
        source=_read_label(root, "source", file),
        file=file.file,
    )


@dataclass(frozen=True)
class _OpenEpisode:
    """An episode whose headers were checked and whose arrays were not read yet."""

    place: Location
    group: h5py.Group
    arrays: dict[str, h5py.Dataset]
    signals: dict[str, h5py.Dataset]


def _open_episode(episodes: h5py.Group, name: str, place: Location) -> _OpenEpisode:
    group = _open_group(episodes, name, place)
    members = list(group)
    for member in members:
        if member not in EPISODE_MEMBERS:
            raise place.make_error(
                f"unknown member {quote_name(member)}; would fit: "
                f"{', '.join(EPISODE_MEMBERS)}"
            )
    names = ["time", "ctrl", *(name for name in ("qpos0", "qvel0") if name in members)]
    signals = _open_group(group, "signals", place)
    return _OpenEpisode(
        place,
        group,
        {name: _open_dataset(group, name, place) for name in names},
        {
            name: _open_dataset(signals, name, replace(place, signal=name))
            for name in signals
        },
    )


def _check_size(episodes: list[_OpenEpisode], file: Location) -> None:
    arrays = [
        (episode.place, name, dataset)
        for episode in episodes
        for name, dataset in (episode.arrays | episode.signals).items()
    ]
    counts = [count_values(dataset) for _, _, dataset in arrays]
    total = sum(counts)
    if total > MAX_VALUES:
        raise file.make_error(
            f"it holds {total} values; at most {MAX_VALUES} are read: cut it into "
            "several files"
        )
    for count, (place, name, dataset) in zip(counts, arrays, strict=True):
        stored = MAX_COMPRESSION * dataset.id.get_storage_size()
        if count > max(MAX_UNSTORED, stored / dataset.dtype.itemsize):
            raise place.make_error(
                f"{name} states {count} values and stores hardly any; it is damaged"
            )


def _read_episode(opened: _OpenEpisode) -> Episode:
    arrays, place = opened.arrays, opened.place
    return Episode(
        **{name: _read_floats(dataset) for name, dataset in arrays.items()},
        ctrl_names=_read_names(arrays["ctrl"], place),
        signals={
            name: _read_signal(dataset, replace(place, signal=name))
            for name, dataset in opened.signals.items()
        },
        motion=_read_label(opened.group, "motion", place),
    )


def _read_signal(dataset: h5py.Dataset, place: Location) -> Signal:
    kind = _read_text(dataset, "kind", place, format_names(KINDS))
    known = KINDS.get(kind)  # one that is none is refused later
    thing = f"the name of a {known.target}" if known else "the name of what it is of"
    units = format_names(known.units) if known and known.units else "that of the sensor"
    target = _read_text(dataset, "target", place, thing)
    unit = _read_text(dataset, "unit", place, units)
    return Signal(_read_floats(dataset), kind, target, unit)


def _find_member(parent: h5py.Group, name: str, place: Location) -> h5py.HLObject:
    # by the link itself: `name in parent` would open the file it points to
    links, key = parent.id.links, name.encode()
    if not links.exists(key):
        raise place.make_error(
            f"{name} is missing; {parent.name} holds {format_names(parent)}"
        )
    if links.get_info(key).type != h5py.h5l.TYPE_HARD:
        raise place.make_error(f"{name} is a link to elsewhere; links are not followed")
    return parent[name]


def _open_group(parent: h5py.Group, name: str, place: Location) -> h5py.Group:
    member = _find_member(parent, name, place)
    if not isinstance(member, h5py.Group):
        raise place.make_error(f"{name} must be a group")
    return member


def _open_dataset(parent: h5py.Group, name: str, place: Location) -> h5py.Dataset:
    member = _find_member(parent, name, place)
    if isinstance(member, h5py.Group) and len(member):
        whole = f"{name}/{next(iter(member))}"
        raise place.make_error(
            f"{name} must be a dataset, and is a group, as HDF5 makes one of a slash "
            f"in a name; would fit: {whole.replace('/', '_')!r} for {whole!r}"
        )
    if not isinstance(member, h5py.Dataset):
        raise place.make_error(f"{name} must be a dataset")
    dtype = member.dtype
    if dtype.kind not in "fiu" or dtype.itemsize > 8:
        raise place.make_error(f"{name} has type {dtype}; would fit: float64")
    if member.shape is None:
        raise place.make_error(f"{name} is empty; would fit: an array")
    if member.is_virtual or member.external:
        raise place.make_error(
            f"{name} keeps its data elsewhere; links are not followed"
        )
    return member


def _read_floats(dataset: h5py.Dataset) -> Floats:
    return np.asarray(dataset[()], dtype=np.float64)


def _read_label(item: h5py.HLObject, name: str, place: Location) -> str | None:
    return _read_text(item, name, place) if name in item.attrs else None


def _read_text(
    item: h5py.HLObject, name: str, place: Location, fits: str = "a text"
) -> str:
    value = item.attrs.get(name)
    if isinstance(value, bytes):
        return value.decode()
    if value is None:
        raise place.make_error(f"it lacks the attribute {name}; would fit: {fits}")
    if not isinstance(value, str):
        raise place.make_error(
            f"attribute {name} is {_to_python(value)!r}, no text; would fit: {fits}"
        )
    return str(value)


def _to_python(value: object) -> object:
    """What numpy holds, as Python says it."""
    return value.tolist() if isinstance(value, np.generic | np.ndarray) else value


def _read_names(ctrl: h5py.Dataset, place: Location) -> tuple[str, ...]:
    names = ctrl.attrs.get("names")
    if names is None:
        raise place.make_error(
            "ctrl lacks the attribute names: the actuator of each column"
        )
    texts = [n.decode() if isinstance(n, bytes) else n for n in np.atleast_1d(names)]
    if not all(isinstance(text, str) for text in texts):
        raise place.make_error(
            f"attribute names of ctrl is {_to_python(names)!r}; it must be texts"
        )
    return tuple(map(str, texts))
