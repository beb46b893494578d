"""What joints can have: friction, play, springs and stops."""

import math
from collections.abc import Mapping
from typing import Any

import mujoco
from mujoco import MjData

from benchmarks.hidden.effects.base import (
    Draw,
    Install,
    Joint,
    Sized,
    Values,
    draw_nothing,
    draw_number,
    find_least_value,
    find_load,
    find_speed,
    push_joint,
)
from benchmarks.hidden.robots.robot import GRAVITY, Rng, Robot, get_name
from benchmarks.hidden.truth import HiddenRobot

PLAY = 1e-6  # [kg m^2] rotor inertia of a joint that is added; chosen: negligible
STOP = (0.002, 1.0)  # solref of stops and gaps: as hard as the fine step resolves
FREE = 10.0  # [rad or m] of a range that ends on one side only
_DAMPINGS = ("damping", "damping2")  # a polynomial in MjSpec


def set_joint(key: str) -> Install:
    """What sets a value of the joint, under MJCF's own name."""

    def install(truth: HiddenRobot, target: str, values: Values) -> None:
        joint = truth.spec.joint(get_name(target))
        if key in _DAMPINGS:
            joint.damping[_DAMPINGS.index(key)] = values[key]
        else:
            setattr(joint, key, values[key])

    return install


# ---------------------------------------------------------------- friction


def _draw_damping(robot: Robot, target: str, rng: Rng) -> Sized:
    """Viscous friction that no refit of the stated damping reaches."""
    base = find_load(robot, target) / find_speed(robot, target)
    least = find_least_value(robot, target, "damping")
    return lambda size: {"damping": least + 0.15 * size * base}


def _draw_dry_friction(robot: Robot, target: str, rng: Rng) -> Sized:
    """Coulomb friction that no refit of the stated friction loss reaches."""
    base = find_load(robot, target)
    least = find_least_value(robot, target, "frictionloss")
    return lambda size: {"frictionloss": least + 0.12 * size * base}


def _draw_damping2(robot: Robot, target: str, rng: Rng) -> Sized:
    base = find_load(robot, target) / find_speed(robot, target) ** 2
    return lambda size: {"damping2": 0.15 * size * base}


def _draw_stribeck(robot: Robot, target: str, rng: Rng) -> Sized:
    """Static friction is 2 to 3.5 times Coulomb friction."""
    ratio, slow = rng.uniform(2.0, 3.5), rng.uniform(0.05, 0.2)
    base, speed = 0.08 * find_load(robot, target), find_speed(robot, target)

    def values(size: float) -> Values:
        coulomb, static = size * base, ratio * (size * base)
        velocity = slow * speed / 4
        return {"coulomb": coulomb, "static": static, "stribeck_velocity": velocity}

    return values


def _push_stiction(joint: Joint, v: Values, data: MjData, time: float) -> None:
    """Friction that falls with speed: excess exp(-(v / stribeck_velocity)^2)."""
    ratio = float(data.qvel[joint.dof]) / v["stribeck_velocity"]
    extra = v["excess"] * math.exp(-min(ratio * ratio, 700.0))
    joint.model.dof_frictionloss[joint.dof] += extra


def _install_stribeck(truth: HiddenRobot, target: str, v: Values) -> None:
    truth.spec.joint(get_name(target)).frictionloss = v["coulomb"]
    excess = {**v, "excess": v["static"] - v["coulomb"]}
    push_joint(_push_stiction)(truth, target, excess)


def _push_load_friction(joint: Joint, v: Values, data: MjData, time: float) -> None:
    """Friction = load_coefficient |torque| of the motor, or of motor and load."""
    torque = abs(float(data.qfrc_actuator[joint.dof]))
    if v.get("both", 0.0):
        torque = 0.5 * abs(data.qfrc_actuator[joint.dof] + data.qfrc_bias[joint.dof])
    joint.model.dof_frictionloss[joint.dof] += v["load_coefficient"] * torque


