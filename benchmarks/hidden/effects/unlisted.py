"""Physics that the catalogue does not have: forces of joints and of flying bodies."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from benchmarks.hidden.effects.base import (
    Draw,
    Effect,
    Install,
    Joint,
    Sized,
    Values,
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


def _push_body(make: Callable[..., Force]) -> Install:
    """What installs a force at the flying body of a target."""

    def install(truth: HiddenRobot, target: str, v: Mapping[str, Any]) -> None:
        truth.forces.append(lambda model: make(model.body(get_name(target)), v))

    return install


def _push_rough_spot(joint: Joint, v: Values) -> Force:
    """Dry friction in one narrow range of angles only."""
    model, q, dof = joint.model, joint.q, joint.dof
    center = v["middle"] + v["at"] * v["reach"]

    def push(data: Any, time: float) -> None:
        off = (float(data.qpos[q]) - center) / (0.12 * v["reach"])
        model.dof_frictionloss[dof] += v["size"] * math.exp(-off * off)

    return push


def _push_negative_damping(joint: Joint, v: Values) -> Force:
    """A push along the motion at middling speeds."""
    dof, fast = joint.dof, v["speed"] * v["reach"]

    def push(data: Any, time: float) -> None:
        ratio = float(data.qvel[dof]) / fast
        data.qfrc_applied[dof] += v["size"] * ratio**3 * math.exp(-(ratio**2))

    return push


def _push_breathing_gain(joint: Joint, v: Values) -> Force:
    """A servo whose gain comes and goes."""
    q, dof, control = joint.q, joint.dof, joint.control
    stiff = float(joint.model.actuator_gainprm[joint.actuator, 0])
    most = min(v["size"] / joint.robot.load[joint.name], 0.9)

    def push(data: Any, time: float) -> None:
        if time < 0:
            return
        wave = most * math.sin(2 * math.pi * time / v["period"])
        error = float(data.ctrl[control]) - float(data.qpos[q])
        data.qfrc_applied[dof] += wave * stiff * error

    return push


def _push_crossed_cubic(joint: Joint, v: Values) -> Force:
    """Torque with the third power of another joint's angle."""
    joints = joint.robot.joints
    name = joints[joints.index(joint.name) - 1]
    q, dof = Joint(joint.robot, name, joint.model).q, joint.dof
    reach = joint.robot.amplitude[name]

    def push(data: Any, time: float) -> None:
        ratio = min(max(float(data.qpos[q]) / reach, -1.5), 1.5)
        data.qfrc_applied[dof] -= v["size"] * (4 * ratio**3 - 3 * ratio)

    return push


def _push_bouc_wen(joint: Joint, v: Values) -> Force:
    """A spring with a memory: dz/dt = w - |w| z |z|, w = speed / yield angle."""
    dof, z = joint.dof, [0.0]
    fine, small = float(joint.model.opt.timestep), v["yield"] * v["reach"]

    def push(data: Any, time: float) -> None:
        speed = float(data.qvel[dof]) / small
        z[0] += fine * (speed - abs(speed) * z[0] * abs(z[0]))
        data.qfrc_applied[dof] -= v["size"] * z[0]

    return push


def _push_bursts(joint: Joint, v: Values) -> Force:
    """Random pulses of torque while the joint is in one range of angles."""
    q, dof = joint.q, joint.dof
    noise = np.random.default_rng(int(v["seed"] * 2**31))
    center, now = v["middle"] + v["at"] * v["reach"], [0.0, -1.0]

    def push(data: Any, time: float) -> None:
        if time > now[1]:
            now[:] = float(noise.normal()), time + 0.06
        if abs(float(data.qpos[q]) - center) < 0.3 * v["reach"]:
            data.qfrc_applied[dof] += v["size"] * now[0]

    return push


def _push_magnus(body: Any, v: Values) -> Force:
    """A force across the spin and the velocity."""
    mass = float(body.mass[0])

    def push(data: Any, time: float) -> None:
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, data.qpos[3:7])
        spin = turn.reshape(3, 3) @ data.qvel[3:6]
        data.qfrc_applied[:3] += 0.02 * mass * v["size"] * np.cross(spin, data.qvel[:3])

    return push


def _push_magnet(body: Any, v: Values) -> Force:
    """A pull towards a point of the table, strong when near."""
    mass, point = float(body.mass[0]), np.array([v["x"], v["y"], 0.0])

    def push(data: Any, time: float) -> None:
        away = data.qpos[:3] - point
        pull = 2.0 * mass * v["size"] / (1 + (away @ away) / 0.15**2)
        data.qfrc_applied[:3] -= pull * away / max(np.linalg.norm(away), 0.02)

    return push


def _push_flywheel(body: Any, v: Values) -> Force:
    """The moment of a rotor that spins inside the body."""
    inertia = float(body.inertia.max())
    axis = inertia * v["size"] * 3.0 * np.array([v["x"], v["y"], 0.3])

    def push(data: Any, time: float) -> None:
        data.qfrc_applied[3:6] -= np.cross(data.qvel[3:6], axis)

    return push


SIZE = {"size": "N m"}
AT = (-0.5, 0.5)
SIDE = (-0.3, 0.3)
# fmt: off
UNLISTED: Sequence[Effect] = (
    Effect("rough_spot", "arm joint", _draw_share(0.5, at=AT),
           push_joint(_push_rough_spot), SIZE),
    Effect("negative_damping_band", "arm joint", _draw_share(0.2, speed=(0.7, 1.5)),
           push_joint(_push_negative_damping), SIZE),
    Effect("breathing_gain", "servo joint", _draw_share(0.4, period=(0.9, 2.5)),
           push_joint(_push_breathing_gain), SIZE),
    Effect("crossed_cubic", "one of several joint", _draw_share(0.2),
           push_joint(_push_crossed_cubic), SIZE),
    Effect("bouc_wen", "arm joint", _draw_share(0.2, **{"yield": (0.1, 0.3)}),
           push_joint(_push_bouc_wen), SIZE),
    Effect("angle_bursts", "any joint", _draw_share(0.3, at=AT, seed=(0.0, 1.0)),
           push_joint(_push_bursts), SIZE),
    Effect("magnus", "flying body", _draw_share(1.0), _push_body(_push_magnus), SIZE),
    Effect("magnet", "flying body", _draw_share(1.0, x=SIDE, y=SIDE),
           _push_body(_push_magnet), SIZE),
    Effect("flywheel", "flying body", _draw_share(1.0, x=SIDE, y=SIDE),
           _push_body(_push_flywheel), SIZE),
)
# fmt: on
# findings that describe a part of an unlisted effect: wrong, but counted apart
RELATED = {
    "rough_spot": ("coulomb_friction", "stribeck_friction", "asymmetric_friction"),
    "bouc_wen": ("coulomb_friction", "stribeck_friction", "joint_spring"),
    "negative_damping_band": ("viscous_friction", "quadratic_damping"),
    "crossed_cubic": ("joint_coupling",),
}
