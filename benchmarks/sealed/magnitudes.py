"""How large an effect is: takes robot, target and generator, gives a function.

That function turns a size, about 1, into the effect's parameters.
"""

import math
from collections.abc import Callable

import mujoco
import numpy as np

from benchmarks.sealed import targets as at
from benchmarks.sealed.mjcf import GRAVITY, Robot

Rng = np.random.Generator
Values = dict[str, float]
Sized = Callable[[float], Values]


def find_load(robot: Robot, target: str) -> float:
    """Typical torque [N m] or force [N] of the joint of a target."""
    return robot.load[at.find_joint(robot, target)]


def find_speed(robot: Robot, target: str) -> float:
    """Typical speed of a joint [rad/s]: its motion once a second."""
    return 2 * math.pi * robot.amplitude[at.find_joint(robot, target)] / 2


def draw_number(key: str, value: float, signed: bool = False):
    """A draw of one parameter that starts from a plain number.

    Args:
        key: name of the parameter.
        value: at size 1.
        signed: whether its sign is drawn too.
    """

    def draw(robot: Robot, target: str, rng: Rng) -> Sized:
        sign = rng.choice([-1.0, 1.0]) if signed else 1.0
        return lambda size: {key: sign * size * value}

    return draw


def find_least_value(robot: Robot, target: str, key: str) -> float:
    """Smallest value of a joint that no refit of the stated one may reach.

    Args:
        robot: the robot as given.
        target: the joint.
        key: attribute in MjSpec.
    """
    joint = mujoco.MjSpec.from_string(robot.xml).joint(at.get_name(target))
    return 1.35 * float(np.ravel(getattr(joint, key))[0])


def draw_damping(robot: Robot, target: str, rng: Rng) -> Sized:
    """Viscous friction that no refit of the stated damping reaches."""
    base = find_load(robot, target) / find_speed(robot, target)
    least = find_least_value(robot, target, "damping")
    return lambda size: {"damping": least + 0.15 * size * base}


def draw_dry_friction(robot: Robot, target: str, rng: Rng) -> Sized:
    """Coulomb friction that no refit of the stated friction loss reaches."""
    least, base = (
        find_least_value(robot, target, "frictionloss"),
        find_load(robot, target),
    )
    return lambda size: {"frictionloss": least + 0.12 * size * base}


def draw_damping2(robot: Robot, target: str, rng: Rng) -> Sized:
    """Quadratic damping, by the load at the typical speed."""
    base = find_load(robot, target) / find_speed(robot, target) ** 2
    return lambda size: {"damping2": 0.15 * size * base}


def draw_stribeck(robot: Robot, target: str, rng: Rng) -> Sized:
    """Stribeck friction: static friction is 2 to 3.5 times Coulomb friction."""
    ratio, slow = rng.uniform(2.0, 3.5), rng.uniform(0.05, 0.2)
    base = 0.08 * find_load(robot, target)

    def values(size: float) -> Values:
        coulomb = size * base
        static = ratio * coulomb
        return {
            "coulomb": coulomb,
            "static": static,
            "stribeck_velocity": slow * find_speed(robot, target) / 4,
        }

    return values


def draw_asymmetric_friction(robot: Robot, target: str, rng: Rng) -> Sized:
    """Coulomb friction that is 2 to 4 times larger in one direction."""
    base, uneven = 0.1 * find_load(robot, target), rng.uniform(2.0, 4.0)
    pair = rng.permutation([1.0, uneven])
    return lambda s: {"positive": s * base * pair[0], "negative": s * base * pair[1]}


def draw_compliance(robot: Robot, target: str, rng: Rng) -> Sized:
    """Stiffness and damping of an elastic transmission; larger sizes are softer."""
    base, lossy = 15 * find_load(robot, target), rng.uniform(0.002, 0.008)
    return lambda s: {"stiffness": base / s, "damping": lossy * base / s}


