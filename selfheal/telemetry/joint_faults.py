"""Which column of a joint is at fault: takes disagreements, gives faults with mends."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..recording import Recording
from .balance import Balance, TorqueBalance
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
from .fault import Fault, format_columns, write_mend
from .joints import JointColumns
from .pairs import UNITS, name_unit
from .series import Series
from .states import Mend

if TYPE_CHECKING:
    import mujoco

MAX_FAULTS = (
    4  # that the balance of torques alone may tell, one after the other; chosen
)
# nats by which a mend must explain the torques better, share that it may leave, and
# share that the log as it is must leave; chosen: concealed physics leaves a twelfth
# at most, and gains nothing by a wrong sign
MIN_GAIN, MAX_LEFT, MIN_LEFT = 1.5, 0.1, 0.015
MAX_P_VALUE = 1e-3  # of a mend, times the number of mends that were tried
SCREENED = 4  # rows of which one is evaluated first; chosen: a quarter of the time
CLEARLY = 0.5  # nats by which one mend is told from another; chosen
BASES = {
    "command": "correlation of the joint with its command, Fisher's z",
    "velocity": "correlation of velocity and derived position, Fisher's z",
    "torque": "Wilcoxon's signed-rank test of the balance of torques, block by block, "
    "times the number of mends tried",
}
DEGREE = float(np.pi / 180)


@dataclass(frozen=True)
class Candidate:
    """One thing that could be wrong with the columns about a joint or two.

    Attributes:
        kind: of the fault.
        mend: what it would be read as instead.
        signals: whose reading changes.
        commands: actuators whose command changes.
        target: joint or actuator.
        lines: of the map file.
        text: what is wrong, as the end of a sentence.
    """

    kind: str
    mend: Mend
    signals: tuple[str, ...]
    commands: tuple[str, ...]
    target: str
    lines: str
    text: str


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
        self.with_velocity = find_disagreements(
            self._pair_velocities(recording), series
        )
        self.with_command = find_disagreements(self._pair_commands(), series)
        self.mend = Mend()

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
        """All faults of columns about joints."""
        by_joint: dict[tuple[str, str, str], dict[str, Disagreement]] = {}
        for what, every in (
            ("velocity", self.with_velocity), ("command", self.with_command),
        ):  # fmt: skip
            for one in every:
                by_joint.setdefault((one.kind, one.joint, one.partner), {})[what] = one
        found = []
        for (kind, joint, partner), seen in by_joint.items():
            if kind in ("sign", "unit", "exchange"):
                found.append(self._locate(kind, joint, partner, seen))
            elif kind == "delay":
                found += [self._tell_delay(what, one) for what, one in seen.items()]
            elif "velocity" in seen:
                found.append(self._tell_derivative(seen["velocity"]))
        if not self.balance.reason:
            found += self._search()
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
            ratio = seen["command"].relation.ratio
            return [self._make(kind, joint, partner, ("position",), ratio)]
        if "command" in seen:
            parts = ("position", "velocity") if j.velocity else ("position",)
            return [
                self._make(kind, joint, partner, parts, ratio),
                self._make(kind, joint, partner, ("command",), 1 / ratio),
            ]
        velocity = self._make(kind, joint, partner, ("velocity",), ratio)
        if j.servo:  # the position agrees with its command
            return [velocity]
        return [velocity, self._make(kind, joint, partner, ("position",), 1 / ratio)]

    def _choose(
        self, options: Sequence[Candidate]
    ) -> tuple[Candidate, list[Candidate]]:
        """The option that balances the torques best, and those as good."""
        if len(options) == 1 or self.balance.reason:
            return options[0], list(options[1:])
        tried = [self.balance.evaluate(self.mend.then(o.mend)) for o in options]
        every = range(len(self.balance.dofs))
        best = 0
        for k in range(1, len(options)):
            gain, p = tried[k].gain_over(tried[best], every)
            if gain > CLEARLY and p < MAX_P_VALUE:
                best = k
        equal = [
            o
            for k, o in enumerate(options)
            if k != best and tried[best].gain_over(tried[k], every)[0] < CLEARLY
        ]
        return options[best], equal

    def _make(
        self, kind: str, joint: str, partner: str, parts: tuple[str, ...], ratio: float
    ) -> Candidate:
        """A candidate: a kind of fault in some of the columns about a joint.

        Args:
            kind: "sign", "unit" or "exchange".
            joint: name.
            partner: the other joint of an exchange; else "".
            parts: of "position", "velocity", "command": what is read otherwise.
            ratio: what was written over what is right, for a unit.
        """
        pairs = [(joint, partner or joint)] + [(partner, joint)] * bool(partner)
        factor = {"sign": -1.0, "unit": 1 / abs(ratio)}.get(kind, 1.0)
        if kind == "unit" and (unit := name_unit(ratio)):
            factor = 1 / UNITS[unit]
        positions, commands, signals, acting, lines = {}, {}, [], [], []
        for to, source in pairs:
            one, other = self.joints[to], self.joints[source]
            if "position" in parts:
                positions[to] = (source, factor)
            for part in ("position", "velocity"):
                name = getattr(other, part)
                if part in parts and name:
                    signals.append(name)
                    lines.append(self._write(kind, "signals", name, factor, to))
            if "command" in parts:
                for a, b in zip(one.commands, other.commands, strict=False):
                    commands[a] = (b, factor)
                    acting.append(b)
                    lines.append(self._write(kind, "ctrl", b, factor, a))
        mend = Mend(positions, commands)
        columns = format_columns([*signals, *acting])
        unit = name_unit(ratio) if kind == "unit" else ""
        text = {
            "sign": f"{columns}: the sign is the other one",
            "unit": f"{columns}: the unit is {unit or 'another one'}",
            "exchange": f"{columns} are exchanged",
        }[kind]
        return Candidate(
            kind, mend, tuple(signals), tuple(acting), joint, "\n".join(lines), text
        )

    @staticmethod
    def _write(kind: str, table: str, name: str, factor: float, to: str) -> str:
        if kind == "exchange":
            return write_mend(table, name, "targets", json.dumps([to]))
        return write_mend(table, name, "scale", factor)

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
            f"{best.text} ({measured}){unclear}", p_value, basis, best.lines,
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
            one.p_value, BASES[what], write_mend("signals", name, "delay", abs(late)),
        )  # fmt: skip

    def _tell_derivative(self, one: Disagreement) -> Fault:
        j = self.joints[one.joint]
        return Fault(
            "derivative", one.episodes, j.columns[::-1], one.joint,
            f"{format_columns([j.velocity])} is not the derivative of "
            f"{format_columns([j.position])} (correlation {one.relation.r:.2f} at "
            "best)",
            one.p_value, BASES["velocity"],
            write_mend("signals", j.velocity, "skip", True),
        )  # fmt: skip

    def _search(self) -> list[Fault]:
        """Faults that only the balance of torques tells, the plainest one first."""
        found: list[Fault] = []
        base = self.balance.evaluate(self.mend)
        for _ in range(MAX_FAULTS):
            if base.unexplained.max(initial=0.0) < MIN_LEFT:
                break
            step = self._find_best(base)
            if step is None:
                break
            best, others, after, gain, p = step
            left, given = after.find_worst(base), base.find_worst(after)
            measured = (
                f"then torques are balanced to {100 * left:.2g} %, as the log is to "
                f"{100 * given:.2g} %, {gain:.1f} nats a row"
            )
            found.append(self._make_fault(
                best, others, measured, p, BASES["torque"], self.series.episodes
            ))  # fmt: skip
            self.mend, base = self.mend.then(best.mend), after
        return found

    def _find_best(
        self, base: Balance
    ) -> tuple[Candidate, list[Candidate], Balance, float, float] | None:
        """The mend that balances the torques far better, and those as good."""
        every = list(range(len(self.balance.dofs)))
        options = self._list_candidates()
        coarse = self.balance.evaluate(self.mend, SCREENED)
        tried = []
        for option in options:
            mend = self.mend.then(option.mend)
            screened = self.balance.evaluate(mend, SCREENED)
            if screened.gain_over(coarse, every)[0] > MIN_GAIN / 2:
                tried.append((option, self.balance.evaluate(mend)))
        good = []
        for option, after in tried:
            gain, p = after.gain_over(base, every)
            p = min(1.0, p * len(options))
            bad, rest = base.find_worst(after), after.find_worst(base)
            is_better = gain >= MIN_GAIN and p < MAX_P_VALUE
            if is_better and bad > MIN_LEFT and rest < MAX_LEFT:
                good.append((gain, option, after, p))
        if not good:
            return None
        good.sort(key=lambda g: -g[0])
        gain, best, after, p = good[0]
        equal = [o for g, o, _, _ in good[1:] if gain - g < CLEARLY]
        return best, equal, after, gain, p

    def _list_candidates(self) -> list[Candidate]:
        """All signs, units and exchanges that the balance of torques could tell."""
        names = [
            j.name for j in self.joints.values() if j.name not in self.mend.positions
        ]
        found = []
        for name in names:
            joint = self.joints[name]
            read = ("position", "velocity") if joint.velocity else ("position",)
            found.append(self._make("sign", name, "", read, 1.0))
            found.append(self._make("unit", name, "", read, 1 / DEGREE))
            if joint.commands:
                both = (*read, "command")
                servo = joint.servo is not None
                found.append(
                    self._make("sign", name, "", both if servo else ("command",), 1)
                )
                if servo:
                    found.append(self._make("unit", name, "", both, 1 / DEGREE))
        for i, one in enumerate(names):
            for other in names[i + 1 :]:
                joint = self.joints[one]
                read = ("position", "velocity") if joint.velocity else ("position",)
                found.append(self._make("exchange", one, other, read, 1.0))
                if joint.commands and self.joints[other].commands:
                    found.append(self._make("exchange", one, other, ("command",), 1.0))
        return found


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
