"""Reflexes: damaged robots and neural controllers in, what they do and sense out.

All of a call is one `mujoco.batch.Batch` of one compiled model. What is broken is data
of each simulation. A part that is gone has next to no mass, touches nothing and is
driven by nothing. A joint that is jammed has an armature that nothing can turn. A
sensor's factor stands between it and the network. Between two steps all networks are
evaluated at once. MJX was measured instead: docs/how-recover-works.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Floats, RowBatch
from ..body.changes import (
    AIR_DENSITY,
    LOST_SHARE,
    compute_direction,
    tilt_gravity,
)
from ..body.damage import Damage
from ..body.legged import HIDDEN, LeggedRobot
from ..machine import count_cores
from .walk import FASTEST

if TYPE_CHECKING:
    from mujoco.batch import Batch

STEPS = 1000  # of one evaluation (overview.txt 4.3)
STEP = 0.01  # [s] of one, as the models have it
STEPS_PER_SAMPLE = 5  # steps that a sample of the series is the mean of; chosen
SAMPLE = STEP * STEPS_PER_SAMPLE  # [s] from sample to sample
_JAMMED_ARMATURE = (
    1e5  # [kg m^2] armature of a jammed joint; chosen: 6 N m turn it by 0.2 degrees
)


@dataclass(frozen=True)
class LeggedPlants(RowBatch):
    """N ways that a robot and its world may be; all that damage changes.

    Attributes:
        present: (N, B) whether each body of the model is there.
        unlocked: (N, D) whether each joint turns.
        motor_gain: (N, D) factor on each motor's torque.
        sensor_gain: (N, S) factor on each sensor.
        neuron_gain: (N, HIDDEN) 0 where a hidden neuron is dead.
        gravity: (N, 3) [m/s^2].
        friction: (N) of the ground [1].
        wind: (N, 3) [m/s].
        mass_scale: (N) factor on all masses [1].
    """

    robot: LeggedRobot
    present: np.ndarray
    unlocked: np.ndarray
    motor_gain: Floats
    sensor_gain: Floats
    neuron_gain: Floats
    gravity: Floats
    friction: Floats
    wind: Floats
    mass_scale: Floats


@dataclass(frozen=True)
class Rollouts(RowBatch):
    """What N robots did in `STEPS` steps.

    Attributes:
        displacement: (N) forward displacement d(1000) - d(1) [m]; -inf where it failed.
        sensors: (N, T, S) what each sensor gave the network, in [-1, 1]: means over
            `STEPS_PER_SAMPLE` steps.
        path: (N, T, 3) of the torso [m], at the ends of the same times.
        failed: (N) whether the simulation diverged; its series are NaN.
    """

    displacement: Floats
    sensors: Floats
    path: Floats
    failed: np.ndarray


def build_intact_plants(robot: LeggedRobot, count: int) -> LeggedPlants:
    """A robot in which nothing is broken, so many times."""
    motors, model = len(robot.motors), robot.model
    return LeggedPlants(
        robot=robot,
        present=np.ones((count, model.nbody), bool),
        unlocked=np.ones((count, motors), bool),
        motor_gain=np.ones((count, motors)),
        sensor_gain=np.ones((count, len(robot.sensors))),
        neuron_gain=np.ones((count, HIDDEN)),
        gravity=np.tile(model.opt.gravity, (count, 1)),
        friction=np.full(count, float(model.geom_friction[0, 0])),
        wind=np.zeros((count, 3)),
        mass_scale=np.ones(count),
    )


def build_damaged_plants(
    robot: LeggedRobot, damages: Sequence[Sequence[Damage]]
) -> LeggedPlants:
    """Robots after their damages, one for each element."""
    plants = build_intact_plants(robot, len(damages))
    for row, several in enumerate(damages):
        for damage in several:
            _apply_damage(plants, row, damage)
    return plants


def scale_physics(plants: LeggedPlants, factors: Floats) -> LeggedPlants:
    """Robots whose friction, masses and motors are off.

    Args:
        factors: (2 + D) or (N, 2 + D) on friction, on masses, on each motor's torque.
    """
    return replace(
        plants,
        friction=plants.friction * factors[..., 0],
        mass_scale=plants.mass_scale * factors[..., 1],
        motor_gain=plants.motor_gain * factors[..., 2:],
    )


def _apply_damage(plants: LeggedPlants, row: int, damage: Damage) -> None:
    """Write one damage into a row."""
    robot, name, value = plants.robot, damage.name, damage.value
    if damage.kind == "limb_loss":
        gone = robot.list_bodies_below(name)
        plants.present[row, gone] = False
        joints = map(robot.joint_of_motor, range(len(robot.motors)))
        for motor, joint in enumerate(joints):
            if int(joint.bodyid[0]) in gone:
                plants.motor_gain[row, motor] = 0.0
                # its angle sensor is lost, too; a touch sensor touches nothing
                if (angle := f"{joint.name}_position") in robot.sensors:
                    plants.sensor_gain[row, robot.sensors.index(angle)] = 0.0
    elif damage.kind == "joint_jam":
        (place,) = (p for p in robot.damage_sites if p.name == name)
        plants.unlocked[row, list(place.dofs)] = False
    elif damage.kind in ("weak_motor", "sensor_dead", "weak_sensor", "neuron_dead"):
        gain, names = {
            "actuator": (plants.motor_gain, robot.motors),
            "sensor": (plants.sensor_gain, robot.sensors),
            "neuron": (plants.neuron_gain, robot.targets["neuron"]),
        }[damage.target.partition(":")[0]]
        gain[row, names.index(name)] *= value  # a dead one's value is 0
    elif damage.kind == "ground_friction":
        plants.friction[row] = value
    elif damage.kind in ("slope", "wind"):
        toward = compute_direction(damage.azimuth)
        if damage.kind == "wind":
            plants.wind[row, :2] = value * toward
        else:
            level, downhill = robot.model.opt.gravity, np.array([*toward, 0.0])
            plants.gravity[row] = tilt_gravity(level, value, downhill)


def simulate_controllers(
    plants: LeggedPlants, weights: Floats, steps: int = STEPS
) -> Rollouts:
    """Let robots run under their controllers, which are evaluated at every step.

    Sensors, a bias where the robot's network has one, four hidden neurons, a motor each
    (overview.txt 4.2.2; 68 and 120 synapses, 4.3). Hidden neurons have a threshold: +1
    or -1. The values that arrive at the motors are scaled to angles: kept within
    [-1, 1], the range of every neuron, times how far the joints reach.

    Args:
        weights: (N, synapses), those of the inputs first [1].
        steps: of 10 ms.
    """
    batch = _build_batch(plants)
    pressed, ctrl = batch.bind("sensordata"), batch.bind("ctrl")
    place = batch.bind("qpos")[:, :3]
    feet, count = plants.robot.feet, len(plants)
    samples = steps // STEPS_PER_SAMPLE
    sensed = np.zeros((count, samples, pressed.shape[1]))
    path = np.empty((count, samples, 3))
    inputs = np.ones((count, pressed.shape[1] + plants.robot.has_bias))
    now, (inner, outer) = inputs[:, : pressed.shape[1]], _split(plants.robot, weights)
    begin = np.empty(count)
    with np.errstate(all="ignore"):
        for step in range(steps):
            now[:, :feet] = np.where(pressed[:, :feet] > 0, 1.0, -1.0)
            now[:, feet:] = np.clip(pressed[:, feet:] / plants.robot.reach, -1, 1)
            now *= plants.sensor_gain
            arrived = np.matmul(inputs[:, None], inner)[:, 0]
            hidden = np.where(arrived > 0, plants.neuron_gain, -plants.neuron_gain)
            out = np.matmul(hidden[:, None], outer)[:, 0]
            ctrl[:] = plants.robot.reach * np.clip(out, -1, 1)
            batch.step()
            if step == 0:
                begin = place[:, 0].copy()
            sample = step // STEPS_PER_SAMPLE
            sensed[:, sample] += now / STEPS_PER_SAMPLE
            path[:, sample] = place
    way = place[:, 0] - begin
    failed = ~np.isfinite(path).all(axis=(1, 2)) | ~np.isfinite(way)
    failed |= ~(np.abs(batch.bind("qvel")) < FASTEST).all(axis=1)
    sensed[failed] = path[failed] = np.nan
    return Rollouts(np.where(failed, -np.inf, way), sensed, path, failed)


def _split(robot: LeggedRobot, weights: Floats) -> tuple[Floats, Floats]:
    """Weights (N, S + bias, HIDDEN) of inputs, and (N, HIDDEN, D) of hidden neurons."""
    inputs = len(robot.sensors) + robot.has_bias
    inner, outer = np.split(weights, [inputs * HIDDEN], axis=1)
    shape = HIDDEN, len(robot.motors)
    return inner.reshape(-1, inputs, HIDDEN), outer.reshape(-1, *shape)


def _build_batch(plants: LeggedPlants) -> "Batch":
    """The simulations, at rest at their start."""
    from mujoco.batch import Batch

    from ..mujoco_files import silence_mujoco

    silence_mujoco()
    robot = plants.robot
    model = robot.model
    batch = Batch(model, len(plants), min(count_cores(), len(plants)))
    here = np.where(plants.present, 1.0, LOST_SHARE) * plants.mass_scale[:, None]
    batch.expand("body_mass")[:] = model.body_mass * here
    batch.expand("body_inertia")[:] = model.body_inertia * here[..., None]
    touches = plants.present[:, model.geom_bodyid]
    batch.expand("geom_contype")[:] = model.geom_contype * touches
    batch.expand("geom_friction")[..., 0] = plants.friction[:, None]
    dofs = [int(robot.joint_of_motor(d).dofadr[0]) for d in range(len(robot.motors))]
    armature = batch.expand("dof_armature")
    armature[:, dofs] = np.where(
        plants.unlocked, model.dof_armature[dofs], _JAMMED_ARMATURE
    )
    batch.expand("actuator_gainprm")[..., 0] *= plants.motor_gain
    batch.expand("actuator_biasprm")[..., 1:3] *= plants.motor_gain[..., None]
    batch.expand("actuator_forcerange")[:] *= plants.motor_gain[..., None]
    batch.expand("opt.gravity")[:] = plants.gravity
    batch.expand("opt.wind")[:] = plants.wind
    blows = (plants.wind != 0).any(axis=1)
    batch.expand("opt.density")[:] = np.where(blows, AIR_DENSITY, 0.0)
    batch.set_const()
    batch.reset()
    return batch
