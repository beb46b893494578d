"""Reported torques: takes them, finds signs and units, and copies of the command."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from ..context import Context
from ..fault import SKIP, ColumnCorrection, Fault, correct_factor, format_columns
from ..relations import FAR_BETTER, Relation, correlation_p_value, name_unit, relate

EXACT = 1e-9  # of the largest torque, by which a copy differs at most: rounding
AGREE = 2.0  # factor between the ratios to both references, at most; chosen
BASIS = "correlation with the torque that the motion takes, Fisher's z"


def find(context: Context) -> Iterator[Fault]:
    """Torques of another sign or unit, exchanged ones, and copies of the command."""
    episodes = context.recording.episodes.values()
    names = {n: s.target for e in episodes for n, s in e.signals.items()
             if s.kind == "joint_torque"}  # fmt: skip
    for name, actuator in names.items():
        yield from _check_copy(context, name, actuator)
    balance, series = context.balance, context.series
    if balance.reason or not names:
        return
    parts = balance.compute_torques(context.column_map, balance.rows)
    single = {j.actuators[0]: int(context.model.jnt_dofadr[j.number])
              for j in context.joints.values() if len(j.actuators) == 1}  # fmt: skip
    dofs = {name: single[a] for name, a in names.items() if a in single}

    def follow(what: str, one: str, other: str) -> Relation:
        reported = series.signals[other][balance.rows, 0, 0]
        episode = series.episode[balance.rows]
        return relate(parts[what][:, dofs[one]], reported, episode, range(1))

    for name in dofs:
        motion, command = follow("all", name, name), follow("act", name, name)
        yield from _judge(context, name, names[name], motion, command)
    for one, other in combinations(dofs, 2):
        own = [follow("all", a, a) for a in (one, other)]
        across = [follow("all", a, b) for a, b in ((one, other), (other, one))]
        # torques of two joints may be alike: the other's has to be far nearer
        if all(
            r.is_same and r.r > 0 and 1 - r.r**2 < FAR_BETTER * (1 - o.r**2)
            for r, o in zip(across, own, strict=True)
        ):
            yield Fault(
                "exchange", series.episodes, (one, other), names[one],
                f"{format_columns([one, other])} are exchanged (correlation "
                f"{min(r.r for r in across):.2f} with the torque that the motion of "
                "the other joint takes, low with its own)",
                max(correlation_p_value(r.r, r.rows, 1.0) for r in across), BASIS,
                (ColumnCorrection(one, {"targets": [names[other]]}),
                 ColumnCorrection(other, {"targets": [names[one]]})),
            )  # fmt: skip


def _judge(
    context: Context, name: str, actuator: str, motion: Relation, command: Relation
) -> Iterator[Fault]:
    """A wrong sign or unit, where motion and command agree on it."""
    r, p = motion.r, correlation_p_value(motion.r, motion.rows, 1.0)
    measured = f"correlation {r:.2f} with the torque that the motion takes"
    one, other = abs(motion.ratio), abs(command.ratio)
    if motion.is_same and r < 0 and command.r < 0:
        kind, factor, said = "sign", -1.0, "has the other sign"
    elif (
        motion.has_other_unit and command.has_other_unit
        and max(one / other, other / one) < AGREE
    ):  # fmt: skip
        kind, factor = "unit", 1 / one
        said = f"is {one:.4g} times too large: {name_unit(one) or 'another unit'}"
    else:
        return
    yield Fault(
        kind, context.series.episodes, (name,), actuator,
        f"{format_columns([name])} {said} ({measured})", p, BASIS,
        (correct_factor(name, factor),),
    )  # fmt: skip


def _check_copy(context: Context, name: str, actuator: str) -> Iterator[Fault]:
    """Whether a torque is its command times a number, at all samples."""
    torque, command, ids = [], [], []
    for episode, e in context.recording.episodes.items():
        if name in e.signals and actuator in e.ctrl_names:
            x = e.signals[name].values.reshape(e.time.size)
            read = np.isfinite(x)
            torque.append(x[read])
            command.append(e.ctrl[read, e.ctrl_names.index(actuator)])
            ids.append(episode)
    if not torque:
        return
    x, u = np.concatenate(torque), np.concatenate(command)
    if x.size < 2 or np.ptp(u) == 0 or np.ptp(x) == 0:
        return
    gain = float(x @ u / (u @ u))
    if np.abs(x - gain * u).max() <= EXACT * np.abs(x).max():
        yield Fault(
            "torque_is_command", tuple(ids), (name,), actuator,
            f"{format_columns([name])} is {gain:.6g} times the command of "
            f"{format_columns([actuator])} at all {x.size} samples: it was not "
            "measured",
            corrections=(ColumnCorrection(name, {SKIP: True}),),
        )  # fmt: skip
