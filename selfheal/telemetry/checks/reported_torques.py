"""Reported torques: takes them, finds signs and units, and copies of the command."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from ...recording.data import Floats
from ..context import Context
from ..fault import ColumnCorrection, Fault, format_columns, multiply
from ..relations import FAR_BETTER, Relation, correlation_p_value, name_unit, relate

EXACT = 1e-9  # of the largest torque, by which a copy differs at most: rounding
AGREE = 2.0  # factor between the ratios to both references, at most; chosen
BASIS = "correlation with the torque that the motion takes, Fisher's z"


def find(context: Context) -> Iterator[Fault]:
    """Torques of another sign or unit, exchanged ones, and copies of the command."""
    names = {
        name: signal.target
        for e in context.recording.episodes.values()
        for name, signal in e.signals.items()
        if signal.kind == "joint_torque"
    }
    for name, actuator in names.items():
        yield from _check_copy(context, name, actuator)
    balance, series = context.balance, context.series
    if balance.reason or not names:
        return
    parts = balance.compute_torques(context.column_map, balance.rows)
    single = {
        j.actuators[0]: int(context.model.jnt_dofadr[j.number])
        for j in context.joints.values()
        if len(j.actuators) == 1
    }
    dofs = {name: single[a] for name, a in names.items() if a in single}

    def follow(what: str, one: str, other: str) -> Relation:
        reported = series.signals[other][balance.rows, 0, 0]
        episode = series.episode[balance.rows]
        return relate(parts[what][:, dofs[one]], reported, episode, range(1))

    own = {name: follow("all", name, name) for name in dofs}
    for name, motion in own.items():
        command = follow("act", name, name)
        yield from _judge(context, name, names[name], motion, command)
    for one, other in combinations(dofs, 2):
        across = [follow("all", a, b) for a, b in ((one, other), (other, one))]
        # torques of two joints may be alike: the other's has to be far nearer
        if all(
            r.is_same and r.r > 0 and 1 - r.r**2 < FAR_BETTER * (1 - o.r**2)
            for r, o in zip(across, (own[one], own[other]), strict=True)
        ):
            seen = (
                f"{format_columns([one, other])} are exchanged (correlation "
                f"{min(r.r for r in across):.2f} with the torque that the motion of "
                "the other joint takes, low with its own)"
            )
            p = max(correlation_p_value(r, 1.0) for r in across)
            rules = (
                ColumnCorrection(one, {"targets": [names[other]]}),
                ColumnCorrection(other, {"targets": [names[one]]}),
            )
            where = series.episodes, (one, other), names[one]
            yield Fault("exchange", *where, seen, p, BASIS, rules)


def _judge(
    context: Context, name: str, actuator: str, motion: Relation, command: Relation
) -> Iterator[Fault]:
    """A wrong sign or unit, where motion and command agree on it."""
    one, other = abs(motion.ratio), abs(command.ratio)
    agree = 1 / AGREE < one / other < AGREE
    if motion.is_flipped and command.r < 0:
        kind, factor, said = "sign", -1.0, "has the other sign"
    elif motion.has_other_unit and command.has_other_unit and agree:
        kind, factor = "unit", 1 / one
        said = f"is {one:.4g} times too large: {name_unit(one) or 'another unit'}"
    else:
        return
    seen = (
        f"{format_columns([name])} {said} (correlation {motion.r:.2f} with the torque "
        "that the motion takes)"
    )
    where, p = (
        (context.series.episodes, (name,), actuator),
        correlation_p_value(motion, 1.0),
    )
    rule = ColumnCorrection(name, multiply(factor))
    yield Fault(kind, *where, seen, p, BASIS, (rule,))


def _check_copy(context: Context, name: str, actuator: str) -> Iterator[Fault]:
    """Whether a torque is its command times a number, at all samples."""
    torque, command = dict[str, Floats](), dict[str, Floats]()
    for k, (_, x) in context.read(name).items():
        e, read = context.recording.episodes[k], np.isfinite(x)
        if actuator in e.ctrl_names:
            torque[k], command[k] = x[read], e.ctrl[read, e.ctrl_names.index(actuator)]
    if not torque:
        return
    x, u = (np.concatenate([*part.values()]) for part in (torque, command))
    if x.size < 2 or np.ptp(u) == 0 or np.ptp(x) == 0:
        return
    gain = float(x @ u / (u @ u))
    if np.abs(x - gain * u).max() <= EXACT * np.abs(x).max():
        seen = (
            f"{format_columns([name])} is {gain:.6g} times the command of "
            f"{format_columns([actuator])} at all {x.size} samples: it was not measured"
        )
        said = tuple(torque), (name,), actuator, seen
        rule = ColumnCorrection(name, {"skip": True})
        yield Fault("torque_is_command", *said, corrections=(rule,))
