"""What an effect is: where it can be, how large it is, and how a robot gets it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import mujoco
import numpy as np
from mujoco import MjData

from benchmarks.hidden.robots.robot import Rng, Robot, get_name
from benchmarks.hidden.truth import Force, HiddenRobot

Values = dict[str, float]
Sized = Callable[[float], Values]  # of a size, about 1
Draw = Callable[[Robot, str, Rng], Sized]
Install = Callable[[HiddenRobot, str, Values], None]

_ARMS = ("arm2_servo", "arm2_torque", "arm3", "double_pendulum")
_FAST = ("pendulum", "double_pendulum", "cartpole", "toss_box", "toss_stick")


def _list_arm_joints(robot: Robot) -> Sequence[str]:
    return () if robot.legged else robot.joints


def _list_servos(robot: Robot) -> Sequence[str]:
    return tuple(robot.actuators) if robot.drive == "servo" else ()


def _list_load_bodies(robot: Robot) -> Sequence[str]:
    return [robot.free] if robot.free else [b for b in robot.links if b != "cart"]


def _list_long_links(robot: Robot) -> Sequence[str]:
    if robot.legged:
        return [b for b in robot.links if b.endswith("lower")]
    return robot.links[:1] if robot.name in _ARMS else ()


def _list_mounted_links(robot: Robot) -> Sequence[str]:
    if robot.legged:
        return [b for b in robot.links if b.endswith("upper")]
    return ["link2"] if robot.name in _ARMS and robot.name != "arm3" else ()


def _list_driven_arm_joints(robot: Robot) -> Sequence[str]:
    arm = not robot.legged and robot.name != "cartpole"
    return tuple(robot.actuators.values()) if arm else ()


# what can have an effect: names of the kind of target that the last word says
_PLACES: Mapping[str, Callable[[Robot], Sequence[str]]] = {
    "any joint": lambda r: r.joints,
    "arm joint": _list_arm_joints,
    "driven arm joint": _list_driven_arm_joints,
    "servo joint": lambda r: tuple(r.actuators.values()) if _list_servos(r) else (),
    "one of several joint": lambda r: _list_arm_joints(r) if len(r.joints) > 1 else (),
    "coupled joint": lambda r: r.joints[-1:] if r.name in _ARMS else (),
    # one that can jam while others still move
    "jammable joint": lambda r: (
        r.joints[1:] if r.name in ("arm2_servo", "arm3", "quadruped") else ()
    ),
    "any actuator": lambda r: tuple(r.actuators),
    "servo actuator": _list_servos,
    "arm servo actuator": lambda r: () if r.legged else _list_servos(r),
    "position sensor": lambda r: [f"{j}_position" for j in r.joints],
    "loaded body": _list_load_bodies,
    # one whose center of mass can be seen to move
    "shiftable body": lambda r: () if r.name == "pendulum" else _list_load_bodies(r),
    # links whose length, and whose place on their parent, shows in the motion
    "long body": _list_long_links,
    "mounted body": _list_mounted_links,
    "losable body": lambda r: [b for b in r.links if "lower" in b] if r.legged else (),
    "flying body": lambda r: [r.free] if r.free and not r.joints else (),
    # where a slope is more than a bias of one sensor
    "tiltable world": lambda r: () if r.name == "pendulum" else ("",),
    # where bodies are fast enough to feel a medium
    "fast world": lambda r: ("",) if r.name in _FAST else (),
    "floor world": lambda r: ("",) if r.contact else (),
}


@dataclass(frozen=True)
class Effect:
    """One concealed effect.

    Attributes:
        draw: gives a function from a size (about 1) to its parameters.
        name: of contract section 4.
        where: which of a robot's joints, bodies and so on can have it.
        sizes: smallest and largest size that is still sane.
        zeroes: values that the given model must not state, "{}" being the target; "?":
            in half of the cases.
        density: [kg/m^3] of the medium that the given model states.
    """

    draw: Draw
    install: Install
    name: str
    where: str
    units: Mapping[str, str]
    sizes: tuple[float, float] = (0.05, 20.0)
    zeroes: tuple[str, ...] = ()
    density: tuple[float, ...] = ()

    def list_targets(self, robot: Robot) -> list[str]:
        """Where it can be on a robot; empty: nowhere."""
        kind = self.where.split()[-1]
        names = _PLACES[self.where](robot)
        return [f"{kind}:{name}".removesuffix(":") for name in names]

    def choose_omissions(self, target: str, rng: Rng) -> tuple[frozenset[str], float]:
        """What the given model must not state for it, and its medium's density.

        Returns:
            Attributes that are stated as 0, as "damping:j1", and the density [kg/m^3].
        """
        zero = []
        for text in self.zeroes:
            maybe = text.endswith("?")
            if not maybe or rng.random() < 0.5:
                zero.append(text.rstrip("?").format(get_name(target)))
        density = float(rng.choice(self.density)) if self.density else 0.0
        return frozenset(zero), density


@dataclass(frozen=True)
class PlacedEffect:
    """An effect at a place, with what it is made of.

    Attributes:
        strength: error over noise, as it is and after a refit.
    """

    effect: Effect
    target: str
    values: Values
    strength: tuple[float, float] = (0.0, 0.0)


# ---------------------------------------------------------------- sizes


def find_load(robot: Robot, target: str) -> float:
    """Typical torque [N m] or force [N] of the joint of a target."""
    return robot.load[robot.find_joint(target)]


def find_speed(robot: Robot, target: str) -> float:
    """Typical speed of a joint [rad/s]: its motion once a second."""
    return 2 * math.pi * robot.amplitude[robot.find_joint(target)] / 2


def find_least_value(robot: Robot, target: str, key: str) -> float:
    """Smallest value of a joint that no refit of the stated one may reach."""
    joint = robot.read_spec().joint(get_name(target))
    return 1.35 * float(np.ravel(getattr(joint, key))[0])


def draw_number(key: str, value: float) -> Draw:
    """A draw of one parameter that has this value at size 1."""
    return lambda robot, target, rng: lambda size: {key: size * value}


def draw_signed(key: str, value: float) -> Draw:
    """A draw of one parameter that has this value at size 1, of either sign."""

    def draw(robot: Robot, target: str, rng: Rng) -> Sized:
        sign = rng.choice([-1.0, 1.0])
        return lambda size: {key: sign * size * value}

    return draw


def draw_nothing(robot: Robot, target: str, rng: Rng) -> Sized:
    """No parameters: the effect has no size, or is not drawn by size."""
    return lambda s: {}


# ---------------------------------------------------------------- forces


@dataclass(frozen=True)
class Joint:
    """A joint of the compiled hidden robot."""

    robot: Robot
    name: str
    model: mujoco.MjModel

    @cached_property
    def q(self) -> int:
        """Its place in qpos."""
        return int(self.model.joint(self.name).qposadr[0])

    @cached_property
    def dof(self) -> int:
        """Its place in qvel."""
        return int(self.model.joint(self.name).dofadr[0])

    @cached_property
    def actuator(self) -> int:
        """The number of what moves it."""
        return int(self.model.actuator(self.robot.find_actuator(self.name)).id)

    @cached_property
    def control(self) -> int:
        """The place of its command in ctrl."""
        return int(self.model.actuator_ctrladr[self.actuator])

    @cached_property
    def stiffness(self) -> float:
        """Of the servo that moves it [N m/rad]."""
        return float(self.model.actuator_gainprm[self.actuator, 0])


def push_joint(push: Callable[[Joint, Values, MjData, float], None]) -> Install:
    """What installs a force at the joint of a target, which keeps nothing.

    Args:
        push: gets the joint, the effect's parameters, MjData and the time [s].
    """
    return make_joint_force(lambda joint, values: partial(push, joint, values))


def make_joint_force(make: Callable[[Joint, Values], Force]) -> Install:
    """What installs a force at the joint of a target, which may keep a state."""

    def install(truth: HiddenRobot, target: str, values: Values) -> None:
        name = truth.robot.find_joint(target)
        truth.forces.append(lambda model: make(Joint(truth.robot, name, model), values))

    return install
