"""What checks know of a log: a recording and its model in, what follows from them out.

Each is computed once, when a check first needs it.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..recording import Recording
from ..recording.data import Floats
from .balance import BALANCED, TorqueBalance
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

# kinds of signals that sensors read of a motion
READ = (
    *("joint_position", "joint_velocity", "body_position", "body_orientation"),
    *("body_linear_velocity", "body_angular_velocity", "sensor"),
)
MAX_FAULTS = 4  # that one explainer may find, one after the other; chosen


class Context:
    """A recording, its model, and what was found so far.

    Attributes:
        recording: checks of `READINGS` may correct it.
        frozen: columns that are, of which no other fault is reported.
        column_map: how columns are read otherwise, by these faults.
    """

    def __init__(
        self,
        recording: Recording,
        model: "mujoco.MjModel",
        frozen: Collection[str] = (),
    ) -> None:
        """Begin without faults; commands are those of the model's controls."""
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
        return [d for d in found if not (d.is_late_servo and self.is_balanced(d.joint))]

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
        return left is not None and left < BALANCED

    def read(self, signal: str) -> dict[str, tuple[Floats, Floats]]:
        """Times (T) [s] and readings (T) [its unit] of a signal by episode."""
        return {
            k: (e.time, e.signals[signal].values.reshape(e.time.size))
            for k, e in self.recording.episodes.items()
            if signal in e.signals
        }

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

    def search(self, explainer: Explainer, names: Sequence[str]) -> Iterator[Fault]:
        """Faults of columns whose correction explains the motion far better."""
        for _ in range(MAX_FAULTS):
            free = [n for n in names if n not in self.column_map.positions]
            options = list(list_hypotheses(self.joints, free))
            best = find_best(explainer, self.column_map, options)
            if best is None:
                break
            one, others = best
            measured = (
                f"then {explainer.says} to {100 * one.left:.2g} %, as the log is to "
                f"{100 * one.given:.2g} %, {one.gain:.1f} nats a row"
            )
            self.column_map |= one.best.column_map
            test = one.p_value, explainer.basis
            yield make_fault(one.best, others, measured, test, self.series.episodes)


def make_fault(
    best: Hypothesis,
    others: Sequence[Hypothesis],
    measured: str,
    test: tuple[float, str],
    episodes: tuple[str, ...],
) -> Fault:
    """The fault of a hypothesis, and what the data do not distinguish from it.

    Args:
        test: the p-value [1], and of which test.
    """
    unclear = "".join(
        f"; or {o.text}, which these data do not distinguish" for o in others
    )
    seen = f"{best.text} ({measured}){unclear}"
    rivals = tuple(c for o in others for c in o.columns)
    found = Fault(best.kind, episodes, best.columns, best.target, seen, *test)
    return replace(found, corrections=best.corrections, alternatives=rivals)
