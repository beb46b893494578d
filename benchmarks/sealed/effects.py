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
from benchmarks.sealed.hidden_robot import HiddenRobot
from benchmarks.sealed.magnitudes import Rng, Sized, Values
from benchmarks.sealed.mjcf import NumberDraw, Robot
from benchmarks.sealed.robots import ROBOTS
from benchmarks.sealed.shapers import (
    apply_cogging,
    apply_load_friction,
    apply_stribeck,
    delay_command,
    lag_command,
    limit_rate,
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
    install: Callable[[HiddenRobot, str, Values], None]
    units: Mapping[str, str]
    sizes: tuple[float, float] = (0.05, 20.0)
    zeroes: tuple[str, ...] = ()
    density: tuple[float, ...] = ()


TORQUE, ANGLE = "N m", "rad"
SHIFT = {"x": "m", "y": "m", "z": "m"}
EFFECTS: Sequence[Effect] = (
    Effect(
        "viscous_friction",
        at.list_joints,
        size.draw_damping,
        put.set_joint_value("damping"),
        {"damping": "N m s/rad"},
    ),
    Effect(
        "coulomb_friction",
        at.list_joints,
        size.draw_dry_friction,
        put.set_joint_value("frictionloss"),
        {"frictionloss": TORQUE},
    ),
    Effect(
        "stribeck_friction",
        at.list_arm_joints,
        size.draw_stribeck,
        lambda truth, target, v: truth.forces.append(
            apply_stribeck(at.get_name(target), **v)
        ),
        {"coulomb": TORQUE, "static": TORQUE, "stribeck_velocity": "rad/s"},
        zeroes=("frictionloss:{}",),
    ),
    Effect(
        "load_dependent_friction",
        at.list_driven_arm_joints,
        size.draw_number("load_coefficient", 0.15),
        lambda truth, target, v: truth.forces.append(
            apply_load_friction(at.get_name(target), **v)
        ),
        {"load_coefficient": "1"},
        sizes=(0.05, 4.0),
    ),
    Effect(
        "asymmetric_friction",
        at.list_arm_joints,
        size.draw_asymmetric_friction,
        put.install_asymmetric_friction,
        {"positive": TORQUE, "negative": TORQUE},
        zeroes=("frictionloss:{}",),
    ),
    Effect(
        "quadratic_damping",
        at.list_arm_joints,
        size.draw_damping2,
        put.set_joint_value("damping2"),
        {"damping2": "N m s^2/rad^2"},
    ),
    Effect(
        "backlash",
        at.list_driven_arm_joints,
        size.draw_number("gap", 0.02),
        put.install_backlash,
        {"gap": ANGLE},
    ),
    Effect(
        "compliance",
        at.list_driven_arm_joints,
        size.draw_compliance,
        put.install_compliance,
        {"stiffness": "N m/rad", "damping": "N m s/rad"},
        sizes=(0.02, 10.0),
    ),
    Effect(
        "armature",
        at.list_arm_joints,
        size.draw_armature,
        put.set_joint_value("armature"),
        {"armature": "kg m^2"},
        zeroes=("armature:{}?",),
    ),
    Effect(
        "joint_spring",
        at.list_joints,
        size.draw_spring,
        put.install_spring,
        {"stiffness": "N m/rad", "springref": ANGLE},
    ),
    Effect(
        "command_delay",
        at.list_actuators,
        size.draw_number("delay", 0.01),
        put.install_shaper(delay_command, "delay"),
        {"delay": "s"},
        sizes=(0.1, 10.0),
    ),
    Effect(
        "actuator_lag",
        at.list_actuators,
        size.draw_number("timeconst", 0.02),
        put.install_shaper(lag_command, "timeconst"),
        {"timeconst": "s"},
        sizes=(0.05, 10.0),
    ),
    Effect(
        "torque_saturation",
        at.list_actuators,
        size.draw_torque_limit,
        put.install_saturation,
        {"limit": TORQUE},
    ),
    Effect(
        "speed_torque_limit",
        at.list_arm_servos,
        size.draw_speed_limit,
        put.install_speed_limit,
        {"stall_torque": TORQUE, "no_load_speed": "rad/s"},
    ),
    Effect(
        "servo_gain",
        at.list_servos,
        size.draw_kp,
        put.install_gain,
        {"kp": "N m/rad"},
        sizes=(0.05, 6.0),
    ),
    Effect(
        "payload",
        at.list_load_bodies,
        size.draw_payload,
        put.install_payload,
        {"mass": "kg", "position_x": "m", "position_y": "m", "position_z": "m"},
    ),
    Effect(
        "com_shift",
        at.list_shiftable_bodies,
        size.draw_com_shift,
        put.install_com_shift,
        SHIFT,
        sizes=(0.05, 4.0),
    ),
    Effect(
        "slope",
        at.list_tiltable_worlds,
        size.draw_slope,
        put.install_slope,
        {"tilt": ANGLE, "azimuth": ANGLE},
        sizes=(0.05, 8.0),
    ),
    Effect(
        "fluid_drag",
        at.list_drag_worlds,
        lambda r, t, g: lambda s: {"density": 60.0 * s},
        put.install_medium,
        {"density": "kg/m^3"},
        sizes=(0.01, 20.0),
    ),
    Effect(
        "ground_friction",
        at.list_floors,
        size.draw_ground_friction,
        put.install_ground_friction,
        {"friction": "1"},
        sizes=(0.1, 10),
    ),
    Effect(
        "sensor_bias",
        at.list_position_signals,
        size.draw_number("bias", 0.02, signed=True),
        put.install_sensor_error("bias", "bias"),
        {"bias": ANGLE},
    ),
    Effect(
        "sensor_gain",
        at.list_position_signals,
        size.draw_sensor_gain,
        put.install_sensor_error("gain", "gain"),
        {"gain": "1"},
        sizes=(0.05, 8.0),
    ),
    Effect(
        "sensor_delay",
        at.list_position_signals,
        size.draw_number("delay", 0.01),
        put.install_sensor_error("delay", "delay"),
        {"delay": "s"},
        sizes=(0.1, 10.0),
    ),
    Effect(
        "link_length",
        at.list_long_links,
        size.draw_length,
        put.install_link_length,
        {"length": "m"},
        sizes=(0.05, 5.0),
    ),
    Effect(
        "mount_shift",
        at.list_mounted_links,
        size.draw_mount_shift,
        put.install_mount_shift,
        SHIFT,
        sizes=(0.1, 4.0),
    ),
    Effect(
        "limb_loss",
        at.list_losable_links,
        size.draw_nothing,
        put.install_limb_loss,
        {},
        sizes=(1.0, 1.0),
    ),
    # further names of the contract
    Effect(
        "cogging",
        at.list_arm_joints,
        size.draw_cogging,
        lambda truth, target, v: truth.forces.append(
            apply_cogging(at.get_name(target), **v)
        ),
        {"amplitude": TORQUE, "poles": "1", "phase": ANGLE},
    ),
    Effect(
        "joint_coupling",
        at.list_coupled_joints,
        size.draw_coupling,
        put.install_coupling,
        {"stiffness": "N m/rad", "ratio": "1"},
    ),
    Effect(
        "hard_stop",
        at.list_arm_joints,
        size.draw_stop,
        put.install_stop,
        {"range": ANGLE},
        sizes=(0.05, 3.2),
    ),
    Effect(
        "rate_limit",
        at.list_servos,
        size.draw_rate,
        put.install_shaper(limit_rate, "rate"),
        {"rate": "rad/s"},
    ),
    Effect(
        "integral_action",
        at.list_arm_servos,
        size.draw_integral,
        put.install_integral_action,
        {"ki": "N m/(rad s)", "imax": TORQUE},
    ),
    Effect(
        "joint_jam",
        at.list_jammable_joints,
        size.draw_jam_angle,
        put.install_joint_jam,
        {"angle": ANGLE},
        sizes=(1.0, 1.0),
    ),
    Effect(
        "wind",
        at.list_drag_worlds,
        size.draw_wind,
        put.install_wind,
        {"vx": "m/s", "vy": "m/s", "vz": "m/s"},
        sizes=(0.02, 8.0),
        density=(1.2, 1.2, 1000.0),
    ),
    Effect(
        "ground_compliance",
        at.list_floors,
        size.draw_ground_compliance,
        put.install_ground_compliance,
        {"timeconst": "s", "dampratio": "1"},
        sizes=(0.1, 8.0),
    ),
    Effect(
        "quantization",
        at.list_position_signals,
        size.draw_number("step", 0.01),
        put.install_sensor_error("step", "step"),
        {"step": ANGLE},
        sizes=(0.3, 6.0),
    ),
)
BY_NAME: Mapping[str, Effect] = {effect.name: effect for effect in EFFECTS}


def choose_omissions(
    effect: Effect, target: str, rng: Rng
) -> tuple[frozenset[str], float]:
    """What the given model must not state for an effect, and its medium's density.

    Args:
        effect: that is concealed.
        target: where.
        rng: decides about what may be stated or not.

    Returns:
        Attributes that are stated as 0, as "damping:j1", and the density [kg/m^3].
    """
    zero = []
    for text in effect.zeroes:
        maybe = text.endswith("?")
        if not maybe or rng.random() < 0.5:
            zero.append(text.rstrip("?").format(at.get_name(target)))
    density = float(rng.choice(effect.density)) if effect.density else 0.0
    return frozenset(zero), density


def make_blank_robot(name: str) -> Robot:
    """A robot of a shape with some numbers, to ask which effects fit it."""
    return ROBOTS[name](NumberDraw(np.random.default_rng(0)))