def draw_cogging(robot: Robot, target: str, rng: Rng) -> Sized:
    """Amplitude, number of poles and phase of a cogging torque."""
    poles, phase = float(rng.integers(6, 25)), rng.uniform(0, 2 * math.pi)
    if robot.name == "cartpole" and target == "joint:j1":
        poles *= 4
    base = 0.15 * find_load(robot, target)
    return lambda s: {"amplitude": s * base, "poles": poles, "phase": phase}


def draw_armature(robot: Robot, target: str, rng: Rng) -> Sized:
    """Armature that no refit of the stated one reaches."""
    typical = find_load(robot, target) / GRAVITY * 0.1
    if robot.name == "cartpole" and target == "joint:j1":
        typical = 0.5
    least = find_least_value(robot, target, "armature")
    return lambda s: {"armature": least + 0.5 * s * typical}


def draw_spring(robot: Robot, target: str, rng: Rng) -> Sized:
    """Stiffness and rest angle of a joint spring."""
    rest = rng.uniform(-0.4, 0.4) * robot.amplitude[at.get_name(target)]
    base = 0.25 * find_load(robot, target) / robot.amplitude[at.get_name(target)]
    return lambda s: {"stiffness": s * base, "springref": rest}


def draw_coupling(robot: Robot, target: str, rng: Rng) -> Sized:
    """Stiffness and ratio of a spring between two joints."""
    ratio = rng.choice([-1, 1]) * rng.uniform(0.5, 1.2)
    base = 0.25 * find_load(robot, target)
    return lambda s: {"stiffness": s * base, "ratio": ratio}


def draw_stop(robot: Robot, target: str, rng: Rng) -> Sized:
    """Angle of a hard stop, inside the range of motion; larger sizes are nearer."""
    joint = at.get_name(target)
    side, reach = rng.choice([-1, 1]), robot.amplitude[joint]
    middle = robot.center.get(joint, 0.0)
    return lambda s: {"range": middle + side * reach * max(0.8 - 0.2 * s, 0.15)}


def draw_torque_limit(robot: Robot, target: str, rng: Rng) -> Sized:
    """Limit of a motor torque; larger sizes are smaller limits."""
    load = find_load(robot, target)
    return lambda s: {"limit": load * max(1.6 / (1 + 0.5 * s), 0.15)}


def draw_speed_limit(robot: Robot, target: str, rng: Rng) -> Sized:
    """Stall torque and no-load speed of a motor; larger sizes are weaker motors."""
    load, speed = find_load(robot, target), find_speed(robot, target)
    stall = rng.uniform(2.0, 3.5)

    def values(size: float) -> Values:
        soft = 1 / (1 + 0.4 * size)
        return {
            "stall_torque": stall * load * (0.5 + soft),
            "no_load_speed": 3.0 * speed * soft,
        }

    return values


def draw_rate(robot: Robot, target: str, rng: Rng) -> Sized:
    """Largest rate of a command; larger sizes are slower."""
    speed = find_speed(robot, target)
    return lambda s: {"rate": 2.0 * speed / (1 + s)}


def draw_kp(robot: Robot, target: str, rng: Rng) -> Sized:
    """Gain of a position servo: below the stated one, or above it in 40 % of cases."""
    spec = mujoco.MjSpec.from_string(robot.xml)
    actuator, more = spec.actuator(at.get_name(target)), rng.random() < 0.4
    given = float(actuator.gainprm[0])
    if more:
        return lambda s: {"kp": given * (1.4 + 0.5 * s)}
    return lambda s: {"kp": given * max(0.65 / (1 + 0.4 * s), 0.2)}


def draw_integral(robot: Robot, target: str, rng: Rng) -> Sized:
    """Integral gain of a servo and the limit of the integral torque."""
    load = find_load(robot, target)
    return lambda s: {"ki": 10 * load * s, "imax": 0.6 * load}


def draw_payload(robot: Robot, target: str, rng: Rng) -> Sized:
    """Mass and place of a payload: at a link's end, or near a free body's center."""
    spec = mujoco.MjSpec.from_string(robot.xml)
    model = spec.compile()
    body = model.body(at.get_name(target))
    mass = body.mass[0]
    if robot.free:
        place = rng.uniform(-0.03, 0.03, 3)
    else:
        place = np.array([0, 0, 2 * body.ipos[2] * rng.uniform(0.7, 1.0)])
    names = dict(zip(("position_x", "position_y", "position_z"), place, strict=True))
    return lambda s: {"mass": 0.35 * s * mass, **names}


