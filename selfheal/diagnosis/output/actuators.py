"""Joints and their drives: takes two models, gives what a simulator asks of each joint.

Values are those of the patched model, at the joint: a gear is counted in.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from typing_extensions import TypedDict

from ...recording import find_joint, find_output
from ...recording.actuator_laws import find_goal, find_speed_goal, has_affine_force
from ..effects.limits import find_nominal_limit
from .schema import Document, Finding

if TYPE_CHECKING:
    import mujoco

# effects whose parameters are among the values of a joint
_HELD = {
    "armature",
    "command_delay",
    "coulomb_friction",
    "servo_gain",
    "stribeck_friction",
    "torque_saturation",
    "viscous_friction",
}
_DIGITS = 9  # of a number in a model's text


class JointDrive(TypedDict, total=False):
    """What a model states of a joint and its drive, at the joint; nothing of zeros."""

    armature: float
    frictionloss: float
    viscous_damping: float
    actuator: str
    control: str
    stiffness: float
    damping: float
    delay: float
    gear: float
    effort_limit: float
    static_friction: float
    dynamic_friction: float
    identified: list[str]


class Actuators(TypedDict):
    """The content of actuators.yaml."""

    format: str
    version: int
    model: str
    timestep: float
    joints: dict[str, JointDrive]
    left_out: list[str]


def describe_actuators(
    given: "mujoco.MjModel", patched: "mujoco.MjModel", document: Document, name: str
) -> Actuators:
    """The content of actuators.yaml.

    Args:
        given: the model that was diagnosed, compiled.
        patched: with the findings that its text can say, compiled.
    """
    before = describe_joints(given)
    joints = {n: v for n, v in describe_joints(patched).items() if n in before}
    _add_stribeck(joints, document["findings"])
    joints = {name: values for name, values in joints.items() if values}
    for joint, values in joints.items():
        if new := [k for k, v in values.items() if v != before[joint].get(k)]:
            values["identified"] = new
    return {
        "format": "selfheal-actuators",
        "version": 1,
        "model": name,
        "timestep": float(patched.opt.timestep),
        "joints": joints,
        "left_out": [*_list_other_drives(patched), *_list_other_findings(document)],
    }


def describe_joints(model: "mujoco.MjModel") -> dict[str, JointDrive]:
    """What a model states of its hinges and slides, by their names."""
    import mujoco

    drives, joints = _find_drives(model), map(model.joint, range(model.njnt))
    kinds = [int(k) for k in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)]
    return {
        joint.name: _describe_joint(model, joint.id, drives.get(joint.id, []))
        for joint in joints
        if joint.name and model.jnt_type[joint.id] in kinds
    }


def _find_drives(model: "mujoco.MjModel") -> dict[int, list[int]]:
    """Ids of the actuators of each joint that has some, by its id."""
    found: dict[int, list[int]] = {}
    for actuator in range(model.nactuator):
        found.setdefault(find_joint(model, actuator), []).append(actuator)
    found.pop(-1, None)
    return found


def _describe_joint(model: "mujoco.MjModel", j: int, own: Sequence[int]) -> JointDrive:
    """What a model states of a joint with its own actuators."""
    dof, stated = int(model.jnt_dofadr[j]), JointDrive()
    gears = [float(model.actuator_gear[find_output(model, a), 0]) for a in own]
    squares, drives = np.square(gears), list(own)
    if armature := model.dof_armature[dof] + sum(
        squares * model.actuator_armature[drives]
    ):
        stated["armature"] = _round(armature)
    if friction := model.dof_frictionloss[dof]:
        stated["frictionloss"] = _round(friction)
    if damping := model.dof_damping[dof] + sum(
        squares * model.actuator_damping[drives]
    ):
        stated["viscous_damping"] = _round(damping)
    if len(own) == 1:
        stated.update(_describe_drive(model, own[0], gears[0]))
    if len(own) <= 1 and (effort := _find_effort_limit(model, j, own)):
        stated["effort_limit"] = effort
    return stated


def _describe_drive(model: "mujoco.MjModel", actuator: int, gear: float) -> JointDrive:
    """The control law of an actuator; empty where it has no other name than its own."""
    if not has_affine_force(model, actuator) or model.actuator_dyntype[actuator]:
        return {}
    law = JointDrive(actuator=model.actuator(actuator).name)
    gain = float(model.actuator_gainprm[actuator, 0])
    bias, scale = model.actuator_biasprm[actuator], gear
    if find_goal(model, actuator) >= 0:
        law["control"] = "position"
        law["stiffness"] = _round(gain * gear**2)
        law["damping"] = _round(-float(bias[2]) * gear**2)
    elif find_speed_goal(model, actuator) >= 0:
        law["control"], law["damping"] = "velocity", _round(gain * gear**2)
    elif not bias.any():
        law["control"], scale = "effort", gain * gear
    else:
        return {}
    if delay := _round(model.actuator_delay[actuator]):
        law["delay"] = delay
    # of a servo: command over the joint's goal; of a motor: effort over command
    if _round(scale) != 1:
        law["gear"] = _round(scale)
    return law


def _find_effort_limit(
    model: "mujoco.MjModel", j: int, own: Sequence[int]
) -> float | None:
    """The largest effort at a joint; None where nothing limits it."""
    if own:
        limit = find_nominal_limit(model, own[0])
    elif model.jnt_actfrclimited[j]:
        limit = float(np.abs(model.jnt_actfrcrange[j]).max())
    else:
        return None
    return _round(limit) if np.isfinite(limit) else None


def _add_stribeck(joints: dict[str, JointDrive], findings: Sequence[Finding]) -> None:
    """Add dry friction that is larger at rest, which takes the place of the model's."""
    for finding in findings:
        name = finding["target"].partition(":")[2]
        if finding["effect"] == "stribeck_friction" and name in joints:
            values = {p["name"]: cast(float, p["value"]) for p in finding["parameters"]}
            joints[name].pop("frictionloss", None)
            joints[name]["static_friction"] = _round(values["static"])
            joints[name]["dynamic_friction"] = _round(values["coulomb"])


def _list_other_drives(model: "mujoco.MjModel") -> list[str]:
    """Actuators that drive no joint alone by a law that has a name."""
    alone = {own[0] for own in _find_drives(model).values() if len(own) == 1}
    return [
        f"actuator {model.actuator(a).name}: it does not drive one joint alone, by "
        "position, velocity or effort"
        for a in range(model.nactuator)
        if a not in alone or not _describe_drive(model, a, 1.0)
    ]


def _list_other_findings(document: Document) -> list[str]:
    """Findings at joints and actuators that are no value of a joint, in words."""
    said = [document["unpatched"]] if "unpatched" in document else []
    for finding in document["findings"]:
        kind, name = finding["target"].partition(":")[0], finding["effect"]
        if kind in ("joint", "actuator") and name not in _HELD:
            numbers = [
                f"{p['name']} {p['value']:.4g} {p.get('unit', '')}".strip()
                for p in finding["parameters"]
                if isinstance(p["value"], int | float)
            ]
            said.append(f"{name} at {finding['target']}: {', '.join(numbers)}")
    return said


def _round(value: float) -> float:
    """A number in the digits of a model's text."""
    return float(f"{float(value):.{_DIGITS}g}")
