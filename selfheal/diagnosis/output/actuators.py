"""Joints and their drives: takes two models, gives what a simulator asks of each joint.

Values are those of the patched model, at the joint: a gear is counted in.
"""

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...recording import find_joint, find_output
from ...recording.actuator_laws import find_goal, find_speed_goal, has_affine_force
from ..effects.limits import find_nominal_limit

if TYPE_CHECKING:
    import mujoco

# effects whose parameters are among the values of a joint
_HELD = (
    "armature", "command_delay", "coulomb_friction", "servo_gain", "stribeck_friction",
    "torque_saturation", "viscous_friction",
)  # fmt: skip
_OF_DRIVES = ("joint", "actuator")  # targets of effects that belong to a joint's drive
_DIGITS = 9  # of a number in a model's text


def describe_actuators(
    given: "mujoco.MjModel",
    patched: "mujoco.MjModel",
    document: Mapping[str, Any],
    name: str,
) -> dict[str, Any]:
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
        new = [k for k, v in values.items() if v != before[joint].get(k)]
        if new:
            values["identified"] = new
    return {
        "format": "selfheal-actuators",
        "version": 1,
        "model": name,
        "timestep": float(patched.opt.timestep),
        "joints": joints,
        "left_out": [*_list_other_drives(patched), *_list_other_findings(document)],
    }


def _list_joints(model: "mujoco.MjModel") -> list[str]:
    """Names of the hinges and slides."""
    import mujoco

    kinds = [int(k) for k in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)]
    names = [
        model.joint(int(j)).name for j in np.flatnonzero(np.isin(model.jnt_type, kinds))
    ]
    return [name for name in names if name]


def describe_joints(model: "mujoco.MjModel") -> dict[str, dict[str, Any]]:
    """What a model states of its hinges and slides, by their names."""
    drives = _find_drives(model)
    return {n: _describe_joint(model, n, drives) for n in _list_joints(model)}


def _find_drives(model: "mujoco.MjModel") -> dict[int, list[int]]:
    """Ids of the actuators of each joint that has some, by its id."""
    found: dict[int, list[int]] = {}
    for actuator in range(model.nactuator):
        found.setdefault(find_joint(model, actuator), []).append(actuator)
    found.pop(-1, None)
    return found


def _describe_joint(
    model: "mujoco.MjModel", name: str, drives: Mapping[int, list[int]]
) -> dict[str, Any]:
    """What a model states of a joint; what is zero it does not state."""
    j = model.joint(name).id
    dof, own = int(model.jnt_dofadr[j]), drives.get(j, [])
    gears = {a: float(model.actuator_gear[find_output(model, a), 0]) for a in own}
    values = {
        "armature": model.dof_armature[dof]
        + sum(gears[a] ** 2 * model.actuator_armature[a] for a in own),
        "frictionloss": model.dof_frictionloss[dof],
        "viscous_damping": model.dof_damping[dof]
        + sum(gears[a] ** 2 * model.actuator_damping[a] for a in own),
    }
    stated: dict[str, Any] = {k: _round(v) for k, v in values.items() if v}
    if len(own) == 1:
        stated |= _describe_drive(model, own[0], gears[own[0]])
    drive = own[0] if own else None
    if len(own) <= 1 and (effort := _find_effort_limit(model, j, drive)):
        stated["effort_limit"] = effort
    return stated


def _describe_drive(
    model: "mujoco.MjModel", actuator: int, gear: float
) -> dict[str, Any]:
    """The control law of an actuator; empty where it has no other name than its own."""
    gain = float(model.actuator_gainprm[actuator, 0])
    kv = -float(model.actuator_biasprm[actuator, 2])
    law: dict[str, Any]
    if not has_affine_force(model, actuator) or model.actuator_dyntype[actuator]:
        return {}
    if find_goal(model, actuator) >= 0:
        law = {
            "control": "position",
            "stiffness": gain * gear**2,
            "damping": kv * gear**2,
        }
        scale = gear
    elif find_speed_goal(model, actuator) >= 0:
        law, scale = {"control": "velocity", "damping": gain * gear**2}, gear
    elif not model.actuator_biasprm[actuator].any():
        law, scale = {"control": "effort"}, gain * gear
    else:
        return {}
    law = {k: _round(v) if isinstance(v, float) else v for k, v in law.items()}
    if delay := _round(model.actuator_delay[actuator]):
        law["delay"] = delay
    # of a servo: command over the joint's goal; of a motor: effort over command
    return {"actuator": model.actuator(actuator).name, **law} | (
        {"gear": _round(scale)} if _round(scale) != 1 else {}
    )


def _find_effort_limit(
    model: "mujoco.MjModel", j: int, drive: int | None
) -> float | None:
    """The largest effort at a joint; None where nothing limits it."""
    if drive is not None:
        limit = find_nominal_limit(model, drive)
    elif model.jnt_actfrclimited[j]:
        limit = float(np.abs(model.jnt_actfrcrange[j]).max())
    else:
        return None
    return _round(limit) if np.isfinite(limit) else None


def _add_stribeck(
    joints: dict[str, dict[str, Any]], findings: Collection[Mapping[str, Any]]
) -> None:
    """Add dry friction that is larger at rest, which takes the place of the model's."""
    for finding in findings:
        name = finding["target"].partition(":")[2]
        if finding["effect"] == "stribeck_friction" and name in joints:
            values = {p["name"]: p["value"] for p in finding["parameters"]}
            joints[name].pop("frictionloss", None)
            joints[name] |= {
                "static_friction": _round(values["static"]),
                "dynamic_friction": _round(values["coulomb"]),
            }


def _list_other_drives(model: "mujoco.MjModel") -> list[str]:
    """Actuators that drive no joint alone by a law that has a name."""
    alone = {own[0] for own in _find_drives(model).values() if len(own) == 1}
    return [
        f"actuator {model.actuator(a).name}: it does not drive one joint alone, by "
        "position, velocity or effort"
        for a in range(model.nactuator)
        if a not in alone or not _describe_drive(model, a, 1.0)
    ]


def _list_other_findings(document: Mapping[str, Any]) -> list[str]:
    """Findings at joints and actuators that are no value of a joint, in words."""
    said = [document["unpatched"]] if "unpatched" in document else []
    for finding in document["findings"]:
        if finding["target"].partition(":")[0] in _OF_DRIVES:
            if finding["effect"] not in _HELD:
                numbers = [
                    f"{p['name']} {p['value']:.4g} {p.get('unit', '')}".strip()
                    for p in finding["parameters"]
                    if isinstance(p["value"], int | float)
                ]
                said.append(
                    f"{finding['effect']} at {finding['target']}: {', '.join(numbers)}"
                )
    return said


def _round(value: float) -> float:
    """A number in the digits of a model's text."""
    return float(f"{float(value):.{_DIGITS}g}")