def draw_com_shift(robot: Robot, target: str, rng: Rng) -> Sized:
    """A center of mass that moves across the link, where hinges can see it."""
    direction = rng.normal(size=3)
    if not robot.free:
        direction *= [1.0, 0.0, 0.3]
    direction /= np.linalg.norm(direction)
    scale = 0.012 if not robot.contact else 0.008
    return lambda s: dict(zip("xyz", s * scale * direction, strict=True))


def draw_slope(robot: Robot, target: str, rng: Rng) -> Sized:
    """Tilt of the floor and its direction; along the plane of planar robots."""
    planar = not robot.free and robot.name != "arm3"
    azimuth = rng.choice([0.0, math.pi]) if planar else rng.uniform(-math.pi, math.pi)
    return lambda s: {"tilt": 0.04 * s, "azimuth": azimuth}


def draw_wind(robot: Robot, target: str, rng: Rng) -> Sized:
    """Velocity of a horizontal wind."""
    azimuth = rng.uniform(-0.4, 0.4) + rng.choice([0, math.pi])
    speed = 3.0
    direction = [math.cos(azimuth), math.sin(azimuth) if robot.free else 0.0, 0.0]
    return lambda s: dict(
        zip(("vx", "vy", "vz"), [speed * s * d for d in direction], strict=True)
    )


def draw_ground_friction(robot: Robot, target: str, rng: Rng) -> Sized:
    """Sliding friction of the ground, below the given one or, in 35 %, above it."""
    spec = mujoco.MjSpec.from_string(robot.xml)
    spec.compile()
    given = max(float(g.friction[0]) for g in at.find_contact_geoms(spec))
    if rng.random() < 0.35:
        return lambda s: {"friction": given * (1.35 + 0.4 * s)}
    return lambda s: {"friction": given * max(0.65 / (1 + 0.5 * s), 0.1)}


def draw_ground_compliance(robot: Robot, target: str, rng: Rng) -> Sized:
    """Time constant and damping ratio of soft contacts."""
    ratio = rng.uniform(0.5, 1.0)
    return lambda s: {"timeconst": 0.02 * (1 + s), "dampratio": ratio}


def draw_length(robot: Robot, target: str, rng: Rng) -> Sized:
    """Length of a link, shorter or longer than the given one."""
    spec = mujoco.MjSpec.from_string(robot.xml)
    length, sign = at.measure_limb(spec.body(at.get_name(target))), rng.choice([-1, 1])
    return lambda s: {"length": length * max(1 + sign * (0.06 + 0.08 * s), 0.4)}


def draw_mount_shift(robot: Robot, target: str, rng: Rng) -> Sized:
    """Shift of a link's place on its parent, in a random direction."""
    if at.has_limbs(robot):
        direction = rng.normal(size=3) * [1, 0.3, 1]
    else:
        direction = rng.normal(size=3) * [1, 0, 0.3]
    direction /= np.linalg.norm(direction)
    return lambda s: dict(zip("xyz", 0.012 * s * direction, strict=True))


def draw_nothing(robot: Robot, target: str, rng: Rng) -> Sized:
    """No parameters: the effect has no size."""
    return lambda s: {}


def draw_jam_angle(robot: Robot, target: str, rng: Rng) -> Sized:
    """Angle at which a joint is stuck, within its range of motion."""
    joint = at.get_name(target)
    angle = robot.center.get(joint, 0.0) + robot.amplitude[joint] * rng.uniform(-1, 1)
    return lambda s: {"angle": angle * 0.7}


def draw_sensor_gain(robot: Robot, target: str, rng: Rng) -> Sized:
    """Gain of a joint position signal, below or above 1."""
    sign = rng.choice([-1, 1])
    return lambda s: {"gain": max(1 + sign * 0.05 * s, 0.3)}
