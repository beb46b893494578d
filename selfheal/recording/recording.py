"""Recordings of one robot: made of files, of arrays or of tables; checked."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError, UnknownNameError
from ..extras import import_extra
from ..notebook import Columns, format_columns, open_axes
from ..printable import make_printable
from .check import validate
from .data import KINDS, Episode, Floats, Signal, name_signal
from .model import ModelNames, check_against_model
from .names import read_names
from .table import build_table, list_signals
from .writing import write

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes


class EpisodeDetails(TypedDict, total=False):
    """What else may be known of an episode: see `Episode` and `Recording`."""

    episode: str
    qpos0: ArrayLike | None
    qvel0: ArrayLike | None
    motion: str | None
    robot: str | None
    source: str | None


class DataFrame(Protocol):
    """What pandas and polars have in common."""

    @property
    def columns(self) -> Iterable[object]:
        """Names."""

    def __getitem__(self, name: str, /) -> object: ...


@dataclass(frozen=True, eq=False)
class Recording:
    """What one robot did and measured.

    Attributes:
        episodes: by id.
        robot: label or None.
        source: where the data come from, or None.
        file: the file it was read from, for messages and for names of held-out
            episodes; not stored.
    """

    episodes: Mapping[str, Episode]
    robot: str | None = None
    source: str | None = None
    file: str = "recording"

    @classmethod
    def from_arrays(
        cls,
        time: ArrayLike,
        ctrl: Mapping[str, ArrayLike],
        signals: Mapping[str, Mapping[str, ArrayLike]],
        *,
        model: str | os.PathLike[str] | None = None,
        **more: Unpack[EpisodeDetails],
    ) -> "Recording":
        """Make a recording of one episode of arrays, and check it.

        Args:
            time: (T) [s] strictly increasing.
            ctrl: command (T) by name of the actuator, in the actuator's own unit. One
                with several controls has one for each, by `controls.Control.full_name`.
            signals: (T), or (T, d) of a vector, by kind of `KINDS` and by name of
                the joint, actuator, body or sensor; NaN where a sample is missing.
            model: MJCF or URDF that the names are checked against, and which states
                the units; without, joints are hinges (rad, rad/s, N m).
            **more: `episode` (its id), `qpos0` (nq), `qvel0` (nv), `motion`, `robot`,
                `source`: see `Episode` and `Recording`.

        Raises:
            RecordingError: it breaks the contract; says where and what would fit.
            InputError: an array that holds no numbers, or a name that is none.
        """
        if unknown := more.keys() - EpisodeDetails.__annotations__.keys():
            raise TypeError(f"unexpected keywords: {', '.join(sorted(unknown))}")
        names = None if model is None else read_names(model)
        stamps = _to_floats("time", time)
        commands = _stack_commands(ctrl, stamps.shape)
        found = dict[str, Signal]()
        for kind, table in signals.items():
            if kind not in KINDS:
                raise UnknownNameError("kind of signal", kind, KINDS)
            for target, values in table.items():
                array = _to_floats(f"{kind} of {target!r}", values)
                unit = _find_unit(kind, target, names)
                name = name_signal(kind, target, found)
                found[name] = Signal(array, kind, target, unit)
        episode = Episode(
            stamps,
            commands,
            tuple(ctrl),
            found,
            qpos0=_to_state("qpos0", more.get("qpos0")),
            qvel0=_to_state("qvel0", more.get("qvel0")),
            motion=more.get("motion"),
        )
        episodes = {more.get("episode", "000"): episode}
        recording = cls(episodes, more.get("robot"), more.get("source"))
        validate(recording)
        if names is not None:
            check_against_model(recording, names)
        return recording

    @classmethod
    def from_dataframe(
        cls,
        frame: DataFrame,
        time: str,
        ctrl: Mapping[str, str],
        signals: Mapping[str, Mapping[str, str | Sequence[str]]],
        *,
        model: str | os.PathLike[str] | None = None,
        **more: Unpack[EpisodeDetails],
    ) -> "Recording":
        """Make a recording of one episode of a table, and check it.

        Args:
            frame: pandas or polars data frame.
            time: name of the column of times [s].
            ctrl: name of a column by actuator, or control, as `from_arrays` has it.
            signals: name of a column, or a list of names for a vector, by kind and
                target.
            model: as `from_arrays` takes it.
            **more: likewise.

        Raises:
            RecordingError: it breaks the contract.
            InputError: the table does not have a column, or one holds no numbers.
        """
        columns = [str(name) for name in frame.columns]

        def take(name: str | Sequence[str]) -> ArrayLike:
            if not isinstance(name, str):
                return np.stack([np.asarray(take(part)) for part in name], axis=1)
            if name not in columns:
                raise UnknownNameError("column", name, columns)
            return np.asarray(frame[name])

        return cls.from_arrays(
            take(time),
            {actuator: take(name) for actuator, name in ctrl.items()},
            {k: {t: take(n) for t, n in table.items()} for k, table in signals.items()},
            model=model,
            **more,
        )

    def write(self, path: str | os.PathLike[str]) -> None:
        """Check this recording and write it, whole or not at all.

        Raises:
            RecordingError: it breaks the contract; nothing is written.
            InputError: nothing can be written there.
        """
        write(self, path)

    def to_dataframe(self) -> "pandas.DataFrame":
        """All samples as a data frame of pandas, NaN where one is missing.

        Columns are `episode`, `time`, `ctrl/NAME` and `signals/NAME`, or of a vector
        `signals/NAME[k]`.

        Raises:
            InputError: pandas is not installed.
        """
        import_extra("pandas", "pandas", "a data frame")
        return build_table(self).to_pandas()

    def plot(
        self,
        signals: str | Sequence[str] | None = None,
        *,
        episode: str | None = None,
        ax: "Axes | None" = None,
    ) -> "Axes":
        """Draw signals of an episode over time.

        Args:
            signals: names; None draws all of the first one's unit.

        Raises:
            UnknownNameError: there is no such episode or signal.
        """
        id = next(iter(self.episodes), "") if episode is None else episode
        if id not in self.episodes:
            raise UnknownNameError("episode", id, self.episodes)
        shown = self.episodes[id]
        names = [signals] if isinstance(signals, str) else signals
        if names is None:
            units = [signal.unit for signal in shown.signals.values()]
            names = [n for n, s in shown.signals.items() if s.unit == units[0]]
        for name in names:
            if name not in shown.signals:
                raise UnknownNameError("signal", name, shown.signals)
        wanted = replace(shown, signals={name: shown.signals[name] for name in names})
        ax = open_axes(ax)
        for column, (values, unit) in list_signals(wanted).items():
            read = np.isfinite(values)
            label = f"{column.partition('/')[2]} [{unit}]"
            ax.plot(shown.time[read], values[read], label=label)
        ax.set_xlabel("time [s]")
        ax.set_title(f"episode {id}")
        ax.legend()
        return ax

    def __repr__(self) -> str:
        return f"<{make_printable(self._describe())}>"

    def _repr_html_(self) -> str:
        return format_columns(self._describe(), self._list_signals())

    def _describe(self) -> str:
        """What it is, in a line."""
        episodes = self.episodes.values()
        seconds = sum(np.ptp(e.time) for e in episodes if e.time.size)
        signals = {
            (name, s.kind, s.target, s.unit)
            for e in episodes
            for name, s in e.signals.items()
        }
        robot = f" of {self.robot}" if self.robot else ""
        return (
            f"Recording{robot}, {seconds:.1f} s; episodes: {len(self.episodes)}, "
            f"signals: {len(signals)}"
        )

    def _list_signals(self) -> Columns:
        """What it measures: a row for each signal of any episode."""
        found = dict[tuple[str, ...], list[float]]()
        for episode in self.episodes.values():
            for name, s in episode.signals.items():
                missing = found.setdefault((name, s.kind, s.target, s.unit), [])
                missing.append(float(np.isnan(s.values).mean()) if s.values.size else 0)
        rows = [(*what, len(m), f"{sum(m) / len(m):.1%}") for what, m in found.items()]
        head = ("signal", "kind", "target", "unit", "episodes", "missing")
        return {name: [row[k] for row in rows] for k, name in enumerate(head)}


def _stack_commands(ctrl: Mapping[str, ArrayLike], shape: tuple[int, ...]) -> Floats:
    """Commands by actuator as one array (T, nu), each of a shape (T)."""
    columns = [_to_floats(f"ctrl of {name!r}", ctrl[name]) for name in ctrl]
    for name, column in zip(ctrl, columns, strict=True):
        if column.shape != shape:
            raise InputError(
                f"ctrl of {name!r} has shape {column.shape}; would fit: {shape}"
            )
    return np.stack(columns, axis=1) if columns else np.empty((*shape[:1], 0))


def _find_unit(kind: str, target: str, names: ModelNames | None) -> str:
    """The unit of a signal: the model's where it says one."""
    known = names.targets[KINDS[kind].target].get(target) if names else None
    stated = known.units.get(kind) if known else None
    return stated or (*KINDS[kind].units, "1")[0]


def _to_state(what: str, values: ArrayLike | None) -> Floats | None:
    return None if values is None else _to_floats(what, values)


def _to_floats(what: str, values: ArrayLike) -> Floats:
    """An array (...) of float64."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} is no array of numbers: {error}") from error
