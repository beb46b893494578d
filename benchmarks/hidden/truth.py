"""The hidden robot: takes a given model, gives it with edits.

It is simulated with plain `mj_step` at a finer step than the model as given has; what
MuJoCo does not do is a command shaper or a force here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import mujoco
import numpy as np

from benchmarks.hidden.robots.robot import Robot

INTEGRATORS = {
    "implicit": mujoco.mjtIntegrator.mjINT_IMPLICIT,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
}
Errors = Mapping[tuple[str, str], float]  # relative, by kind and name of a nuisance


class UnfitDraw(Exception):
    """A draw that makes no case: it diverges, or the effect does not show."""


class CommandShaper(Protocol):
    """What happens to one command on its way; keeps its state from step to step."""

    def __call__(self, command: float, speed: float, first: bool) -> float:
        """The command of this step.

        Args:
            speed: [1/s] of what is sent, by differences.
            first: whether there was none before.
        """


class Force(Protocol):
    """A force, or a changed coefficient, of every step."""

    def __call__(self, data: mujoco.MjData, time: float) -> None:
        """Add to data.qfrc_applied, or to the model; time < 0: settling."""


@dataclass(frozen=True)
class SensorModel:
    """reading = round to step (gain x true(t - delay) + bias)."""

    gain: float = 1.0
    bias: float | tuple[float, ...] = 0.0
    delay: float = 0.0
    step: float = 0.0


@dataclass
class HiddenRobot:
    """A hidden robot in the making.

    Attributes:
        shapers: by actuator, in order.
        forces: makers of forces, called with the compiled model.
        plays: by joint: the joint that sits between motor and link.
        pinned: [rad] joints that do not move, by name.
        sprung: joints that nothing drives, which start where their spring holds.
        motor_side: True where joint positions are the motor's.
        ahead: [s] by which commands come earlier than the recording says.
    """

    robot: Robot
    spec: mujoco.MjSpec
    shapers: dict[str, list[Callable[[float], CommandShaper]]] = field(
        default_factory=dict
    )
    forces: list[Callable[[mujoco.MjModel], Force]] = field(default_factory=list)
    readings: dict[str, SensorModel] = field(default_factory=dict)
    plays: dict[str, str] = field(default_factory=dict)
    pinned: dict[str, float] = field(default_factory=dict)
    sprung: list[str] = field(default_factory=list)
    motor_side: bool = False
    ahead: float = 0.0


def make_hidden_robot(robot: Robot, errors: Errors, integrator: str) -> HiddenRobot:
    """The hidden robot before any effect: every body states its inertia.

    Args:
        integrator: as MJCF calls it; "": the given one.
    """
    spec = robot.read_spec()
    model = spec.compile()
    for body in spec.bodies[1:]:
        _state_inertia(body, model.body(body.name))
    spec.option.timestep = robot.fine
    if integrator:
        spec.option.integrator = INTEGRATORS[integrator]
    for (kind, name), error in errors.items():
        scale_value(spec, kind, name, 1 + error)
    return HiddenRobot(robot, spec)


def _state_inertia(body: Any, compiled: Any) -> None:
    if compiled.mass[0] == 0:
        return
    body.explicitinertial = True
    body.mass = compiled.mass[0]
    body.ipos, body.iquat = compiled.ipos, compiled.iquat
    body.inertia = compiled.inertia


@dataclass(frozen=True)
class Nuisance:
    """A value that the model states and a user would grant to be wrong.

    Attributes:
        kind: mass, inertia, length, damping, armature, frictionloss, kp, kv, friction.
        name: of the body, joint or actuator; "" for all contacts.
        bound: largest relative error that a refit may correct.
    """

    kind: str
    name: str
    bound: float


def list_nuisances(robot: Robot) -> list[Nuisance]:
    """Every stated, nonzero value, with the contract's bound on its error."""
    spec = robot.read_spec()
    found = []
    bodies = [*robot.links, *([robot.free] if robot.free else [])]
    for name in dict.fromkeys(bodies):
        found += [Nuisance("mass", name, 0.15), Nuisance("inertia", name, 0.15)]
        found += [Nuisance("length", name, 0.03)]
    for name in robot.joints:
        joint = spec.joint(name)
        values = {
            "damping": joint.damping[0],
            "armature": joint.armature,
            "frictionloss": joint.frictionloss,
        }
        found += [Nuisance(k, name, 0.3) for k, v in values.items() if v]
    if robot.drive == "servo":
        found += [Nuisance(k, a, 0.3) for a in robot.actuators for k in ("kp", "kv")]
    if robot.contact:
        found.append(Nuisance("friction", "", 0.3))
    return found


def scale_value(spec: mujoco.MjSpec, kind: str, name: str, factor: float) -> None:
    """Multiply a stated value in the hidden robot's MjSpec.

    Args:
        kind: of `Nuisance`, or gear.
        name: of the body, joint or actuator; "" for all contacts.
    """
    if kind == "friction":
        for geom in spec.geoms:
            geom.friction[0] *= factor
    elif kind in ("kp", "kv", "gear"):
        scale_gain(spec.actuator(name), kind, factor)
    elif kind in ("mass", "inertia"):
        body = spec.body(name)
        body.mass *= factor if kind == "mass" else 1.0
        body.inertia = body.inertia * factor
    elif kind == "length":
        stretch_body(spec.body(name), np.full(3, factor))
    elif kind == "damping":
        spec.joint(name).damping[0] *= factor
    else:
        joint = spec.joint(name)
        setattr(joint, kind, getattr(joint, kind) * factor)


def scale_gain(actuator: Any, kind: str, factor: float) -> None:
    """Multiply a gain of an actuator.

    Args:
        kind: "kp", "kv", or "gear" for all that it gives.
    """
    if kind == "gear":
        actuator.gear = actuator.gear * factor
    elif kind == "kp":
        actuator.gainprm[0] *= factor
        actuator.biasprm[1] *= factor
    else:
        actuator.biasprm[2] *= factor


def stretch_body(body: Any, factors: np.ndarray) -> None:
    """Scale a body's geometry, center of mass and inertia along its axes; mass stays.

    Args:
        factors: (3) along x, y, z of the body frame.
    """
    body.ipos = body.ipos * factors
    for child in body.bodies:
        child.pos = child.pos * factors
    for geom in body.geoms:
        geom.pos = geom.pos * factors
        if geom.type == mujoco.mjtGeom.mjGEOM_CAPSULE:
            geom.size[1] *= factors[2]
        elif geom.type == mujoco.mjtGeom.mjGEOM_BOX:
            geom.size = geom.size * factors
    _stretch_inertia(body, factors)


def _stretch_inertia(body: Any, factors: np.ndarray) -> None:
    flat = np.zeros(9)
    mujoco.mju_quat2Mat(flat, body.iquat)
    turn = flat.reshape(3, 3)
    inertia = turn @ np.diag(body.inertia) @ turn.T
    spread = (np.trace(inertia) / 2 * np.eye(3) - inertia) * np.outer(factors, factors)
    values, axes = np.linalg.eigh(np.trace(spread) * np.eye(3) - spread)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, axes.ravel())
    body.inertia, body.iquat = values, quat
