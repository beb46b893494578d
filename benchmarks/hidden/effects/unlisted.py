"""Physics that the catalogue does not have: forces of joints and of flying bodies."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from mujoco import MjData

from benchmarks.hidden.effects.base import (
    Draw,
    Install,
    Joint,
    Sized,
    Values,
    make_joint_force,
    push_joint,
)
from benchmarks.hidden.robots.robot import Rng, Robot, get_name
from benchmarks.hidden.truth import Force, HiddenRobot


def _draw_share(share: float, **fixed: tuple[float, float]) -> Draw:
    """A "size" that is a share of the joint's load, and other values drawn."""

    def draw(robot: Robot, target: str, rng: Rng) -> Sized:
        name = get_name(target)
        base = share * robot.load.get(name, 1.0)
        rest = {key: float(rng.uniform(*span)) for key, span in fixed.items()}
        reach = robot.amplitude.get(name, 1.0)
        middle = robot.center.get(name, 0.0)
        return lambda s: {"size": s * base, "reach": reach, "middle": middle, **rest}

    return draw


Push = Callable[[float, np.ndarray, Values, Any], None]


def _push_body(push: Push) -> Install:
    """What installs a force at the flying body of a target.

    Args:
        push: gets the body's mass [kg], inertia (3), the parameters and MjData.
    """

    def install(truth: HiddenRobot, target: str, v: Values) -> None:
        def make(model: mujoco.MjModel) -> Force:
            body = model.body(get_name(target))
            mass, inertia = float(body.mass[0]), body.inertia.copy()
            return lambda data, time: push(mass, inertia, v, data)

        truth.forces.append(make)

    return install


def _push_rough_spot(joint: Joint, v: Values, data: MjData, time: float) -> None:
    """Dry friction in one narrow range of angles only."""
    center = v["middle"] + v["at"] * v["reach"]
    off = (float(data.qpos[joint.q]) - center) / (0.12 * v["reach"])
    joint.model.dof_frictionloss[joint.dof] += v["size"] * math.exp(-off * off)


def _push_negative_damping(joint: Joint, v: Values, data: MjData, time: float) -> None:
    """A push along the motion at middling speeds."""
    ratio = float(data.qvel[joint.dof]) / (v["speed"] * v["reach"])
    data.qfrc_applied[joint.dof] += v["size"] * ratio**3 * math.exp(-(ratio**2))


def _push_breathing_gain(joint: Joint, v: Values, data: MjData, time: float) -> None:
    """A servo whose gain comes and goes."""
    if time < 0:
        return
    most = min(v["size"] / joint.robot.load[joint.name], 0.9)
    wave = most * math.sin(2 * math.pi * time / v["period"])
    error = float(data.ctrl[joint.control]) - float(data.qpos[joint.q])
    data.qfrc_applied[joint.dof] += wave * joint.stiffness * error


def _make_crossed_cubic(joint: Joint, v: Values) -> Force:
    """Torque with the third power of another joint's angle."""
    joints = joint.robot.joints
    name = joints[joints.index(joint.name) - 1]
    other, reach = replace(joint, name=name), joint.robot.amplitude[name]

    def push(data: MjData, time: float) -> None:
        ratio = min(max(float(data.qpos[other.q]) / reach, -1.5), 1.5)
        data.qfrc_applied[joint.dof] -= v["size"] * (4 * ratio**3 - 3 * ratio)

    return push


def _make_bouc_wen(joint: Joint, v: Values) -> Force:
    """A spring with a memory: dz/dt = w - |w| z |z|, w = speed / yield angle."""
    z, fine, small = [0.0], float(joint.model.opt.timestep), v["yield"] * v["reach"]

    def push(data: MjData, time: float) -> None:
        speed = float(data.qvel[joint.dof]) / small
        z[0] += fine * (speed - abs(speed) * z[0] * abs(z[0]))
        data.qfrc_applied[joint.dof] -= v["size"] * z[0]

    return push


def _make_bursts(joint: Joint, v: Values) -> Force:
    """Random pulses of torque while the joint is in one range of angles."""
    noise = np.random.default_rng(int(v["seed"] * 2**31))
    center, now = v["middle"] + v["at"] * v["reach"], [0.0, -1.0]

    def push(data: MjData, time: float) -> None:
        if time > now[1]:
            now[:] = float(noise.normal()), time + 0.06
        if abs(float(data.qpos[joint.q]) - center) < 0.3 * v["reach"]:
            data.qfrc_applied[joint.dof] += v["size"] * now[0]

    return push


def _push_magnus(mass: float, inertia: np.ndarray, v: Values, data: MjData) -> None:
    """A force across the spin and the velocity."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, data.qpos[3:7])
    spin = turn.reshape(3, 3) @ data.qvel[3:6]
    data.qfrc_applied[:3] += 0.02 * mass * v["size"] * np.cross(spin, data.qvel[:3])


def _push_magnet(mass: float, inertia: np.ndarray, v: Values, data: MjData) -> None:
    """A pull towards a point of the table, strong when near."""
    away = data.qpos[:3] - np.array([v["x"], v["y"], 0.0])
    pull = 2.0 * mass * v["size"] / (1 + (away @ away) / 0.15**2)
    data.qfrc_applied[:3] -= pull * away / max(np.linalg.norm(away), 0.02)


def _push_flywheel(mass: float, inertia: np.ndarray, v: Values, data: MjData) -> None:
    """The moment of a rotor that spins inside the body."""
    size = float(inertia.max()) * v["size"] * 3.0
    axis = size * np.array([v["x"], v["y"], 0.3])
    data.qfrc_applied[3:6] -= np.cross(data.qvel[3:6], axis)


AT, SIDE = (-0.5, 0.5), (-0.3, 0.3)
PHYSICS: Mapping[str, tuple[Draw, Install]] = {
    "rough_spot": (_draw_share(0.5, at=AT), push_joint(_push_rough_spot)),
    "negative_damping_band": (
        _draw_share(0.2, speed=(0.7, 1.5)),
        push_joint(_push_negative_damping),
    ),
    "breathing_gain": (
        _draw_share(0.4, period=(0.9, 2.5)),
        push_joint(_push_breathing_gain),
    ),
    "crossed_cubic": (_draw_share(0.2), make_joint_force(_make_crossed_cubic)),
    "bouc_wen": (
        _draw_share(0.2, **{"yield": (0.1, 0.3)}),
        make_joint_force(_make_bouc_wen),
    ),
    "angle_bursts": (
        _draw_share(0.3, at=AT, seed=(0.0, 1.0)),
        make_joint_force(_make_bursts),
    ),
    "magnus": (_draw_share(1.0), _push_body(_push_magnus)),
    "magnet": (_draw_share(1.0, x=SIDE, y=SIDE), _push_body(_push_magnet)),
    "flywheel": (_draw_share(1.0, x=SIDE, y=SIDE), _push_body(_push_flywheel)),
}
# findings that describe a part of an unlisted effect: wrong, but counted apart
RELATED = {
    "rough_spot": ("coulomb_friction", "stribeck_friction", "asymmetric_friction"),
    "bouc_wen": ("coulomb_friction", "stribeck_friction", "joint_spring"),
    "negative_damping_band": ("viscous_friction", "quadratic_damping"),
    "crossed_cubic": ("joint_coupling",),
}
