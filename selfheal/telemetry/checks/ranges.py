"""Ranges: takes readings and commands, finds those beyond what the model states."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ...recording import find_joint, list_controls
from ...recording.data import Floats
from ..context import Context
from ..fault import (
    ColumnCorrection,
    Correction,
    Fault,
    ModelCorrection,
    format_columns,
    multiply,
)
from ..hypotheses import spread
from ..joints import JointColumns, shares_unit
from ..relations import SHARES, UNITS, list_units

if TYPE_CHECKING:
    import mujoco

# [rad or m] and share of the range by which a reading may be beyond it; chosen: an
# encoder's zero and the softness of a stop
TOLERANCE, TOLERANCE_SHARE = {"rad": 0.03, "m": 0.003}, 0.02
BEYOND_SECONDS = 0.05  # in all; chosen: no spike
COMMAND_TOLERANCE = 0.01  # of the range; chosen: rounding
# ranges of a joint, and turns of a hinge [rad], that readings span in another unit, and
# quantile that is no spike; chosen: a range in the wrong unit is within a turn
RANGES, TURN, INNER = 10.0, 2 * np.pi, 0.99
SHARE_SLACK = 0.05  # of a range, by which a share of it may be beyond; chosen


def find(context: Context) -> Iterator[Fault]:
    """Readings beyond a joint's range, and commands beyond an actuator's.

    A column that has another fault is not reported again.
    """
    faulty = {c for f in context.faults if f.kind != "delay" for c in f.columns}
    controls = range(context.model.nu)
    for fault in (
        *(_check_joint(context, j) for j in context.joints.values() if j.position),
        *(_check_command(context, c) for c in controls),
    ):
        if fault is not None and not faulty & {*fault.columns}:
            yield fault


def soften(model: "mujoco.MjModel", joint: int) -> float:
    """How far the strongest actuators push a joint into its soft limit [rad or m].

    At rest, a limit of stiffness k = 1 / (dmax timeconst dampratio)^2 and impedance d
    gives way to an acceleration a by a (1 - d) / (d k) (MuJoCo documentation,
    "Solver parameters").
    """
    timeconst, damping = model.jnt_solref[joint]
    d = min(max(model.jnt_solimp[joint, 1], 0.01), 0.9999)
    if timeconst <= 0:
        return 0.0
    stiffness = 1 / (d * timeconst * max(damping, 0.1)) ** 2
    dof = model.jnt_dofadr[joint]
    limits = [
        float(np.abs(model.actuator_forcerange[a]).max())
        for a in range(model.nactuator)
        if find_joint(model, a) == joint and model.actuator_forcelimited[a]
    ]
    push = sum(limits) * max(float(model.dof_invweight0[dof]), 0.0)
    return float(min(push * (1 - d) / (d * stiffness), 0.1))


def _measure_beyond(
    columns: Mapping[str, tuple[Floats, Floats]], low: float, high: float
) -> tuple[tuple[str, ...], float, float, float]:
    """Where times and values (T) of some episodes leave a range.

    Gives the ids of these episodes, for how long it is in all [s], and the lowest and
    the highest value there.
    """
    ids, seconds, lowest, highest = list[str](), 0.0, np.inf, -np.inf
    for name, (time, x) in columns.items():
        beyond = (x < low) | (x > high)
        if beyond.any() and x.size > 1:
            ids.append(name)
            seconds += float(beyond.sum()) * float(np.median(np.diff(time)))
            lowest, highest = min(lowest, np.nanmin(x)), max(highest, np.nanmax(x))
    return tuple(ids), seconds, lowest, highest


def get_slack(joint: JointColumns) -> float:
    """How far beyond its range a joint's readings may be [its unit]."""
    return max(TOLERANCE[joint.unit], TOLERANCE_SHARE * joint.span)


