"""How an effect comes into the hidden robot: takes it, a target and parameters."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from benchmarks.sealed import targets as at
from benchmarks.sealed.hidden_robot import (
    HiddenRobot,
    SensorModel,
    scale_gain,
    stretch_body,
)
from benchmarks.sealed.magnitudes import Values
from benchmarks.sealed.mjcf import GRAVITY
from benchmarks.sealed.shapers import apply_torque, integrate_error, limit_by_speed

PLAY = 1e-6  # [kg m^2] rotor inertia of a joint that is added; chosen: negligible
STOP = (0.002, 1.0)  # solref of stops and gaps: as hard as the fine step resolves


def find_joint(truth: HiddenRobot, target: str) -> Any:
    """The joint of a target, in the hidden robot's MjSpec."""
    return truth.spec.joint(at.get_name(target))


def set_joint_value(key: str) -> Callable[[HiddenRobot, str, Values], None]:
    """What sets a value of the joint, under MJCF's own name."""

    def install(truth: HiddenRobot, target: str, values: Values) -> None:
        joint = find_joint(truth, target)
        if key == "damping2":
            joint.damping[1] = values[key]
        elif key == "damping":
            joint.damping[0] = values[key]
        else:
            setattr(joint, key, values[key])

    return install


def install_asymmetric_friction(
    truth: HiddenRobot, target: str, values: Values
) -> None:
    """Coulomb friction that differs by direction: a symmetric one and a torque."""
    positive, negative = values["positive"], values["negative"]
    find_joint(truth, target).frictionloss = (positive + negative) / 2
    truth.forces.append(apply_torque(at.get_name(target), (negative - positive) / 2))


def add_joint(truth: HiddenRobot, target: str, suffix: str, **settings: Any) -> None:
    """Add a joint between the motor's joint and the link.

    Args:
        truth: hidden robot, is changed.
        target: the motor's joint.
        suffix: of the new joint's name.
        settings: more attributes of the new joint.
    """
    joint = find_joint(truth, target)
    name = f"{joint.name}_{suffix}"
    joint.parent.add_joint(
        name=name, type=joint.type, axis=joint.axis, pos=joint.pos, **settings
    )
    truth.plays[joint.name] = name


def install_backlash(truth: HiddenRobot, target: str, values: Values) -> None:
    """A free joint with a narrow range between the motor's joint and the link."""
    half = values["gap"] / 2
    add_joint(
        truth,
        target,
        "play",
        range=[-half, half],
        limited=1,
        armature=PLAY,
        solref_limit=STOP,
    )


def install_compliance(truth: HiddenRobot, target: str, values: Values) -> None:
    """A sprung joint between the motor's joint and the link."""
    add_joint(truth, target, "flex", armature=PLAY)
    flex = truth.spec.joint(truth.plays[at.get_name(target)])
    flex.stiffness[0], flex.damping[0] = values["stiffness"], values["damping"]


def install_spring(truth: HiddenRobot, target: str, values: Values) -> None:
    """A spring of the joint with its rest angle."""
    joint = find_joint(truth, target)
    joint.stiffness[0], joint.springref = values["stiffness"], values["springref"]


def install_coupling(truth: HiddenRobot, target: str, values: Values) -> None:
    """A tendon that also pulls at the joint before."""
    name = at.get_name(target)
    other = truth.robot.joints[truth.robot.joints.index(name) - 1]
    tendon = truth.spec.add_tendon(name="belt", springlength=[0.0, 0.0])
    tendon.wrap_joint(name, 1.0)
    tendon.wrap_joint(other, -values["ratio"])
    tendon.stiffness[0] = values["stiffness"]


def install_stop(truth: HiddenRobot, target: str, values: Values) -> None:
    """A hard limit of the joint on one side of its motion."""
    joint, angle = find_joint(truth, target), values["range"]
    above = angle > truth.robot.center.get(joint.name, 0.0)
    joint.range = [-10.0, angle] if above else [angle, 10.0]
    joint.limited, joint.solref_limit = 1, (0.005, 1.0)


def install_shaper(
    make: Callable[..., Any], key: str
) -> Callable[[HiddenRobot, str, Values], None]:
    """What installs a shaper of an actuator's command.

    Args:
        make: makes it from a parameter and the fine step [s].
        key: name of the parameter.
    """

    def install(truth: HiddenRobot, target: str, values: Values) -> None:
        chain = truth.shapers.setdefault(at.get_name(target), [])
        chain.append(lambda fine: make(values[key], fine))

    return install


def install_saturation(truth: HiddenRobot, target: str, values: Values) -> None:
    """A symmetric limit of the actuator's force."""
    actuator = truth.spec.actuator(at.get_name(target))
    actuator.forcerange = [-values["limit"], values["limit"]]
    actuator.forcelimited = 1


