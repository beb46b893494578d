"""What checks know of a log: a recording and its model in, what follows from them out.

Each is computed once, when the first check asks for it.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..recording import Recording
from ..recording.data import Floats
from .balance import TorqueBalance
from .comparisons import (
    Comparison,
    Disagreement,
    compare_commands,
    compare_velocities,
    find_disagreements,
)
from .fault import Fault
from .hypotheses import Hypothesis, find_best, list_hypotheses
from .joints import JointColumns, list_joints, list_signals
from .residuals import Explainer
from .rollouts import Rollouts
from .series import Series, build_series
from .states import ColumnMap, States

if TYPE_CHECKING:
    import mujoco

# share of a joint's torques, or of others, that a wrong column may leave once it is
# corrected; chosen: concealed physics leaves a twelfth at most
MAX_LEFT = 0.1
MAX_FAULTS = 4  # that one explainer may find, one after the other; chosen


# kinds of signals that sensors read of a motion
READ = ("joint_position", "joint_velocity", "body_position", "body_orientation",
        "body_linear_velocity", "body_angular_velocity", "sensor")  # fmt: skip


class Context:
    """A recording, its model, and what was found so far.

    Attributes:
        recording: of the robot; checks of `READINGS` may correct it.
        model: of the robot.
        frozen: columns that are, of which no other fault is reported.
        faults: that were found.
        column_map: how columns are read otherwise, by these faults.
    """

    def __init__(
        self,
        recording: Recording,
        model: "mujoco.MjModel",
        frozen: Collection[str] = (),
    ) -> None:
        """Begin without faults.

        Args:
            recording: of the robot; its commands are those of the model's controls.
        """
        self.recording, self.model, self.frozen = recording, model, frozenset(frozen)
        self.faults: list[Fault] = []
        self.column_map = ColumnMap()

    @cached_property
    def joints(self) -> dict[str, JointColumns]:
        """Hinges and slides by name, with their columns."""
        return list_joints(self.recording, self.model)

    @cached_property
    def signals(self) -> dict[tuple[str, str], str]:
        """The first signal of each kind and target."""
        return list_signals(self.recording)

    @cached_property
    def series(self) -> Series:
        """All columns on one grid, smoothed."""
        return build_series(self.recording)

    @cached_property
    def states(self) -> States:
        """Positions and their rates."""
        return States(self.recording, self.model, self.joints, self.series)

    @cached_property
    def balance(self) -> TorqueBalance:
        """The balance of torques."""
        return TorqueBalance(self.states)

    @cached_property
    def rollouts(self) -> Rollouts:
        """Short simulations."""
        return Rollouts(self.states)

    @cached_property
    def comparisons(self) -> dict[str, Comparison]:
        """Of positions with what should be alike: "velocity" and "command"."""
        by_velocity = compare_velocities(self.recording, self.joints, self.series)
        by_command = compare_commands(self.joints, self.series)
        return {c.what: c for c in (by_velocity, by_command)}

    @cached_property
    def disagreements(self) -> list[Disagreement]:
        """What these contradict; a servo that torques show to be weak is not late."""
        found = [d for c in self.comparisons.values() for d in find_disagreements(c)]
        return [
            d for d in found
            if d.what == "velocity" or d.kind != "delay"
            or not self.is_balanced(d.joint)
        ]  # fmt: skip

    @property
    def episodes(self) -> tuple[str, ...]:
        """Ids of all episodes."""
        return tuple(self.recording.episodes)

    @property
    def is_late(self) -> bool:
        """Whether columns are of different times, so that torques cannot balance."""
        is_late = any(d.kind == "delay" for d in self.disagreements)
        return is_late or any(f.kind == "clock_drift" for f in self.faults)

    def is_balanced(self, joint: str) -> bool:
        """Whether the torques of a joint balance, as its columns are read so far."""
        left = self.balance.measure_share(self.column_map, joint)
        return left is not None and left < MAX_LEFT

    def read(self, signal: str) -> Floats:
        """Readings (n, ...) of a signal in all episodes that have it [its unit]."""
        return np.concatenate([
            e.signals[signal].values for e in self.recording.episodes.values()
            if signal in e.signals
        ])  # fmt: skip

    def list_columns(
        self, kinds: Collection[str], least: int, measure: Callable[[Floats], Floats]
    ) -> Iterator[tuple[str, str, Floats, Floats]]:
        """The liveliest column of each signal in each episode.

        Args:
            measure: how lively (d) columns (n, d) are.

        Yields:
            Episode, signal, times (n) [s] and readings (n) [unit].
        """
        for episode, e in self.recording.episodes.items():
            for name, signal in e.signals.items():
                values = signal.values.reshape(e.time.size, -1)
                read = np.isfinite(values).all(axis=1)
                if signal.kind in kinds and read.sum() >= least:
                    column = int(np.argmax(measure(values[read])))
                    yield episode, name, e.time[read], values[read, column]

    def search(
        self, explainer: Explainer, names: Sequence[str], limits: tuple[float, float],
        basis: str, what: str,
    ) -> list[Fault]:  # fmt: skip
        """Faults of columns whose correction explains the motion far better.

        Args:
            limits: shares that are left, see `find_best`.
        """
        found: list[Fault] = []
        for _ in range(MAX_FAULTS):
            free = [n for n in names if n not in self.column_map.positions]
            options = list(list_hypotheses(self.joints, free))
            best = find_best(explainer, self.column_map, options, limits)
            if best is None:
                break
            one, others = best
            measured = (
                f"then {what} to {100 * one.left:.2g} %, as the log is to "
                f"{100 * one.given:.2g} %, {one.gain:.1f} nats a row"
            )
            found.append(make_fault(
                one.best, others, measured, one.p_value, basis, self.series.episodes
            ))  # fmt: skip
            self.column_map |= one.best.column_map
        return found


def make_fault(
    best: Hypothesis, others: Sequence[Hypothesis], measured: str, p_value: float,
    basis: str, episodes: tuple[str, ...],
) -> Fault:  # fmt: skip
    """The fault of a hypothesis, and what the data do not distinguish from it.

    Args:
        p_value: of it [1].
    """
    unclear = "".join(
        f"; or {o.text}, which these data do not distinguish" for o in others
    )
    return Fault(
        best.kind, episodes, best.columns, best.target,
        f"{best.text} ({measured}){unclear}", p_value, basis, best.corrections,
        tuple(c for o in others for c in o.columns),
    )  # fmt: skip
