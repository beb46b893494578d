"""Runs on disk: everything a self-modeling run knows, to look at or to go on with.

RUN.h5: attributes format="selfheal-run", version=3, settings, counts and result as
JSON; groups `anatomy`, `truth` (if the robot knows it), `cycles/<k>`, `state`.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from ..body.body import Anatomy, Bodies, Floats, Ints
from ..body.genome import Genomes
from ..files import atomic_hdf5
from ..notebook import Columns, format_columns, make_frame, open_axes
from ..printable import make_printable

if TYPE_CHECKING:
    from _typeshed import DataclassInstance
    from h5py import Group
    from matplotlib.axes import Axes
    from pandas import DataFrame

FORMAT, VERSION = "selfheal-run", 3


@dataclass(frozen=True)
class Settings:
    """What a run does.

    Attributes:
        recordings: path of the recording that it answers from, "" if none.
        method: "default", "paper", "disagreement", "random-batch" or
            "random-alternate".
        space: "free", "sides" or "full".
        known_lengths: whether "full" takes lengths as known.
        random_actions: whether the default method leaves its choice to chance.
        engine: "auto", "statics", "mjx" or "mujoco".
        budget: simulations for the search.
        moves: short moves over time that the dynamics are identified from in the end.
    """

    robot: str
    recordings: str = ""
    method: str = "default"
    space: str = "free"
    known_lengths: bool = False
    random_actions: bool = False
    engine: str = "auto"
    cycles: int = 16  # papers.md 1.4
    budget: int = 262_000
    seed: int = 0
    moves: int = 0


def suits_mjx(anatomy: Anatomy) -> bool:
    """Whether MJX knows such a robot: on a floor, parts straight and in order."""
    return anatomy.ordered and not (anatomy.fixed or any(anatomy.bends))


def uses_second_engine(settings: Settings, anatomy: Anatomy) -> bool:
    """Whether rivals are confirmed by MJX."""
    is_ours = settings.engine == "auto" and settings.method == "default"
    return is_ours and suits_mjx(anatomy)


@dataclass(frozen=True)
class Cycle:
    """One turn of the loop: an action, what it measured, what is believed since.

    Attributes:
        action: index into the robot's actions.
        felt: (C) measured channels, see `engine.channels`; NaN where a sensor gave
            nothing.
        genomes: (K) the rivals, best first.
        tables: (K, A, C) their channels under every action; NaN where not simulated.
        losses: (K) over the actions so far.
        sureness: (P) stated probability that each attachment is right.
        tilt_error: of the best rival, |left/right| + |forward/back|, mean over the
            actions so far [deg]. Without tilts it is that of all channels, as in the
            loss.
        disagreement: among the bodies that might be right, about the untried actions:
            mean standard deviation of their tilts [deg], each counted as far as it is
            believed. Without tilts it is that of all channels, as in the loss.
        spent: simulations for the search since the start.
        seconds: time since the start, interruptions left out [s].
    """

    action: int
    why: str
    felt: Floats
    genomes: Genomes
    tables: Floats
    losses: Floats
    sureness: Floats
    tilt_error: float
    disagreement: float
    spent: int
    seconds: float


@dataclass(frozen=True)
class Run:
    """A run, finished or not.

    Attributes:
        actions: (A, P) joint targets that the robot can try [rad].
        truth: the hidden body (batch of one), None if nobody knows it.
        counts: simulations by engine, "choice" (spent on choosing), "failed".
        state: arrays and JSON texts that the search goes on from.
        result: what `identify --json` prints, empty until the run is done.
        indistinguishable: (M, P) parents of the other bodies that might be right and
            that no action tells from the best one; none until the run is done.
    """

    settings: Settings
    anatomy: Anatomy
    actions: Floats
    cycles: tuple[Cycle, ...] = ()
    truth: Bodies | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    state: Mapping[str, np.ndarray | str] = field(default_factory=dict)
    result: Mapping[str, Any] = field(default_factory=dict)
    indistinguishable: Ints = field(default_factory=lambda: np.empty((0, 0), np.int64))

    @property
    def indistinguishable_trees(self) -> int:
        """How many trees other than the best one `indistinguishable` has."""
        best = self.cycles[-1].genomes.parent[0]
        if not len(self.indistinguishable):
            return 0
        other = (self.indistinguishable != best).any(axis=1)
        return len(np.unique(self.indistinguishable[other], axis=0))

    def to_dataframe(self) -> "DataFrame":
        """The best body as a data frame of pandas, a row for each part.

        Raises:
            InputError: pandas is not installed.
        """
        return make_frame(self._list_parts())

    def plot(self, *, ax: "Axes | None" = None) -> "Axes":
        """Draw the best body's error over the cycles.

        Args:
            ax: to draw on; None makes a figure of matplotlib's pyplot.
        """
        ax = open_axes(ax)
        errors = [cycle.tilt_error for cycle in self.cycles]
        ax.plot(range(1, len(errors) + 1), errors, marker="o")
        ax.set_xlabel("cycle")
        ax.set_ylabel("tilt error [deg]")
        return ax

    def __repr__(self) -> str:
        return f"<{make_printable(self._describe())}>"

    def _repr_html_(self) -> str:
        return format_columns(self._describe(), self._list_parts())

    def _describe(self) -> str:
        """What it is, in a line."""
        last = self.cycles[-1:]
        error = "".join(f", tilt error {c.tilt_error:.2f} deg" for c in last)
        return (
            f"Run of {self.settings.robot}: {len(self.cycles)} of "
            f"{self.settings.cycles} cycles{error}"
        )

    def _list_parts(self) -> Columns:
        """A row for each part of the best body; none before the first cycle."""
        if not self.cycles:
            return {name: () for name in ("part", "hangs on", "length [m]", "sureness")}
        names, cycle = ("torso", *self.anatomy.parts), self.cycles[-1]
        return {
            "part": self.anatomy.parts,
            "hangs on": [names[k] for k in cycle.genomes.parent[0]],
            "length [m]": cycle.genomes.length[0].tolist(),
            "sureness": cycle.sureness.tolist(),
        }


def save_run(run: Run, path: str | os.PathLike[str]) -> None:
    """Write a run whole or not at all.

    Raises:
        InputError: nothing can be written there.
    """
    with atomic_hdf5(path) as file:
        file.attrs.update(format=FORMAT, version=VERSION)
        file.attrs["settings"] = json.dumps(asdict(run.settings))
        file.attrs["counts"] = json.dumps(dict(run.counts))
        file.attrs["result"] = json.dumps(dict(run.result))
        file["actions"], file["alike"] = run.actions, run.indistinguishable
        _write_dataclass(file.create_group("anatomy"), run.anatomy)
        if run.truth is not None:
            _write_dataclass(file.create_group("truth"), run.truth, "anatomy")
        for k, cycle in enumerate(run.cycles):
            group = file.create_group(f"cycles/{k:03d}")
            _write_dataclass(group, cycle, "genomes")
            _write_dataclass(group.create_group("genomes"), cycle.genomes)
        state = file.create_group("state")
        for name, value in run.state.items():
            state[name] = value


def _write_dataclass(group: "Group", data: "DataclassInstance", *skip: str) -> None:
    """A dataclass of arrays, numbers and texts as a group."""
    for f in fields(data):
        if f.name not in skip:
            value = getattr(data, f.name)
            is_json = isinstance(value, (tuple, bool))
            group[f.name] = json.dumps(value) if is_json else value