def install_speed_limit(truth: HiddenRobot, target: str, values: Values) -> None:
    """A force limit of the actuator that falls with speed."""
    truth.spec.actuator(at.get_name(target)).forcerange = [-1.0, 1.0]
    truth.spec.actuator(at.get_name(target)).forcelimited = 1
    joint = at.find_joint(truth.robot, target)
    limits = values["stall_torque"], values["no_load_speed"]
    truth.forces.append(limit_by_speed(at.get_name(target), joint, *limits))


def install_gain(truth: HiddenRobot, target: str, values: Values) -> None:
    """Another proportional gain of a position servo."""
    actuator = truth.spec.actuator(at.get_name(target))
    scale_gain(actuator, "kp", values["kp"] / float(actuator.gainprm[0]))


def install_integral_action(truth: HiddenRobot, target: str, values: Values) -> None:
    """A torque that integrates the servo's error."""
    joint = at.find_joint(truth.robot, target)
    truth.forces.append(
        integrate_error(at.get_name(target), joint, values["ki"], values["imax"])
    )


def install_payload(truth: HiddenRobot, target: str, values: Values) -> None:
    """A small massive ball fixed to the body."""
    place = [values[f"position_{c}"] for c in "xyz"]
    child = truth.spec.body(at.get_name(target)).add_body(name="payload", pos=place)
    child.explicitinertial, child.mass = True, values["mass"]
    child.inertia = np.full(3, 0.4 * values["mass"] * 0.01**2)


def install_com_shift(truth: HiddenRobot, target: str, values: Values) -> None:
    """A shift of the body's center of mass."""
    body = truth.spec.body(at.get_name(target))
    body.ipos = body.ipos + [values[c] for c in "xyz"]


def install_slope(truth: HiddenRobot, target: str, values: Values) -> None:
    """Gravity as a tilted floor has it."""
    tilt, way = values["tilt"], values["azimuth"]
    down = np.array([math.sin(tilt) * math.cos(way), math.sin(tilt) * math.sin(way)])
    truth.spec.option.gravity = GRAVITY * np.r_[down, -math.cos(tilt)]


def install_medium(truth: HiddenRobot, target: str, values: Values) -> None:
    """A medium of another density, which drags."""
    truth.spec.option.density = values["density"]


def install_wind(truth: HiddenRobot, target: str, values: Values) -> None:
    """A medium that moves."""
    truth.spec.option.wind = [values[c] for c in ("vx", "vy", "vz")]


def install_ground_friction(truth: HiddenRobot, target: str, values: Values) -> None:
    """Another sliding friction of all geoms that can touch."""
    geoms = at.find_contact_geoms(truth.spec)
    highest = max(g.friction[0] for g in geoms)
    for geom in geoms:
        geom.friction[0] *= values["friction"] / highest


def install_ground_compliance(truth: HiddenRobot, target: str, values: Values) -> None:
    """Softer contacts of all geoms that can touch."""
    for geom in at.find_contact_geoms(truth.spec):
        geom.solref = [values["timeconst"], values["dampratio"]]


def install_link_length(truth: HiddenRobot, target: str, values: Values) -> None:
    """A link of another length, stretched with its mass and inertia."""
    link = truth.spec.body(at.get_name(target))
    stretch_body(link, np.array([1.0, 1.0, values["length"] / at.measure_limb(link)]))


def install_mount_shift(truth: HiddenRobot, target: str, values: Values) -> None:
    """Another place of the body on its parent."""
    body = truth.spec.body(at.get_name(target))
    body.pos = body.pos + [values[c] for c in "xyz"]


def install_limb_loss(truth: HiddenRobot, target: str, values: Values) -> None:
    """A body without mass and without contacts."""
    body = truth.spec.body(at.get_name(target))
    body.mass = 1e-4
    body.inertia = np.full(3, 1e-7)
    body.ipos = np.zeros(3)
    for geom in body.geoms:
        geom.contype = geom.conaffinity = 0


def install_joint_jam(truth: HiddenRobot, target: str, values: Values) -> None:
    """A constraint that holds the joint at an angle."""
    joint, angle = at.get_name(target), values["angle"]
    lock = truth.spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=joint)
    lock.data[:5] = [angle, 0, 0, 0, 0]
    lock.objtype, lock.solref = mujoco.mjtObj.mjOBJ_JOINT, STOP
    truth.pinned[joint] = angle


def install_sensor_error(
    key: str, field: str
) -> Callable[[HiddenRobot, str, Values], None]:
    """A measurement error of a signal.

    Args:
        key: name of the parameter that holds the value.
        field: field of `SensorModel` that it sets; a delay in whole fine steps.
    """

    def install(truth: HiddenRobot, target: str, values: Values) -> None:
        now = truth.readings.get(at.get_name(target), SensorModel())
        value = values[key]
        if field == "delay":
            value = round(value / truth.robot.fine) * truth.robot.fine
            values[key] = value
        truth.readings[at.get_name(target)] = replace(now, **{field: value})

    return install
