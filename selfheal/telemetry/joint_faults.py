"""Which column of a joint is at fault: takes disagreements, gives faults with mends."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..recording import Recording
from .aborted import find_aborted
from .balance import TorqueBalance
from .disagreements import (
    MAX_COMMAND_LAG,
    MAX_VELOCITY_LAG,
    MOVES,
    SEARCHED_LAG,
    WEAKEST_SERVO,
    Comparison,
    Disagreement,
    find_disagreements,
)
from .drift import find_drift
from .fault import SKIP, ColumnCorrection, Fault, format_columns
from .joints import JointColumns, slide_joint_type
from .odd import find_odd_columns, find_odd_zeros
from .pairs import UNIT_RATIO, list_units
from .ranges import INNER, list_fitting
from .rollouts import Rollouts
from .search import (
    CLEARLY,
    MAX_P_VALUE,
    Candidate,
    Explainer,
    find_best,
    list_candidates,
    make_candidate,
)
from .series import Series
from .states import Mend

if TYPE_CHECKING:
    import mujoco

MAX_FAULTS = (
    4  # that the balance of torques alone may tell, one after the other; chosen
)
# share that a mend may leave of the torques, and that the log as it is must leave;
# chosen: concealed physics leaves a twelfth at most
MAX_LEFT, MIN_LEFT = 0.1, 0.015
# the same of simulations; chosen: a log that is right misses less than no prediction
MAX_MISSED, MIN_MISSED = 0.5, 1.0
BASES = {
    "command": "correlation of the joint with its command, Fisher's z",
    "velocity": "correlation of velocity and derived position, Fisher's z",
    "torque": "Wilcoxon's signed-rank test of the balance of torques, block by block, "
    "times the number of mends tried",
    "rollout": "Wilcoxon's signed-rank test of simulations of a tenth of a second, "
    "block by block, times the number of mends tried",
}


class JointCheck:
    """The faults of columns about joints."""

    def __init__(
        self, recording: Recording, model: "mujoco.MjModel",
        joints: Sequence[JointColumns], series: Series,
    ) -> None:  # fmt: skip
        """Compare the columns.

        Args:
            recording: of the robot.
            model: of it.
            joints: with their columns.
            series: of the recording.
        """
        self.joints = {j.name: j for j in joints}
        self.series = series
        self.balance = TorqueBalance(recording, model, joints, series)
        pairs = self._pair_velocities(recording), self._pair_commands()
        self.with_velocity, self.with_command = (
            find_disagreements(pair, series) for pair in pairs
        )
        self.mend = Mend()
        self.with_command = [
            d for d in self.with_command
            if d.kind != "delay" or not self._is_balanced(d.joint)
        ]  # fmt: skip
        told = (("velocity", pairs[0], self.with_velocity),
                ("command", pairs[1], self.with_command))  # fmt: skip
        self.drifts = [
            fault
            for what, pair, _ in told
            for fault in find_drift(pair, joints, series, what)
        ]
        self.odd = [
            fault
            for what, pair, found in told
            for fault in find_odd_columns(pair, found, self.joints, series, what)
        ]
        self.odd = find_aborted(pairs[1], self.joints, series) or self.odd
        if self.balance.reason:  # else torques tell a zero from a load
            self.odd = self.odd or find_odd_zeros(pairs[1], self.joints, series)

    def _is_balanced(self, joint: str) -> bool:
        """Whether a weak servo explains that a joint is late: its torques balance."""
        dof = self.balance.given.jnt_dofadr[self.joints[joint].number]
        if self.balance.reason or dof not in self.balance.dofs:
            return False
        left = self.balance.evaluate(self.mend).unexplained
        return bool(left[self.balance.dofs == dof][0] < MAX_LEFT)

    def _pair_velocities(self, recording: Recording) -> Comparison:
        both = [j for j in self.joints.values() if j.position and j.velocity]
        step = self.series.step
        rows = round(SEARCHED_LAG / step)
        return Comparison(
            {j.name: self.series.signals[j.position][:, 0, 1] for j in both},
            {j.name: self.series.signals[j.velocity][:, 0, 0] for j in both},
            (-rows, rows), round(MAX_VELOCITY_LAG / step), 1.0,
            frozenset(j.name for j in both if _moves(recording, j.position)),
        )  # fmt: skip

    def _pair_commands(self) -> Comparison:
        """Positions against what position servos are sent."""
        led = [j for j in self.joints.values() if j.position and j.servo]
        step = self.series.step
        first = {}
        for j in led:
            servo = j.servo
            assert servo is not None
            first[j.name] = self.series.ctrl[servo.command][:, 0] * servo.scale
        return Comparison(
            first,
            {j.name: self.series.signals[j.position][:, 0, 0] for j in led},
            (0, round(SEARCHED_LAG / step)),
            round(MAX_COMMAND_LAG / step), WEAKEST_SERVO,
        )  # fmt: skip

    def find_faults(self) -> list[Fault]:
        """Faults of columns that contradict each other."""
        by_joint: dict[tuple[str, str, str], dict[str, Disagreement]] = {}
        drifting = {c for f in self.drifts for c in f.columns}
        for what, every in (
            ("velocity", self.with_velocity), ("command", self.with_command),
        ):  # fmt: skip
            for one in every:
                if one.kind in ("delay", "derivative") and drifting & {
                    *self.joints[one.joint].columns
                }:
                    continue
                by_joint.setdefault((one.kind, one.joint, one.partner), {})[what] = one
        found = list(self.drifts)
        late_last = sorted(by_joint.items(), key=lambda item: item[0][0] == "delay")
        for (kind, joint, partner), seen in late_last:
            if kind in ("sign", "unit", "exchange"):
                found.append(self._locate(kind, joint, partner, seen))
            elif kind == "delay":
                found += [
                    self._tell_delay(what, one) for what, one in seen.items()
                    if what == "velocity" or not self._is_balanced(joint)
                ]  # fmt: skip
            elif "velocity" in seen:
                found.append(self._tell_derivative(seen["velocity"]))
        return found

    def _locate(
        self, kind: str, joint: str, partner: str, seen: dict[str, Disagreement]
    ) -> Fault:
        """The column that is at fault, of those that contradict each other.

        Args:
            kind: "sign", "unit" or "exchange".
            joint: name.
            partner: the other joint of an exchange; else "".
            seen: "velocity" and "command": what contradicts the position.
        """
        options = self._list_options(kind, joint, partner, seen)
        best, others = self._choose(options)
        self.mend = self.mend.then(best.mend)
        what = "command" if "command" in seen else "velocity"
        one = seen[what]
        r, ratio = one.relation.r, one.relation.ratio
        measured = {
            "sign": f"correlation {r:.3f}",
            "unit": f"{abs(ratio):.4g} times as large, correlation {abs(r):.3f}",
            "exchange": f"correlation {r:.3f} across, low within each",
        }[kind]
        pair = {
            "command": f"joint {joint!r} and its command",
            "velocity": f"the velocity and the position of joint {joint!r}",
        }[what]
        return self._make_fault(
            best, others, f"{pair}: {measured}", one.p_value, BASES[what], one.episodes
        )

    def _list_options(
        self, kind: str, joint: str, partner: str, seen: dict[str, Disagreement]
    ) -> list[Candidate]:
        """What could explain a disagreement, the usual one first."""
        j = self.joints[joint]
        ratio = next(iter(seen.values())).relation.ratio
        # a velocity that is too large, and a position that is too small, look alike
        if len(seen) == 2:
            ratio = self._round_unit(j, seen["command"].relation.ratio)
            return [
                make_candidate(self.joints, kind, joint, partner, ("position",), ratio)
            ]
        if "command" in seen:
            parts = ("position", "velocity") if j.velocity else ("position",)
            ratio = self._round_unit(j, ratio)
            return [
                make_candidate(self.joints, kind, joint, partner, parts, ratio),
                make_candidate(
                    self.joints, kind, joint, partner, ("command",), 1 / ratio
                ),
            ]
        velocity = make_candidate(
            self.joints, kind, joint, partner, ("velocity",), ratio
        )
        if j.servo:  # the position agrees with its command
            return [velocity]
        return [
            velocity,
            make_candidate(self.joints, kind, joint, partner, ("position",), 1 / ratio),
        ]

    def _round_unit(self, joint: JointColumns, ratio: float) -> float:
        """The ratio of the one unit in which readings are within the joint's range.

        Of those that a weak or strong servo could make of `ratio`; else `ratio`.

        Args:
            joint: that is read.
            ratio: of the position to what is commanded.
        """
        slide = self.balance.given.jnt_type[joint.number] == slide_joint_type()
        read = self.series.signals[joint.position][:, 0, 0]
        low, high = (float(x) for x in np.nanquantile(read, [1 - INNER, INNER]))
        units, names = list_units(joint.span), list[str]()
        if joint.range:
            names = list_fitting(joint, low, high, "m" if slide else "rad")
        near = [
            units[n] for n in names
            if abs(np.log(abs(ratio) / units[n])) < np.log(UNIT_RATIO)
        ]  # fmt: skip
        return float(np.sign(ratio)) * near[0] if len(near) == 1 else ratio

    def _choose(
        self, options: Sequence[Candidate]
    ) -> tuple[Candidate, list[Candidate]]:
        """The option that balances the torques best, and those as good."""
        if len(options) == 1 or self.balance.reason:
            return options[0], list(options[1:])
        tried = [self.balance.evaluate(self.mend.then(o.mend)) for o in options]
        best = 0
        for k in range(1, len(options)):
            gain, p = tried[k].gain_over(tried[best])
            if gain > CLEARLY and p < MAX_P_VALUE:
                best = k
        equal = [
            o
            for k, o in enumerate(options)
            if k != best and tried[best].gain_over(tried[k])[0] < CLEARLY
        ]
        return options[best], equal

    @property
    def is_late(self) -> bool:
        """Whether columns are of different times, so that torques cannot balance."""
        late = [d.kind for d in (*self.with_velocity, *self.with_command)]
        return bool(self.drifts) or "delay" in late

    def search(self) -> list[Fault]:
        """Faults that only the balance of torques tells, the plainest one first."""
        if self.balance.reason or self.is_late:
            return []
        names = list(self.joints)
        return self._search(self.balance, names, MIN_LEFT, MAX_LEFT, BASES["torque"],
                            "torques are balanced")  # fmt: skip

    def search_rollouts(self, rollouts: Rollouts) -> list[Fault]:
        """Faults that only simulations tell: of joints in lasting contact.

        Args:
            rollouts: of the recording.
        """
        if not self.balance.reason or rollouts.reason or self.is_late:
            return []
        # a servo's command tells of its joint what there is to tell
        names = [j.name for j in self.joints.values() if not j.servo]
        return self._search(rollouts, names, MIN_MISSED, MAX_MISSED, BASES["rollout"],
                            "simulations are right")  # fmt: skip

    def _search(
        self, explainer: Explainer, names: Sequence[str], min_left: float,
        max_left: float, basis: str, what: str,
    ) -> list[Fault]:  # fmt: skip
        """Faults of which a mend explains the motion far better.

        Args:
            explainer: of the motion.
            names: of joints.
            min_left, max_left: shares of `find_best`.
            basis: of the p-value.
            what: is then explained.
        """
        found: list[Fault] = []
        for _ in range(MAX_FAULTS):
            free = [n for n in names if n not in self.mend.positions]
            options = list_candidates(self.joints, free)
            one = find_best(explainer, self.mend, options, min_left, max_left)
            if one is None:
                break
            measured = (
                f"then {what} to {100 * one.left:.2g} %, as the log is to "
                f"{100 * one.given:.2g} %, {one.gain:.1f} nats a row"
            )
            found.append(self._make_fault(
                one.best, one.others, measured, one.p_value, basis,
                self.series.episodes,
            ))  # fmt: skip
            self.mend = self.mend.then(one.best.mend)
        return found

    def _make_fault(
        self, best: Candidate, others: Sequence[Candidate], measured: str,
        p_value: float, basis: str, episodes: tuple[str, ...],
    ) -> Fault:  # fmt: skip
        """The fault of a candidate, and what the data do not tell apart from it.

        Args:
            best: the candidate.
            others: as good ones.
            measured: what was seen, with numbers.
            p_value, basis: of it.
            episodes: ids.
        """
        unclear = "".join(
            f"; or {o.text}, which these data do not tell" for o in others
        )
        return Fault(
            best.kind, episodes, (*best.signals, *best.commands), best.target,
            f"{best.text} ({measured}){unclear}", p_value, basis, best.corrections,
            tuple(c for o in others for c in (*o.signals, *o.commands)),
        )  # fmt: skip

    def _tell_delay(self, what: str, one: Disagreement) -> Fault:
        j = self.joints[one.joint]
        late = one.lag
        name = j.velocity if what == "velocity" and late > 0 else j.position
        after = "its position" if name == j.velocity else (
            "its velocity" if what == "velocity" else "its command")  # fmt: skip
        return Fault(
            "delay", one.episodes, (name,), one.joint,
            f"{format_columns([name])} is {abs(late):.2f} s late against {after} "
            f"(correlation {one.relation.r:.3f} there, {one.relation.here:.3f} at the "
            "same time)",
            one.p_value, BASES[what],
            (ColumnCorrection(name, {"delay": abs(late)}),),
        )  # fmt: skip

    def _tell_derivative(self, one: Disagreement) -> Fault:
        j = self.joints[one.joint]
        return Fault(
            "derivative", one.episodes, j.columns[::-1], one.joint,
            f"{format_columns([j.velocity])} is not the derivative of "
            f"{format_columns([j.position])} (correlation {one.relation.r:.2f} at "
            "best)",
            one.p_value, BASES["velocity"],
            (ColumnCorrection(j.velocity, {SKIP: True}),),
        )  # fmt: skip


def _moves(recording: Recording, signal: str) -> bool:
    """Whether a column tells a motion, and not noise alone, in most episodes."""
    moves = []
    for e in recording.episodes.values():
        if signal in e.signals:
            x = e.signals[signal].values
            x = x[np.isfinite(x)]
            if x.size > 2:
                moves.append(np.std(x) > MOVES * np.std(np.diff(x)) / np.sqrt(2))
    return bool(moves) and float(np.mean(moves)) > 0.5