def _check_joint(context: Context, joint: JointColumns) -> Fault | None:
    if not joint.range:
        return None
    columns = context.read(joint.position)
    if fault := _check_unit(context, joint, columns):
        return fault
    (low, high), unit = joint.range, joint.unit
    slack = float(context.model.jnt_margin[joint.number])
    slack += get_slack(joint) + soften(context.model, joint.number)
    ids, seconds, lowest, highest = _measure_beyond(columns, low - slack, high + slack)
    if seconds < BEYOND_SECONDS:
        return None
    at = lowest if lowest < low - slack else low
    to = highest if highest > high + slack else high
    reached = lowest if lowest < low - slack else highest
    seen = (
        f"{format_columns([joint.position])} reaches {reached:.4g} {unit}, beyond the "
        f"model's range of {low:.4g} to {high:.4g} {unit}, for {seconds:.2f} s: the "
        "model's range is what is wrong, or the zero or unit of the column"
    )
    xml = f'<joint name="{joint.name}" range="{at:.4g} {to:.4g}"/>'
    correction = ModelCorrection(xml, unit)
    said = ids, (joint.position,), joint.name, seen
    return Fault("joint_range", *said, corrections=(correction,))


def _check_unit(
    context: Context, joint: JointColumns, columns: Mapping[str, tuple[Floats, Floats]]
) -> Fault | None:
    """A unit, where readings span so many ranges that no range could be that wrong."""
    x = np.concatenate([values for _, values in columns.values()])
    x = x[np.isfinite(x)]
    low, high = np.quantile(x, [1 - INNER, INNER]) if x.size else (0.0, 0.0)
    if high - low < max(RANGES * joint.span, TURN if joint.unit == "rad" else 0.0):
        return None
    bottom, top = joint.range or (0.0, 0.0)
    names, fitting = [joint.position], list_fitting(joint, float(low), float(high))
    corrections: list[Correction] = []
    if fitting:
        divide = multiply(1 / list_units(joint.span)[fitting[0]])
        change = spread(joint, fitting[0]) if fitting[0] in SHARES else divide
        corrections.append(ColumnCorrection(joint.position, change))
        if shares_unit(context.recording, joint):
            names.append(joint.velocity)
            corrections.append(ColumnCorrection(joint.velocity, divide))
    else:
        whole = bool(np.all(x == np.round(x)))
        fitting = [
            "whole numbers, as counts of an encoder are" if whole else "another one"
        ]
        corrections.append(
            f"from_range = [AT_LOW, AT_HIGH], to_range = [{bottom:.6g}, {top:.6g}] of "
            f"{format_columns(names)}"
        )
    seen = (
        f"{format_columns(names)}: the unit is {' or '.join(fitting)} (from {low:.4g} "
        f"to {high:.4g}, where the model's range is {bottom:.4g} to {top:.4g} "
        f"{joint.unit})"
    )
    said = tuple(columns), tuple(names), joint.name, seen
    return Fault("unit", *said, corrections=tuple(corrections))


def list_fitting(joint: JointColumns, low: float, high: float) -> list[str]:
    """Units in which readings are within the joint's range, the likeliest first."""
    bottom, top = joint.range or (0.0, 0.0)
    usual = {"rad": "degrees", "m": "thousandths"}[joint.unit]
    slack, factor = SHARE_SLACK * (top - bottom), UNITS[usual]
    found = []
    if bottom - slack <= low / factor and high / factor <= top + slack:
        found.append(usual)
    for name, full in SHARES.items():
        if -SHARE_SLACK * full <= low and high <= (1 + SHARE_SLACK) * full:
            found.append(name)
            break  # what fits a hundred fits more, too
    return found


def _check_command(context: Context, control: int) -> Fault | None:
    model, episodes = context.model, context.recording.episodes
    if not model.actuator_ctrllimited[control]:
        return None
    low, high = model.actuator_ctrlrange[control]
    slack = COMMAND_TOLERANCE * (high - low)
    columns = {k: (e.time, e.ctrl[:, control]) for k, e in episodes.items()}
    ids, seconds, lowest, highest = _measure_beyond(columns, low - slack, high + slack)
    if not ids:
        return None
    name = list_controls(model)[control].full_name
    seen = (
        f"the command of {format_columns([name])} goes from {lowest:.4g} to "
        f"{highest:.4g}, beyond the model's {low:.4g} to {high:.4g}, for "
        f"{seconds:.2f} s: MuJoCo clips it"
    )
    ends = f'ctrlrange="{min(low, lowest):.4g} {max(high, highest):.4g}" of {name}'
    return Fault("command_range", ids, (name,), name, seen, corrections=(ends,))
