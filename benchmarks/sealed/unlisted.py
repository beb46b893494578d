"""Physics that the catalogue does not have: takes a robot, gives edits of its self."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np

from benchmarks.sealed.effects import Effect
from benchmarks.sealed.hidden_robot import Force, HiddenRobot
from benchmarks.sealed.magnitudes import Rng, Sized, Values
from benchmarks.sealed.mjcf import Robot

Push = Force


def _list_arm_joints(robot: Robot) -> list[str]:
    return [f"joint:{j}" for j in robot.joints] if robot.free != "torso" else []


def _list_all_joints(robot: Robot) -> list[str]:
    return [f"joint:{j}" for j in robot.joints]


def _list_paired_joints(robot: Robot) -> list[str]:
    return _list_arm_joints(robot) if len(robot.joints) > 1 else []


def _list_servo_joints(robot: Robot) -> list[str]:
    driven = robot.drive == "servo"
    return [f"joint:{j}" for j in robot.actuators.values()] if driven else []


def _list_flying_bodies(robot: Robot) -> list[str]:
    return [f"body:{robot.free}"] if robot.free and not robot.joints else []


def _draw_share(share: float, **fixed: tuple[float, float]):
    """A "size" that is a share of the joint's load, and other values drawn."""

    def draw(robot: Robot, target: str, rng: Rng) -> Sized:
        name = target.partition(":")[2]
        base = share * robot.load.get(name, 1.0)
        rest = {key: float(rng.uniform(*span)) for key, span in fixed.items()}
        reach = robot.amplitude.get(name, 1.0)
        middle = robot.center.get(name, 0.0)
        return lambda s: {"size": s * base, "reach": reach, "middle": middle, **rest}

    return draw


def _install_force(make: Callable[[Any, HiddenRobot, str, Values], Push]):
    """An install function from a maker of forces."""

    def install(truth: HiddenRobot, target: str, values: Values) -> None:
        name = target.partition(":")[2]

        def compiled(model: Any) -> Force:
            return make(model, truth, name, values)

        truth.forces.append(compiled)

    return install


def _find_addresses(model: Any, joint: str) -> tuple[int, int]:
    found = model.joint(joint)
    return int(found.qposadr[0]), int(found.dofadr[0])


def _apply_rough_spot(model: Any, truth: HiddenRobot, joint: str, v: Values) -> Push:
    """Dry friction in one narrow range of angles only."""
    q, dof = _find_addresses(model, joint)
    dry, center = float(model.dof_frictionloss[dof]), v["middle"] + v["at"] * v["reach"]

    def push(model: Any, data: Any, time: float) -> None:
        off = (float(data.qpos[q]) - center) / (0.12 * v["reach"])
        model.dof_frictionloss[dof] = dry + v["size"] * math.exp(-off * off)

    return push


def _apply_negative_damping(
    model: Any, truth: HiddenRobot, joint: str, v: Values
) -> Push:
    """A push along the motion at middling speeds."""
    dof, fast = _find_addresses(model, joint)[1], v["speed"] * v["reach"]

    def push(model: Any, data: Any, time: float) -> None:
        ratio = float(data.qvel[dof]) / fast
        data.qfrc_applied[dof] += v["size"] * ratio**3 * math.exp(-(ratio**2))

    return push


def _apply_breathing_gain(
    model: Any, truth: HiddenRobot, joint: str, v: Values
) -> Push:
    """A servo whose gain comes and goes."""
    q, dof = _find_addresses(model, joint)
    names = {j: a for a, j in truth.robot.actuators.items()}
    index = model.actuator(names[joint]).id
    stiff = float(model.actuator_gainprm[index, 0])
    control = int(model.actuator_ctrladr[index])

    def push(model: Any, data: Any, time: float) -> None:
        if time < 0:
            return
        wave = min(v["size"] / truth.robot.load[joint], 0.9)
        wave *= math.sin(2 * math.pi * time / v["period"])
        error = float(data.ctrl[control]) - float(data.qpos[q])
        data.qfrc_applied[dof] += wave * stiff * error

    return push


def _apply_crossed_cubic(model: Any, truth: HiddenRobot, joint: str, v: Values) -> Push:
    """Torque with the third power of another joint's speed and angle."""
    joints = list(truth.robot.joints)
    other = joints[joints.index(joint) - 1]
    q, dof = _find_addresses(model, other)[0], _find_addresses(model, joint)[1]
    reach = truth.robot.amplitude[other]

    def push(model: Any, data: Any, time: float) -> None:
        ratio = float(data.qpos[q]) / reach
        ratio = min(max(ratio, -1.5), 1.5)
        data.qfrc_applied[dof] -= v["size"] * (4 * ratio**3 - 3 * ratio)

    return push


