"""The effects that are concealed: takes a robot, gives edits of its hidden self.

An implementation of its own of contract section 4: nothing of `selfheal.diagnosis` is
used, so that an error there cannot hide in the truth.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.sealed import installation as put
from benchmarks.sealed import magnitudes as size
from benchmarks.sealed import targets as at
from benchmarks.sealed.hidden_robot import Truth
from benchmarks.sealed.magnitudes import Rng, Sized, Values
from benchmarks.sealed.mjcf import Draw, Robot
from benchmarks.sealed.robots import ROBOTS
from benchmarks.sealed.shapers import (
    cogging,
    delayed,
    lagged,
    load_friction,
    slewed,
    stribeck,
)


@dataclass(frozen=True)
class Effect:
    """One concealed effect.

    Attributes:
        name: of contract section 4.
        targets: where it can be on a robot; empty: nowhere.
        draw: gives a function from a size (about 1) to its parameters.
        install: puts it into the hidden robot.
        sizes: smallest and largest size that is still sane.
        units: of its parameters.
        zeroes: values that the given model must not state, "{}" being the target.
        density: [kg/m^3] of the medium that the given model states.
    """

    name: str
    targets: Callable[[Robot], Sequence[str]]
    draw: Callable[[Robot, str, Rng], Sized]
    install: Callable[[Truth, str, Values], None]
    units: Mapping[str, str]
    sizes: tuple[float, float] = (0.05, 20.0)
    zeroes: tuple[str, ...] = ()
    density: tuple[float, ...] = ()


TORQUE, ANGLE = "N m", "rad"
SHIFT = {"x": "m", "y": "m", "z": "m"}
EFFECTS: Sequence[Effect] = (
    Effect(
        "viscous_friction",
        at.joints,
        size.damping,
        put.set_value("damping"),
        {"damping": "N m s/rad"},
    ),
    Effect(
        "coulomb_friction",
        at.joints,
        size.dry,
        put.set_value("frictionloss"),
        {"frictionloss": TORQUE},
    ),
    Effect(
        "stribeck_friction",
        at.arm_joints,
        size.stribeck,
        lambda truth, target, v: truth.forces.append(stribeck(at.name_of(target), **v)),
        {"coulomb": TORQUE, "static": TORQUE, "stribeck_velocity": "rad/s"},
        zeroes=("frictionloss:{}",),
    ),
    Effect(
        "load_dependent_friction",
        at.arm_driven,
        size.number("load_coefficient", 0.15),
        lambda truth, target, v: truth.forces.append(
            load_friction(at.name_of(target), **v)
        ),
        {"load_coefficient": "1"},
        sizes=(0.05, 4.0),
    ),
    Effect(
        "asymmetric_friction",
        at.arm_joints,
        size.asymmetric,
        put.uneven,
        {"positive": TORQUE, "negative": TORQUE},
        zeroes=("frictionloss:{}",),
    ),
    Effect(
        "quadratic_damping",
        at.arm_joints,
        size.damping2,
        put.set_value("damping2"),
        {"damping2": "N m s^2/rad^2"},
    ),
    Effect(
        "backlash",
        at.arm_driven,
        size.number("gap", 0.02),
        put.backlash,
        {"gap": ANGLE},
    ),
    Effect(
        "compliance",
        at.arm_driven,
        size.compliance,
        put.flexible,
        {"stiffness": "N m/rad", "damping": "N m s/rad"},
        sizes=(0.02, 10.0),
    ),
    Effect(
        "armature",
        at.arm_joints,
        size.armature,
        put.set_value("armature"),
        {"armature": "kg m^2"},
        zeroes=("armature:{}?",),
    ),
    Effect(
        "joint_spring",
        at.joints,
        size.spring,
        put.sprung,
        {"stiffness": "N m/rad", "springref": ANGLE},
    ),
    Effect(
        "command_delay",
        at.actuators,
        size.number("delay", 0.01),
        put.shaped(delayed, "delay"),
        {"delay": "s"},
        sizes=(0.1, 10.0),
    ),
    Effect(
        "actuator_lag",
        at.actuators,
        size.number("timeconst", 0.02),
        put.shaped(lagged, "timeconst"),
        {"timeconst": "s"},
        sizes=(0.05, 10.0),
    ),
    Effect(
        "torque_saturation", at.actuators, size.limit, put.saturated, {"limit": TORQUE}
    ),
    Effect(
        "speed_torque_limit",
        at.arm_servos,
        size.motor,
        put.weak,
        {"stall_torque": TORQUE, "no_load_speed": "rad/s"},
    ),
    Effect(
        "servo_gain", at.servos, size.kp, put.gain, {"kp": "N m/rad"}, sizes=(0.05, 6.0)
    ),
    Effect(
        "payload",
        at.loads,
        size.payload,
        put.loaded,
        {"mass": "kg", "position_x": "m", "position_y": "m", "position_z": "m"},
    ),
    Effect(
        "com_shift", at.eccentric, size.shift, put.shifted, SHIFT, sizes=(0.05, 4.0)
    ),
    Effect(
        "slope",
        at.tilting,
        size.slope,
        put.tilted,
        {"tilt": ANGLE, "azimuth": ANGLE},
        sizes=(0.05, 8.0),
    ),
    Effect(
        "fluid_drag",
        at.airy,
        lambda r, t, g: lambda s: {"density": 60.0 * s},
        put.medium,
        {"density": "kg/m^3"},
        sizes=(0.01, 20.0),
    ),
    Effect(
        "ground_friction",
        at.floor,
        size.grip,
        put.slippery,
        {"friction": "1"},
        sizes=(0.1, 10),
    ),
    Effect(
        "sensor_bias",
        at.signals,
        size.number("bias", 0.02, signed=True),
        put.reading("bias", "bias"),
        {"bias": ANGLE},
    ),
    Effect(
        "sensor_gain",
        at.signals,
        size.sensor_gain,
        put.reading("gain", "gain"),
        {"gain": "1"},
        sizes=(0.05, 8.0),
    ),
    Effect(
        "sensor_delay",
        at.signals,
        size.number("delay", 0.01),
        put.reading("delay", "delay"),
        {"delay": "s"},
        sizes=(0.1, 10.0),
    ),
    Effect(
        "link_length",
        at.long,
        size.length,
        put.longer,
        {"length": "m"},
        sizes=(0.05, 5.0),
    ),
    Effect("mount_shift", at.mounted, size.mount, put.moved, SHIFT, sizes=(0.1, 4.0)),
    Effect("limb_loss", at.lost, size.none, put.gone, {}, sizes=(1.0, 1.0)),
    # further names of the contract
    Effect(
        "cogging",
        at.arm_joints,
        size.ripple,
        lambda truth, target, v: truth.forces.append(cogging(at.name_of(target), **v)),
        {"amplitude": TORQUE, "poles": "1", "phase": ANGLE},
    ),
    Effect(
        "joint_coupling",
        at.hinged,
        size.coupling,
        put.coupled,
        {"stiffness": "N m/rad", "ratio": "1"},
    ),
    Effect(
        "hard_stop",
        at.arm_joints,
        size.stop,
        put.stopped,
        {"range": ANGLE},
        sizes=(0.05, 3.2),
    ),
    Effect(
        "rate_limit",
        at.servos,
        size.rate,
        put.shaped(slewed, "rate"),
        {"rate": "rad/s"},
    ),
    Effect(
        "integral_action",
        at.arm_servos,
        size.integral,
        put.integrating,
        {"ki": "N m/(rad s)", "imax": TORQUE},
    ),
    Effect(
        "joint_jam",
        at.jammed,
        size.angle,
        put.stuck,
        {"angle": ANGLE},
        sizes=(1.0, 1.0),
    ),
    Effect(
        "wind",
        at.airy,
        size.wind,
        put.blown,
        {"vx": "m/s", "vy": "m/s", "vz": "m/s"},
        sizes=(0.02, 8.0),
        density=(1.2, 1.2, 1000.0),
    ),
    Effect(
        "ground_compliance",
        at.floor,
        size.soft,
        put.yielding,
        {"timeconst": "s", "dampratio": "1"},
        sizes=(0.1, 8.0),
    ),
    Effect(
        "quantization",
        at.signals,
        size.number("step", 0.01),
        put.reading("step", "step"),
        {"step": ANGLE},
        sizes=(0.3, 6.0),
    ),
)
BY_NAME: Mapping[str, Effect] = {effect.name: effect for effect in EFFECTS}


def drawing(effect: Effect, target: str, rng: Rng) -> tuple[frozenset[str], float]:
    """What the given model must not state for an effect, and its medium's density."""
    zero = []
    for text in effect.zeroes:
        maybe = text.endswith("?")
        if not maybe or rng.random() < 0.5:
            zero.append(text.rstrip("?").format(at.name_of(target)))
    density = float(rng.choice(effect.density)) if effect.density else 0.0
    return frozenset(zero), density


def blank(name: str) -> Robot:
    """A robot of a shape, to ask what effects fit it."""
    return ROBOTS[name](Draw(np.random.default_rng(0)))
