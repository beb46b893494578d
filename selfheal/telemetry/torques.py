"""Reported torques: takes them, finds signs and units, and copies of the command."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ..recording import Recording
from .balance import TorqueBalance
from .fault import SKIP, ColumnCorrection, Fault, correct_factor, format_columns
from .joints import JointColumns
from .pairs import FAR_BETTER, Relation, correlation_p_value, name_unit, relate
from .series import Series
from .states import Mend

if TYPE_CHECKING:
    import mujoco

EXACT = 1e-9  # of the largest torque, by which a copy differs at most: rounding
AGREE = 2.0  # factor between the ratios to both references, at most; chosen
BASIS = "correlation with the torque that the motion takes, Fisher's z"


def find_torque_faults(
    recording: Recording,
    model: "mujoco.MjModel",
    joints: Sequence[JointColumns],
    series: Series,
    balance: TorqueBalance,
    mend: Mend,
) -> list[Fault]:
    """Torques of another sign or unit, and those that repeat the command.

    Args:
        recording: of the robot.
        model: of it.
        joints: with their columns.
        series: of the recording.
        balance: of its torques.
        mend: of the joints' columns.
    """
    names: dict[str, str] = {}
    for e in recording.episodes.values():
        for name, signal in e.signals.items():
            if signal.kind == "joint_torque":
                names.setdefault(name, signal.target)
    found = [f for n, a in names.items() if (f := _check_copy(recording, n, a))]
    if balance.reason or not names:
        return found
    by_actuator = {a: j for j in joints for a in j.actuators if len(j.actuators) == 1}
    parts = balance.compute_torques(mend, balance.rows)
    episode = series.episode[balance.rows]
    dofs = {name: int(model.jnt_dofadr[by_actuator[a].number])
            for name, a in names.items() if a in by_actuator}  # fmt: skip

    def follow(what: str, one: str, other: str) -> Relation:
        got = series.signals[other][balance.rows, 0, 0]
        return relate(parts[what][:, dofs[one]], got, episode, range(1))

    for name in dofs:
        motion, command = follow("all", name, name), follow("act", name, name)
        if fault := _judge(name, names[name], motion, command, series):
            found.append(fault)
    for one, other in combinations(dofs, 2):
        own = [follow("all", a, a) for a in (one, other)]
        across = [follow("all", a, b) for a, b in ((one, other), (other, one))]
        # torques of two joints may be alike: the other's has to be far nearer
        if all(
            r.is_same and r.r > 0 and 1 - r.r**2 < FAR_BETTER * (1 - o.r**2)
            for r, o in zip(across, own, strict=True)
        ):
            found.append(_tell_exchange(one, other, names, across, series))
    return found


def _tell_exchange(
    one: str, other: str, actuators: Mapping[str, str], across: Sequence[Relation],
    series: Series,
) -> Fault:  # fmt: skip
    """Two torques of which each is the other actuator's.

    Args:
        one, other: names of the signals.
        actuators: by signal.
        across: relations of each torque to what the other should be.
        series: of the recording.
    """
    r = min(a.r for a in across)
    corrections = (
        ColumnCorrection(one, {"targets": [actuators[other]]}),
        ColumnCorrection(other, {"targets": [actuators[one]]}),
    )
    return Fault(
        "exchange", series.episodes, (one, other), actuators[one],
        f"{format_columns([one, other])} are exchanged (correlation {r:.2f} with the "
        "torque that the motion of the other joint takes, low with its own)",
        max(correlation_p_value(a.r, a.rows, 1.0) for a in across), BASIS,
        corrections,
    )  # fmt: skip


def _judge(
    name: str, actuator: str, by_motion: Relation, by_command: Relation, series: Series
) -> Fault | None:
    """A wrong sign or unit, where motion and command tell the same of it.

    Args:
        name: of the signal.
        actuator: whose torque it is.
        by_motion: to the torque that the motion takes.
        by_command: to that which the command gives.
        series: of the recording.
    """
    r, p = by_motion.r, correlation_p_value(by_motion.r, by_motion.rows, 1.0)
    ids, columns = series.episodes, (name,)
    said = f"correlation {r:.2f} with the torque that the motion takes"
    if by_motion.is_same and r < 0 and by_command.r < 0:
        return Fault(
            "sign", ids, columns, actuator,
            f"{format_columns(columns)} has the other sign ({said})", p, BASIS,
            (correct_factor(name, -1.0),),
        )  # fmt: skip
    one, other = abs(by_motion.ratio), abs(by_command.ratio)
    same = max(one / other, other / one) < AGREE
    if by_motion.has_other_unit and by_command.has_other_unit and same:
        unit = name_unit(one) or "another unit"
        return Fault(
            "unit", ids, columns, actuator,
            f"{format_columns(columns)} is {one:.4g} times too large: {unit} ({said})",
            p, BASIS, (correct_factor(name, 1 / one),),
        )  # fmt: skip
    return None


def _check_copy(recording: Recording, name: str, actuator: str) -> Fault | None:
    """Whether a torque is its command times a number, at all samples."""
    torque, command, ids = [], [], []
    for episode, e in recording.episodes.items():
        if name in e.signals and actuator in e.ctrl_names:
            x = e.signals[name].values.reshape(e.time.size)
            read = np.isfinite(x)
            torque.append(x[read])
            command.append(e.ctrl[read, e.ctrl_names.index(actuator)])
            ids.append(episode)
    if not torque:
        return None
    x, u = np.concatenate(torque), np.concatenate(command)
    if x.size < 2 or np.ptp(u) == 0 or np.ptp(x) == 0:
        return None
    gain = float(x @ u / (u @ u))
    if np.abs(x - gain * u).max() > EXACT * np.abs(x).max():
        return None
    return Fault(
        "torque_is_command", tuple(ids), (name,), actuator,
        f"{format_columns([name])} is {gain:.6g} times the command of "
        f"{format_columns([actuator])} at all {x.size} samples: it was not measured",
        0.0, "counted, not estimated", (ColumnCorrection(name, {SKIP: True}),),
    )  # fmt: skip
