"""Drives of joints that have none: takes a model and gains, gives actuators."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, UnknownNameError
from ..logs.model_facts import find_force_range
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
            or N/m].
        kv: their damping, likewise [N m s/rad or N s/m]; of a joint without one the
            damping that is critical in the reference pose.
        motors: whether torques are commanded.
    """

    kp: Mapping[str, float]
    kv: Mapping[str, float]
    passive: tuple[str, ...] = ()
    motors: bool = False


@dataclass(frozen=True)
class Drive:
    """An actuator that a joint gets.

    Attributes:
        joint: its name, and the actuator's.
        tag: of MJCF, "position" or "motor".
        attributes: of the actuator beside its name and joint, as MJCF writes them.
        motor: id of the torque motor in whose place it is; None where there was none.
    """

    joint: str
    tag: str
    attributes: Mapping[str, str]
    says: str
    motor: int | None = None


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


def list_motors(model: "mujoco.MjModel") -> dict[int, int]:
    """Id of the actuator by that of its joint, where a torque motor alone turns it."""
    import mujoco

    is_at_joint = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)
    is_motor = (
        is_at_joint
        & (model.actuator_gaintype == int(mujoco.mjtGain.mjGAIN_FIXED))
        & (model.actuator_biastype == int(mujoco.mjtBias.mjBIAS_NONE))
        & (model.actuator_dyntype == int(mujoco.mjtDyn.mjDYN_NONE))
    )
    turned = np.where(is_at_joint, model.actuator_trnid[:, 0], -1).tolist()
    motors = [int(a) for a in np.flatnonzero(is_motor)]
    return {turned[a]: a for a in motors if turned.count(turned[a]) == 1}


def list_followers(model: "mujoco.MjModel") -> dict[int, int]:
    """Number of the constraint by the id of the joint that it makes follow another."""
    import mujoco

    found = np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT)
    return {int(model.eq_obj1id[e]): int(e) for e in found if model.eq_active0[e]}


def build_drives(model: "mujoco.MjModel", gains: Gains) -> list[Drive]:
    """A drive for each joint that needs one, in the model's order.

    A gain says that goal positions are commanded: it puts a servo in a motor's place.

    Raises:
        UnknownNameError: a gain of a joint that gets no drive.
        InputError: a joint has no gain, or nothing says what drives it.
    """
    joints = {model.joint(j).name: j for j in list_undriven(model)}
    motors = {
        name: a
        for j, a in list_motors(model).items()
        if {(name := model.joint(j).name), EVERY} & {*gains.kp}
    }
    joints |= {name: model.joint(name).id for name in motors if name}
    joints.pop("", None)
    for name in {*gains.kp, *gains.kv, *gains.passive} - {EVERY}:
        if name not in joints:
            raise UnknownNameError("joint without a drive", name, joints)
    driven = {n: j for n, j in joints.items() if n not in gains.passive}
    if driven and not gains.kp and not gains.motors:
        raise InputError(
            f"joint {quote_name(next(iter(driven)))} has no drive; give the stiffness "
            "of the drives by --kp VALUE (and --kv VALUE if it is known), or --motors "
            "if the log's commands are torques; a guess of the gains will do, for "
            "diagnose tells by how much it is off"
        )
    if not gains.kp:
        return [_make_motor(model, name, j) for name, j in driven.items()]
    return [_make_servo(model, name, gains, motors.get(name)) for name in driven]


def _make_motor(model: "mujoco.MjModel", name: str, j: int) -> Drive:
    """The torque motor of a joint."""
    unit = "N" if _is_slide(model, j) else "N m"
    limit = _find_limit(model, j)
    says = f"a motor, whose command is in {unit}{_describe_limit(limit, unit)}"
    return Drive(name, "motor", limit, says)


def _make_servo(
    model: "mujoco.MjModel", name: str, gains: Gains, motor: int | None
) -> Drive:
    """The position servo of a joint."""
    j = model.joint(name).id
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
    if motor is not None and (strength := find_force_range(model, motor)):
        limit = {"forcerange": format_number(np.array(strength))}
    numbers = {
        "kp": format_number(kp),
        "kv": f"{kv:.4g}" if critical else format_number(kv),
    }
    says = (
        f"a position servo, kp {numbers['kp']} {unit}/{rate}, kv {numbers['kv']} "
        f"{unit} s/{rate}{' (critical in the reference pose)' * critical}"
        f"{_describe_limit(limit, unit)}"
        f"{', in the place of a torque motor' * (motor is not None)}"
    )
    return Drive(name, "position", numbers | limit, says, motor)


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