def _draw_asymmetric_friction(robot: Robot, target: str, rng: Rng) -> Sized:
    """Coulomb friction that is 2 to 4 times larger in one direction."""
    base, uneven = 0.1 * find_load(robot, target), rng.uniform(2.0, 4.0)
    pair = rng.permutation([1.0, uneven])
    return lambda s: {"positive": s * base * pair[0], "negative": s * base * pair[1]}


def _install_asymmetric_friction(truth: HiddenRobot, target: str, v: Values) -> None:
    """A symmetric friction and a torque."""
    positive, negative = v["positive"], v["negative"]
    truth.spec.joint(get_name(target)).frictionloss = (positive + negative) / 2
    push_joint(_push_torque)(truth, target, {"torque": (negative - positive) / 2})


def _push_torque(joint: Joint, v: Values, data: MjData, time: float) -> None:
    data.qfrc_applied[joint.dof] += v["torque"]


# ---------------------------------------------------------------- play and springs


def _add_joint(truth: HiddenRobot, target: str, suffix: str, **settings: Any) -> Any:
    """Add a joint between the motor's joint and the link."""
    joint = truth.spec.joint(get_name(target))
    name = f"{joint.name}_{suffix}"
    made = joint.parent.add_joint(
        name=name, type=joint.type, axis=joint.axis, pos=joint.pos, **settings
    )
    truth.plays[joint.name] = name
    return made


def _install_backlash(truth: HiddenRobot, target: str, v: Values) -> None:
    """A free joint with a narrow range."""
    half = v["gap"] / 2
    limits = {"range": [-half, half], "limited": 1, "solref_limit": STOP}
    _add_joint(truth, target, "play", armature=PLAY, **limits)


def _draw_compliance(robot: Robot, target: str, rng: Rng) -> Sized:
    """An elastic transmission; larger sizes are softer."""
    base, lossy = 15 * find_load(robot, target), rng.uniform(0.002, 0.008)
    return lambda s: {"stiffness": base / s, "damping": lossy * base / s}


def _install_compliance(truth: HiddenRobot, target: str, v: Values) -> None:
    flex = _add_joint(truth, target, "flex", armature=PLAY)
    flex.stiffness[0], flex.damping[0] = v["stiffness"], v["damping"]


def _draw_armature(robot: Robot, target: str, rng: Rng) -> Sized:
    """Armature that no refit of the stated one reaches."""
    typical = find_load(robot, target) / GRAVITY * 0.1
    if robot.is_slide(get_name(target)):
        typical = 0.5
    least = find_least_value(robot, target, "armature")
    return lambda s: {"armature": least + 0.5 * s * typical}


def _draw_spring(robot: Robot, target: str, rng: Rng) -> Sized:
    rest = rng.uniform(-0.4, 0.4) * robot.amplitude[get_name(target)]
    base = 0.25 * find_load(robot, target) / robot.amplitude[get_name(target)]
    return lambda s: {"stiffness": s * base, "springref": rest}


def _install_spring(truth: HiddenRobot, target: str, v: Values) -> None:
    joint = truth.spec.joint(get_name(target))
    joint.stiffness[0], joint.springref = v["stiffness"], v["springref"]


def _draw_cogging(robot: Robot, target: str, rng: Rng) -> Sized:
    poles, phase = float(rng.integers(6, 25)), rng.uniform(0, 2 * math.pi)
    if robot.is_slide(get_name(target)):
        poles *= 4
    base = 0.15 * find_load(robot, target)
    return lambda s: {"amplitude": s * base, "poles": poles, "phase": phase}


def _push_cogging(joint: Joint, v: Values, data: MjData, time: float) -> None:
    """Torque = amplitude sin(poles q + phase)."""
    angle = v["poles"] * float(data.qpos[joint.q]) + v["phase"]
    data.qfrc_applied[joint.dof] += v["amplitude"] * math.sin(angle)


