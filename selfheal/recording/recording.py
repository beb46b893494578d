"""What one robot did and felt: made of files, of arrays or of tables; checked."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, UnknownNameError
from ..extras import import_extra
from ..notebook import Columns, format_columns, open_axes
from ..printable import make_printable
from .check import validate
from .data import KINDS, Episode, Signal, name_signal
from .model import ModelNames, check_against_model
from .names import read_names
from .table import build_table, list_signals
from .writing import write

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# targets by kind, what is measured of each
Table = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class Recording:
    """What one robot did and felt.

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
        time: Any,
        ctrl: Mapping[str, Any],
        signals: Mapping[str, Mapping[str, Any]],
        *,
        model: str | os.PathLike[str] | None = None,
        **more: Any,
    ) -> "Recording":
        """Make a recording of one episode of arrays, and check it.

        Args:
            time: (T) [s] strictly increasing.
            ctrl: command (T) by name of the actuator, in the actuator's own unit. One
                with several controls has one for each, by `controls.Control.full_name`.
            signals: (T), or (T, d) of a vector, by kind of `KINDS` and by name of
                the joint, actuator, body or sensor; NaN where a sample is missing.
            model: MJCF or URDF that the names are checked against; it tells slides
                (m, m/s, N) from hinges (rad, rad/s, N m), which are assumed without.
            **more: `episode` (its id), `qpos0` (nq), `qvel0` (nv), `motion`, `robot`,
                `source`: see `Episode` and `Recording`.

        Raises:
            RecordingError: it breaks the contract; says where and what would fit.
            InputError: an array that holds no numbers, or a name that is none.
        """
        names = None if model is None else read_names(model)
        return _build_recording(time, ctrl, signals, names=names, **more)

    @classmethod
    def from_dataframe(
        cls,
        frame: Any,
        time: str,
        ctrl: Mapping[str, str],
        signals: Mapping[str, Mapping[str, Any]],
        **more: Any,
    ) -> "Recording":
        """Make a recording of one episode of a table, and check it.

        Args:
            frame: pandas or polars data frame.
            time: name of the column of times [s].
            ctrl: name of a column by actuator, or control, as `from_arrays` has it.
            signals: name of a column, or a list of names for a vector, by kind and
                target.
            **more: as `from_arrays` takes it.

        Raises:
            RecordingError: it breaks the contract.
            InputError: the table lacks a column, or one holds no numbers.
        """
        return cls.from_arrays(*_read_table(frame, time, ctrl, signals), **more)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Check this recording and write it, whole or not at all.

        Raises:
            RecordingError: it breaks the contract; nothing is written.
            InputError: nothing can be written there.
        """
        write(self, path)

    def to_dataframe(self) -> Any:
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
            episode: its id; None takes the first one.
            ax: to draw on; None makes a figure of matplotlib's pyplot.

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


def _build_recording(
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
    held = _stack_commands(ctrl, stamps.shape)
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


def _stack_commands(ctrl: Mapping[str, Any], shape: tuple[int, ...]) -> np.ndarray:
    """Commands by actuator as one array (T, nu), each of a shape (T)."""
    columns = [_to_floats(f"ctrl of {name!r}", ctrl[name]) for name in ctrl]
    for name, column in zip(ctrl, columns, strict=True):
        if column.shape != shape:
            raise InputError(
                f"ctrl of {name!r} has shape {column.shape}; would fit: {shape}"
            )
    return np.stack(columns, axis=1) if columns else np.empty((*shape[:1], 0))


def _read_table(
    frame: Any, time: str, ctrl: Mapping[str, str], signals: Table
) -> tuple[Any, dict[str, Any], dict[str, dict[str, Any]]]:
    """Arrays of a table's columns, as `build_recording` takes them.

    Args:
        frame: pandas or polars data frame, or anything that gives a column by name.
        time: name of the column of times [s].
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
