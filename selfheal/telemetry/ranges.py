"""Ranges: takes readings and commands, finds those beyond what the model states."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..recording import Recording, find_joint, list_controls
from .fault import Correction, Fault, ModelCorrection, correct_factor, format_columns
from .joints import JointColumns, goes_along
from .pairs import SHARES, UNITS, list_units
from .search import correct_share

if TYPE_CHECKING:
    import mujoco

# [rad or m] and share of the range by which a reading may be beyond it; chosen: an
# encoder's zero and the softness of a stop
TOLERANCE, TOLERANCE_SHARE = {"rad": 0.03, "m": 0.003}, 0.02
BEYOND_SECONDS = 0.05  # in all; chosen: no spike
COMMAND_TOLERANCE = 0.01  # of the range; chosen: rounding
BASIS = "counted, not estimated"
# ranges of a joint, and turns of a hinge [rad], that readings span in another unit, and
# quantile that is no spike; chosen: a range in the wrong unit is within a turn
RANGES, TURN, INNER = 10.0, 2 * np.pi, 0.99
SHARE_SLACK = 0.05  # of a range, by which a share of it may be beyond; chosen


def find_beyond(
    recording: Recording,
    model: "mujoco.MjModel",
    joints: Sequence[JointColumns],
) -> list[Fault]:
    """Readings beyond a joint's range, and commands beyond an actuator's.

    Args:
        recording: of the robot.
        model: of it.
        joints: with their columns.
    """
    found = [_check_joint(recording, model, j) for j in joints if j.position]
    names = [control.full_name for control in list_controls(model)]
    found += [_check_command(recording, model, c, n) for c, n in enumerate(names)]
    return [fault for fault in found if fault is not None]


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


def _check_joint(
    recording: Recording, model: "mujoco.MjModel", joint: JointColumns
) -> Fault | None:
    if not model.jnt_limited[joint.number]:
        return None
    low, high = model.jnt_range[joint.number]
    first = next(
        e.signals[joint.position] for e in recording.episodes.values()
        if joint.position in e.signals
    )  # fmt: skip
    unit = "m" if first.unit == "m" else "rad"
    slack = max(TOLERANCE[unit], TOLERANCE_SHARE * (high - low))
    slack += float(model.jnt_margin[joint.number]) + soften(model, joint.number)
    if fault := _check_unit(recording, joint, unit):
        return fault
    seconds, ids, lowest, highest = 0.0, [], np.inf, -np.inf
    for name, e in recording.episodes.items():
        if joint.position not in e.signals or e.time.size < 2:
            continue
        x = e.signals[joint.position].values.reshape(e.time.size)
        beyond = (x < low - slack) | (x > high + slack)
        step = float(np.median(np.diff(e.time)))
        if beyond.any():
            ids.append(name)
            seconds += float(beyond.sum()) * step
            lowest, highest = min(lowest, np.nanmin(x)), max(highest, np.nanmax(x))
    if seconds < BEYOND_SECONDS:
        return None
    at = min(low, lowest) if lowest < low - slack else low
    to = max(high, highest) if highest > high + slack else high
    reached = f"{lowest:.4g}" if lowest < low - slack else f"{highest:.4g}"
    return Fault(
        "joint_range", tuple(ids), (joint.position,), joint.name,
        f"{format_columns([joint.position])} reaches {reached} {unit}, beyond the "
        f"model's range of {low:.4g} to {high:.4g} {unit}, for {seconds:.2f} s: the "
        "model's range is what is wrong, or the zero or unit of the column",
        0.0, BASIS,
        (ModelCorrection(f'<joint name="{joint.name}" range="{at:.4g} {to:.4g}"/>',
                         unit),),
    )  # fmt: skip


def _check_unit(recording: Recording, joint: JointColumns, unit: str) -> Fault | None:
    """A unit, where readings span so many ranges that no range could be that wrong.

    Args:
        recording: of the robot.
        joint: with a range.
        unit: of the contract.
    """
    having = {
        k: e for k, e in recording.episodes.items() if joint.position in e.signals
    }
    x = np.concatenate(
        [e.signals[joint.position].values.ravel() for e in having.values()]
    )
    x = x[np.isfinite(x)]
    low, high = np.quantile(x, [1 - INNER, INNER]) if x.size else (0.0, 0.0)
    if high - low < max(RANGES * joint.span, TURN if unit == "rad" else 0.0):
        return None
    fitting = list_fitting(joint, float(low), float(high), unit)
    whole = bool(np.all(x == np.round(x)))
    other = "whole numbers, as counts of an encoder are" if whole else "another one"
    said = " or ".join(fitting) or other
    bottom, top = joint.range or (0.0, 0.0)
    columns, corrections = [joint.position], [_correct_unit(joint, fitting)]
    if fitting and joint.velocity and goes_along(recording, joint):
        columns.append(joint.velocity)
        factor = list_units(joint.span)[fitting[0]]
        corrections.append(correct_factor(joint.velocity, 1 / factor))
    return Fault(
        "unit", tuple(having), tuple(columns), joint.name,
        f"{format_columns(columns)}: the unit is {said} (from {low:.4g} to {high:.4g}, "
        f"where the model's range is {bottom:.4g} to {top:.4g} {unit})",
        0.0, BASIS, tuple(corrections),
    )  # fmt: skip


def list_fitting(joint: JointColumns, low: float, high: float, unit: str) -> list[str]:
    """Units in which readings are within the joint's range.

    Args:
        joint: with a range.
        low: reading that few are below.
        high: reading that few are above.
        unit: of the contract.
    """
    bottom, top = joint.range or (0.0, 0.0)
    usual = {"rad": "degrees", "m": "thousandths"}[unit]
    found = []
    slack = SHARE_SLACK * (top - bottom)
    factor = UNITS[usual]
    if bottom - slack <= low / factor and high / factor <= top + slack:
        found.append(usual)
    for name, full in SHARES.items():
        if -SHARE_SLACK * full <= low and high <= (1 + SHARE_SLACK) * full:
            found.append(name)
            break  # what fits a hundred fits more, too
    return found


def _correct_unit(joint: JointColumns, fitting: Sequence[str]) -> Correction:
    """How to read the column, by the units that fit, the likeliest first."""
    if fitting and fitting[0] in SHARES:
        return correct_share(joint.position, joint, fitting[0])
    if fitting:
        return correct_factor(joint.position, 1 / UNITS[fitting[0]])
    bottom, top = joint.range or (0.0, 0.0)
    return (
        f"from_range = [AT_LOW, AT_HIGH], to_range = [{bottom:.6g}, {top:.6g}] of "
        f"{format_columns([joint.position])}"
    )


def _check_command(
    recording: Recording, model: "mujoco.MjModel", control: int, name: str
) -> Fault | None:
    if not model.actuator_ctrllimited[control]:
        return None
    low, high = model.actuator_ctrlrange[control]
    slack = COMMAND_TOLERANCE * (high - low)
    ids, lowest, highest, seconds = [], np.inf, -np.inf, 0.0
    for episode, e in recording.episodes.items():
        x = e.ctrl[:, e.ctrl_names.index(name)]
        beyond = (x < low - slack) | (x > high + slack)
        if beyond.any() and e.time.size > 1:
            ids.append(episode)
            seconds += float(beyond.sum() * np.median(np.diff(e.time)))
            lowest, highest = min(lowest, x.min()), max(highest, x.max())
    if not ids:
        return None
    return Fault(
        "command_range", tuple(ids), (name,), name,
        f"the command of {format_columns([name])} goes from {lowest:.4g} to "
        f"{highest:.4g}, beyond the model's {low:.4g} to {high:.4g}, for "
        f"{seconds:.2f} s: MuJoCo clips it",
        0.0, BASIS,
        (f'ctrlrange="{min(low, lowest):.4g} {max(high, highest):.4g}" of {name}',),
    )  # fmt: skip
