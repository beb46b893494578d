"""What is wrong with the other cases' robots: edits of a specification, key entries."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from benchmarks.other_cases.motions import GRAVITY

SpecEdit = Callable[[Any], None]


@dataclass(frozen=True)
class TrueEffect:
    """What the key says of one effect.

    Attributes:
        name: of contract section 4.
        target: where.
        values: (value, unit) of its parameters; those that the motion cannot show
            are left out.
        measured: side of a play that is measured; "" of others.
    """

    name: str
    target: str
    values: dict[str, tuple[float, str]]
    measured: str = ""


# ---------------------------------------------------------------- edits


def set_joint(name: str, **values: Any) -> SpecEdit:
    """An edit that gives a joint other values, by the names of MjSpec."""
    return lambda spec: _set_attributes(spec.joint(name), values)


def set_actuator(name: str, **values: Any) -> SpecEdit:
    """An edit that gives an actuator other values, by the names of MjSpec."""
    return lambda spec: _set_attributes(spec.actuator(name), values)


def _set_attributes(element: Any, values: dict[str, Any]) -> None:
    for key, value in values.items():
        setattr(element, key, value)


def add_ball(body: str, mass: float, place: Sequence[float]) -> SpecEdit:
    """An edit that adds a small massive ball to a body.

    Args:
        body: name of the body.
        mass: [kg] of the ball.
        place: (3) [m] in the frame of the body.
    """
    ball = mujoco.mjtGeom.mjGEOM_SPHERE

    def change(spec: Any) -> None:
        spec.body(body).add_geom(type=ball, size=[0.01, 0, 0], pos=place, mass=mass)

    return change


def tilt_gravity(angle: float) -> SpecEdit:
    """An edit of gravity as a floor has it that falls by `angle` [rad] towards +x."""

    def change(spec: Any) -> None:
        spec.option.gravity = [GRAVITY * np.sin(angle), 0, -GRAVITY * np.cos(angle)]

    return change


def halve_knee_stiffness(spec: Any) -> None:
    """Halve the stiffness of the hopper's front knee servo."""
    servo = spec.actuator("fk")
    servo.gainprm[0] *= 0.5
    servo.biasprm[1] *= 0.5


def add_friction_and_lag(spec: Any) -> None:
    """Add Coulomb friction at joint q2 and a first-order lag at actuator ar."""
    spec.joint("q2").frictionloss = 0.5
    servo = spec.actuator("ar")
    servo.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
    servo.dynprm[0] = 0.04


def add_backlash(spec: Any) -> None:
    """Add play between the motor of joint b, which is measured, and its link."""
    spec.body("l2").add_joint(
        name="b_gap",
        axis=[0, 0, 1],
        range=[-0.02, 0.02],
        limited=1,
        damping=[0.005, 0, 0],
        armature=0.0005,
    )


def lengthen_link(spec: Any) -> None:
    """Make the planar arm's second link 0.29 m long, its mass as it was."""
    spec.body("l3").pos = [0.29, 0, 0]
    spec.body("l2").geoms[0].fromto = [0, 0, 0, 0.29, 0, 0]


def shift_drone_mass(spec: Any) -> None:
    """Move the drone's mass ahead of its middle."""
    spec.body("drone").geoms[0].pos = [0.012, 0, 0]


def halve_friction(spec: Any) -> None:
    """Halve the sliding friction of the sled and its floor."""
    for name in ("floor", "hull"):
        spec.geom(name).friction[0] = 0.17


def thicken_air(spec: Any) -> None:
    """Set the medium to four times the density of air."""
    spec.option.density = 4.8


# ---------------------------------------------------------------- key entries


def state_viscous_friction(joint: str, damping: float, unit: str) -> TrueEffect:
    """Key entry: viscous friction of a joint, whose unit depends on its type."""
    return TrueEffect(
        "viscous_friction", f"joint:{joint}", {"damping": (damping, unit)}
    )


def state_coulomb_friction(joint: str, loss: float) -> TrueEffect:
    """Key entry: Coulomb friction [N m] of a hinge."""
    values = {"frictionloss": (loss, "N m")}
    return TrueEffect("coulomb_friction", f"joint:{joint}", values)


def state_command_delay(actuator: str, delay: float) -> TrueEffect:
    """Key entry: delay [s] of an actuator's command."""
    return TrueEffect("command_delay", f"actuator:{actuator}", {"delay": (delay, "s")})


def state_sensor_bias(signal: str, bias: float) -> TrueEffect:
    """Key entry: bias [rad] of a signal of an angle."""
    return TrueEffect("sensor_bias", f"sensor:{signal}", {"bias": (bias, "rad")})


def state_slope(tilt: float) -> TrueEffect:
    """Key entry: a floor that falls by `tilt` [rad] towards +x."""
    return TrueEffect(
        "slope", "world", {"tilt": (tilt, "rad"), "azimuth": (0.0, "rad")}
    )


def state_payload(body: str, mass: float, **place: float) -> TrueEffect:
    """Key entry: a mass [kg] at a place [m], without axes that do not show."""
    values = {f"position_{axis}": (value, "m") for axis, value in place.items()}
    return TrueEffect("payload", f"body:{body}", {"mass": (mass, "kg"), **values})


def state_servo_gain(actuator: str, kp: float, unit: str) -> TrueEffect:
    """Key entry: gain of a servo or motor, whose unit depends on its type."""
    return TrueEffect("servo_gain", f"actuator:{actuator}", {"kp": (kp, unit)})
