"""What a model says of the columns that a log of its robot may have."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..recording import find_controls, list_controls

if TYPE_CHECKING:
    import mujoco

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Place:
    """Something in a model that a column may belong to.

    Attributes:
        kind: of a column there: one of the contract or "command".
        name: of the joint, actuator, body or sensor.
        aliases: other names for it: an actuator's joint.
        unit: of the values in the recording.
        width: columns that it takes.
        low: least value that it can have [unit]; -inf where the model states none.
        high: largest one [unit].
        joint: number of the joint it belongs to; -1 if none.
    """

    kind: str
    name: str
    aliases: tuple[str, ...] = ()
    unit: str = ""
    width: int = 1
    low: float = -np.inf
    high: float = np.inf
    joint: int = -1


def list_places(model: "mujoco.MjModel") -> list[Place]:
    """Everything of a compiled model that a column may belong to, in its order."""
    return [*_list_joints(model), *_list_actuators(model), *_list_others(model)]


def _list_joints(model: "mujoco.MjModel") -> list[Place]:
    """Positions and speeds of hinges and slides."""
    import mujoco

    found = []
    hinge, slide = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    for j in range(model.njnt):
        unit = {int(hinge): "rad", int(slide): "m"}.get(int(model.jnt_type[j]))
        name = model.joint(j).name
        if unit is None or not name:
            continue
        low, high = model.jnt_range[j] if model.jnt_limited[j] else (-np.inf, np.inf)
        found += [
            Place("joint_position", name, (), unit, 1, low, high, j),
            Place("joint_velocity", name, (), f"{unit}/s", joint=j),
        ]
    return found


def _list_actuators(model: "mujoco.MjModel") -> list[Place]:
    """Commands and forces of actuators."""
    import mujoco

    found = []
    controls = list_controls(model)
    for a in range(model.nactuator):
        name, joint = model.actuator(a).name, _find_joint(model, a)
        if not name:
            continue
        aliases = (model.joint(joint).name,) if joint >= 0 else ()
        units, force = dict[str, str](), ""
        if joint >= 0:
            is_hinge = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE
            length, force = ("rad", "N m") if is_hinge else ("m", "N")
            own = _find_command_unit(model, a, length)
            units = {"": own, "pos": length, "vel": f"{length}/s"}
        for c in find_controls(model, a):
            low, high = -np.inf, np.inf
            if model.actuator_ctrllimited[c]:
                low, high = model.actuator_ctrlrange[c]
            full, unit = controls[c].full_name, units.get(controls[c].input, "")
            found.append(Place("command", full, aliases, unit, 1, low, high, joint))
        if force:
            found.append(Place("joint_torque", name, aliases, force, joint=joint))
        found += [
            Place("supply_voltage", name, aliases, "V"),
            Place("temperature", name, aliases, "degC"),
        ]
    return found


def _list_others(model: "mujoco.MjModel") -> list[Place]:
    """Sensors, and poses and speeds of bodies."""
    from ..recording import list_model_names

    names = list_model_names(model)
    found = [
        Place("sensor", name, (), target.units.get("sensor", "1"), target.width or 1)
        for name, target in names.targets["sensor"].items()
    ]
    free = [model.body(b).name for b in range(1, model.nbody)
            if model.body_dofnum[b] == 6]  # fmt: skip
    bodies = [*free, *(b for b in names.targets["body"] if b not in (*free, "world"))]
    for body in bodies:
        found += [
            Place("body_position", body, (), "m", 3),
            Place("body_orientation", body, (), "quaternion", 4),
            Place("body_linear_velocity", body, (), "m/s", 3),
            Place("body_angular_velocity", body, (), "rad/s", 3),
        ]
    return found


def _find_joint(model: "mujoco.MjModel", actuator: int) -> int:
    """The joint that an actuator drives; -1 if it is something else."""
    import mujoco

    at_joint = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    if mujoco.mjtTrn(model.actuator_trntype[actuator]) not in at_joint:
        return -1
    return int(model.actuator_trnid[actuator, 0])


def _find_command_unit(model: "mujoco.MjModel", actuator: int, length: str) -> str:
    """The unit of a servo's command; "" of what is no servo.

    MuJoCo's force is gain * ctrl + bias[0] + bias[1] * position + bias[2] * velocity:
    bias[1] is -gain of a position servo, bias[2] of a velocity servo (MuJoCo, XML
    reference, actuator/position and actuator/velocity).

    Args:
        model: compiled.
        actuator: its number.
        length: unit of the joint's position.
    """
    gain, bias = model.actuator_gainprm[actuator][0], model.actuator_biasprm[actuator]
    if gain > 0 and np.isclose(bias[1], -gain):
        return length
    if gain > 0 and not bias[1] and np.isclose(bias[2], -gain):
        return f"{length}/s"
    return ""


def group_places(places: Sequence[Place]) -> dict[str, list[Place]]:
    """Places by their kind, in the order of the model."""
    found = dict[str, list[Place]]()
    for place in places:
        found.setdefault(place.kind, []).append(place)
    return found