def _apply_bouc_wen(model: Any, truth: HiddenRobot, joint: str, v: Values) -> Push:
    """A spring with a memory: dz/dt = w - |w| z |z|, w = speed / yield angle."""
    dof, z = _find_addresses(model, joint)[1], [0.0]
    fine, small = float(model.opt.timestep), v["yield"] * v["reach"]

    def push(model: Any, data: Any, time: float) -> None:
        speed = float(data.qvel[dof]) / small
        z[0] += fine * (speed - abs(speed) * z[0] * abs(z[0]))
        data.qfrc_applied[dof] -= v["size"] * z[0]

    return push


def _apply_bursts(model: Any, truth: HiddenRobot, joint: str, v: Values) -> Push:
    """Random pulses of torque while the joint is in one range of angles."""
    q, dof = _find_addresses(model, joint)
    noise = np.random.default_rng(int(v["seed"] * 2**31))
    center, now = v["middle"] + v["at"] * v["reach"], [0.0, -1.0]

    def push(model: Any, data: Any, time: float) -> None:
        if time > now[1]:
            now[:] = float(noise.normal()), time + 0.06
        if abs(float(data.qpos[q]) - center) < 0.3 * v["reach"]:
            data.qfrc_applied[dof] += v["size"] * now[0]

    return push


def _apply_magnus(model: Any, truth: HiddenRobot, body: str, v: Values) -> Push:
    """A force across the spin and the velocity."""
    mass = float(model.body(body).mass[0])

    def push(model: Any, data: Any, time: float) -> None:
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, data.qpos[3:7])
        spin = turn.reshape(3, 3) @ data.qvel[3:6]
        data.qfrc_applied[:3] += 0.02 * mass * v["size"] * np.cross(spin, data.qvel[:3])

    return push


def _apply_magnet(model: Any, truth: HiddenRobot, body: str, v: Values) -> Push:
    """A pull towards a point of the table, strong when near."""
    mass, point = float(model.body(body).mass[0]), np.array([v["x"], v["y"], 0.0])

    def push(model: Any, data: Any, time: float) -> None:
        away = data.qpos[:3] - point
        pull = 2.0 * mass * v["size"] / (1 + (away @ away) / 0.15**2)
        data.qfrc_applied[:3] -= pull * away / max(np.linalg.norm(away), 0.02)

    return push


def _apply_flywheel(model: Any, truth: HiddenRobot, body: str, v: Values) -> Push:
    """The moment of a rotor that spins inside the body."""
    inertia = float(model.body(body).inertia.max())
    axis = inertia * v["size"] * 3.0 * np.array([v["x"], v["y"], 0.3])

    def push(model: Any, data: Any, time: float) -> None:
        data.qfrc_applied[3:6] -= np.cross(data.qvel[3:6], axis)

    return push


NOWHERE = {"size": "N m"}
AT = (-0.5, 0.5)
SIDE = (-0.3, 0.3)
UNLISTED: Sequence[Effect] = (
    Effect(
        "rough_spot",
        _list_arm_joints,
        _draw_share(0.5, at=AT),
        _install_force(_apply_rough_spot),
        NOWHERE,
    ),
    Effect(
        "negative_damping_band",
        _list_arm_joints,
        _draw_share(0.2, speed=(0.7, 1.5)),
        _install_force(_apply_negative_damping),
        NOWHERE,
    ),
    Effect(
        "breathing_gain",
        _list_servo_joints,
        _draw_share(0.4, period=(0.9, 2.5)),
        _install_force(_apply_breathing_gain),
        NOWHERE,
    ),
    Effect(
        "crossed_cubic",
        _list_paired_joints,
        _draw_share(0.2),
        _install_force(_apply_crossed_cubic),
        NOWHERE,
    ),
    Effect(
        "bouc_wen",
        _list_arm_joints,
        _draw_share(0.2, **{"yield": (0.1, 0.3)}),
        _install_force(_apply_bouc_wen),
        NOWHERE,
    ),
    Effect(
        "angle_bursts",
        _list_all_joints,
        _draw_share(0.3, at=AT, seed=(0.0, 1.0)),
        _install_force(_apply_bursts),
        NOWHERE,
    ),
    Effect(
        "magnus",
        _list_flying_bodies,
        _draw_share(1.0),
        _install_force(_apply_magnus),
        NOWHERE,
    ),
    Effect(
        "magnet",
        _list_flying_bodies,
        _draw_share(1.0, x=SIDE, y=SIDE),
        _install_force(_apply_magnet),
        NOWHERE,
    ),
    Effect(
        "flywheel",
        _list_flying_bodies,
        _draw_share(1.0, x=SIDE, y=SIDE),
        _install_force(_apply_flywheel),
        NOWHERE,
    ),
)
# findings that describe a part of an unlisted effect: wrong, but counted apart
RELATED = {
    "rough_spot": ("coulomb_friction", "stribeck_friction", "asymmetric_friction"),
    "bouc_wen": ("coulomb_friction", "stribeck_friction", "joint_spring"),
    "negative_damping_band": ("viscous_friction", "quadratic_damping"),
    "crossed_cubic": ("joint_coupling",),
}
