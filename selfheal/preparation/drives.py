"""Drives of joints that have none: takes a model and gains, gives actuators."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, UnknownNameError
from ..mjcf.edit import format_number
from ..printable import quote_name

if TYPE_CHECKING:
    import mujoco

EVERY = ""  # key of the gain of all joints that are not named


@dataclass(frozen=True)
class Gains:
    """What drives the joints.

    Attributes:
        kp: stiffness of the position servos by joint, `EVERY` for the others [N m/rad
            or N/m]; empty: torque motors.
        kv: their damping, likewise [N m s/rad or N s/m]; of a joint without one the
            damping that is critical in the reference pose.
        passive: names of joints that have no drive.
    """

    kp: Mapping[str, float]
    kv: Mapping[str, float]
    passive: tuple[str, ...] = ()


@dataclass(frozen=True)
class Drive:
    """An actuator that a joint gets.

    Attributes:
        joint: its name, and the actuator's.
        tag: of MJCF, "position" or "motor".
        attributes: of the actuator beside its name and joint, as MJCF writes them.
        says: what it is, in words.
    """

    joint: str
    tag: str
    attributes: Mapping[str, str]
    says: str


def list_undriven(model: "mujoco.MjModel") -> list[int]:
    """Ids of hinges and slides without an actuator that do not follow another joint."""
    import mujoco

    transmissions = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    turned = np.isin(model.actuator_trntype, [int(t) for t in transmissions])
    pulled = model.wrap_type == int(mujoco.mjtWrap.mjWRAP_JOINT)
    driven = [model.actuator_trnid[turned, 0], model.wrap_objid[pulled]]
    moved = {int(j) for j in np.concatenate(driven)} | set(list_followers(model))
    kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    movable = np.isin(model.jnt_type, [int(kind) for kind in kinds])
    return [int(j) for j in np.flatnonzero(movable) if j not in moved]


def list_followers(model: "mujoco.MjModel") -> dict[int, int]:
    """Number of the constraint by the id of the joint that it makes follow another."""
    import mujoco

    found = np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT)
    return {int(model.eq_obj1id[e]): int(e) for e in found if model.eq_active0[e]}


def build_drives(model: "mujoco.MjModel", gains: Gains) -> list[Drive]:
    """A drive for each joint that needs one, in the model's order.

    Raises:
        UnknownNameError: a gain of a joint that gets no drive.
        InputError: a joint has no gain.
    """
    joints = {model.joint(j).name: j for j in list_undriven(model)}
    joints.pop("", None)
    for name in {*gains.kp, *gains.kv, *gains.passive} - {EVERY}:
        if name not in joints:
            raise UnknownNameError("joint without a drive", name, joints)
    driven = {n: j for n, j in joints.items() if n not in gains.passive}
    make = _make_servo if gains.kp else _make_motor
    return [make(model, name, j, gains) for name, j in driven.items()]


def _make_motor(model: "mujoco.MjModel", name: str, j: int, gains: Gains) -> Drive:
    """The torque motor of a joint.

    Args:
        model: compiled.
        name: of the joint.
        j: its id.
        gains: of no motor.
    """
    unit = "N" if _is_slide(model, j) else "N m"
    limit = _find_limit(model, j)
    says = f"a motor, whose command is in {unit}{_describe_limit(limit, unit)}"
    return Drive(name, "motor", limit, says)


def _make_servo(model: "mujoco.MjModel", name: str, j: int, gains: Gains) -> Drive:
    """The position servo of a joint.

    Args:
        model: compiled.
        name: of the joint.
        j: its id.
        gains: of all servos.
    """
    unit, rate = ("N", "m") if _is_slide(model, j) else ("N m", "rad")
    kp = gains.kp.get(name, gains.kp.get(EVERY))
    if kp is None:
        raise InputError(
            f"joint {quote_name(name)} has no --kp; would fit: --kp {name}=VALUE, --kp "
            f"VALUE for all joints, or --passive {name} if it has no drive"
        )
    kv = gains.kv.get(name, gains.kv.get(EVERY))
    critical = kv is None
    if kv is None:
        kv = 2 * float(np.sqrt(kp * model.dof_M0[model.jnt_dofadr[j]]))
    limit = _find_limit(model, j)
    numbers = {
        "kp": format_number(kp),
        "kv": f"{kv:.4g}" if critical else format_number(kv),
    }
    says = (
        f"a position servo, kp {numbers['kp']} {unit}/{rate}, kv {numbers['kv']} "
        f"{unit} s/{rate}{' (critical in the reference pose)' * critical}"
        f"{_describe_limit(limit, unit)}"
    )
    return Drive(name, "position", numbers | limit, says)


def _is_slide(model: "mujoco.MjModel", j: int) -> bool:
    """Whether a joint is a slide."""
    import mujoco

    return bool(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE)


def _find_limit(model: "mujoco.MjModel", j: int) -> dict[str, str]:
    """The limit of a joint's effort as an actuator states it; empty without one."""
    if not model.jnt_actfrclimited[j]:
        return {}
    return {"forcerange": format_number(model.jnt_actfrcrange[j])}


def _describe_limit(limit: Mapping[str, str], unit: str) -> str:
    """The words about a drive's limit."""
    ends = limit.get("forcerange", "").replace(" ", " to ")
    return f", within {ends} {unit} (the effort limit)" if ends else ", without a limit"