def _draw_coupling(robot: Robot, target: str, rng: Rng) -> Sized:
    ratio = rng.choice([-1, 1]) * rng.uniform(0.5, 1.2)
    base = 0.25 * find_load(robot, target)
    return lambda s: {"stiffness": s * base, "ratio": ratio}


def _install_coupling(truth: HiddenRobot, target: str, v: Values) -> None:
    """A tendon that also pulls at the joint before."""
    name, joints = get_name(target), truth.robot.joints
    tendon = truth.spec.add_tendon(name="belt", springlength=[0.0, 0.0])
    tendon.wrap_joint(name, 1.0)
    tendon.wrap_joint(joints[joints.index(name) - 1], -v["ratio"])
    tendon.stiffness[0] = v["stiffness"]


# ---------------------------------------------------------------- stops


def _draw_stop(robot: Robot, target: str, rng: Rng) -> Sized:
    """Angle of a stop, inside the range of motion; larger sizes are nearer."""
    joint = get_name(target)
    side, reach = rng.choice([-1, 1]), robot.amplitude[joint]
    middle = robot.center.get(joint, 0.0)
    return lambda s: {"range": middle + side * reach * max(0.8 - 0.2 * s, 0.15)}


def _install_stop(truth: HiddenRobot, target: str, v: Values) -> None:
    """A hard limit of the joint on one side of its motion."""
    joint, angle = truth.spec.joint(get_name(target)), v["range"]
    above = angle > truth.robot.center.get(joint.name, 0.0)
    joint.range = [-FREE, angle] if above else [angle, FREE]
    joint.limited, joint.solref_limit = 1, (0.005, 1.0)


def _install_range(truth: HiddenRobot, target: str, v: Values) -> None:
    joint = truth.spec.joint(get_name(target))
    joint.range, joint.limited = [v["low"], v["high"]], 1


def _draw_jam_angle(robot: Robot, target: str, rng: Rng) -> Sized:
    """Angle at which a joint is stuck, within its range of motion."""
    joint = get_name(target)
    angle = robot.center.get(joint, 0.0) + robot.amplitude[joint] * rng.uniform(-1, 1)
    return lambda s: {"angle": angle * 0.7}


def _install_jam(truth: HiddenRobot, target: str, v: Values) -> None:
    """A constraint that holds the joint at an angle."""
    joint, angle = get_name(target), v["angle"]
    lock = truth.spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=joint)
    lock.data[:5] = [angle, 0, 0, 0, 0]
    lock.objtype, lock.solref = mujoco.mjtObj.mjOBJ_JOINT, STOP
    truth.pinned[joint] = angle


PHYSICS: Mapping[str, tuple[Draw, Install]] = {
    "viscous_friction": (_draw_damping, set_joint("damping")),
    "coulomb_friction": (_draw_dry_friction, set_joint("frictionloss")),
    "stribeck_friction": (_draw_stribeck, _install_stribeck),
    "load_dependent_friction": (
        draw_number("load_coefficient", 0.15),
        push_joint(_push_load_friction),
    ),
    "asymmetric_friction": (_draw_asymmetric_friction, _install_asymmetric_friction),
    "quadratic_damping": (_draw_damping2, set_joint("damping2")),
    "backlash": (draw_number("gap", 0.02), _install_backlash),
    "compliance": (_draw_compliance, _install_compliance),
    "armature": (_draw_armature, set_joint("armature")),
    "joint_spring": (_draw_spring, _install_spring),
    "cogging": (_draw_cogging, push_joint(_push_cogging)),
    "joint_coupling": (_draw_coupling, _install_coupling),
    "hard_stop": (_draw_stop, _install_stop),
    "joint_jam": (_draw_jam_angle, _install_jam),
    "stiction": (draw_nothing, push_joint(_push_stiction)),
    "joint_range": (draw_nothing, _install_range),
}
