"""Damage as data, and the table of its kinds: all that is known of each, in one place.

A kind changes plants of robots that do not know their bodies (`engine.plant`), and of
those that do (`engine.reflex`). Effects of a diagnosis with its name change any model.
"""

import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Bodies, scale_parts
from ..body.changes import compute_direction, list_subtree, tilt_gravity
from ..body.legged import LeggedRobot
from .values import AZIMUTHS, DEG, FRICTIONS, JAMS, SCALES, SHARES, SLOPES, Values

if TYPE_CHECKING:  # they load MuJoCo
    from ..engine.plant import Plant
    from ..engine.reflex import LeggedPlants

_LOST_SIZE = 0.02  # [m] that a lost part keeps, as MuJoCo needs some; chosen


@dataclass(frozen=True)
class Damage:
    """One thing that happened.

    Attributes:
        kind: a name of `KINDS`.
        target: "world", or the sort of its target and a name, as "body:left_upper".
        value: as its kind means it.
        azimuth: downhill of a slope, or where a wind blows to, from +x toward +y [rad].
    """

    kind: str
    target: str = "world"
    value: float = 0.0
    azimuth: float = 0.0

    @property
    def name(self) -> str:
        """The target's name without its sort; empty for the world."""
        return self.target.partition(":")[2]

    @property
    def place(self) -> tuple[str, str]:
        """What it is and where, whatever its value."""
        return self.kind, self.target

    @property
    def document(self) -> dict[str, str | float]:
        """What the contract shows of it (section 3)."""
        value = round(float(self.value), 6)
        return {"kind": self.kind, "target": self.target, "value": value}

    def __str__(self) -> str:
        name, value = self.name.replace("_", " "), self.value
        text = KINDS[self.kind].text
        return text.format(name=name, value=value, degrees=math.degrees(value))


INTACT = Damage("none")


class DamageKind:
    """One kind of damage.

    Attributes:
        sort: of its target, such as body or world.
        meaning: of its value, with its unit.
        text: with {name} for the target, {value} and {degrees} for the value.
        usage: how users write it; empty: they cannot.
        limits: of what users may write; None: no value.
        default: value where users write none; None: they have to.
        is_angle: whether users write degrees.
        has_azimuth: whether it has a direction.
        least: smallest value that makes sense.
        drawn: ends of what is drawn at random; None: the value is 0.
        grows: whether it may come in several steps.
        is_estimated: whether the algorithm of 2004 knows it (overview.txt 4.3).
        heal_values, recover_values: among which these commands look for it.
    """

    name: str
    sort = "world"
    meaning: str
    text: str
    usage = ""
    limits: tuple[float, float] | None = None
    default: float | None = None
    is_angle = False
    has_azimuth = False
    least = -math.inf
    drawn: tuple[float, float] | None = None
    grows = False
    is_estimated = False
    heal_values = recover_values = Values(())

    def make_target(self, name: str) -> str:
        """The target of a name, which the world has none of."""
        return f"{self.sort}:{name}" if name else "world"

    def list_damages(self, names: Iterable[str], grid: Sequence[float]) -> list[Damage]:
        """It at each of some places, with each of some values, in each direction."""
        azimuths = AZIMUTHS if self.has_azimuth else (0.0,)
        return [
            Damage(self.name, self.make_target(name), value, azimuth)
            for name, value, azimuth in product(names, grid, azimuths)
        ]

    def change_plant(self, plant: "Plant", damage: Damage) -> "Plant":
        """A plant after it; one that cannot suffer it stays as it was."""
        return plant

    def change_legged(self, plants: "LeggedPlants", row: int, damage: Damage) -> None:
        """Write it into a row of legged plants, if they can suffer it."""

    def list_estimated_places(self, robot: LeggedRobot) -> Sequence[str]:
        """Names of its targets among which the algorithm of 2004 looks for it."""
        return robot.targets[self.sort]

    def list_gone(self, body: Bodies, name: str) -> set[str]:
        """Targets of a body (1) to which nothing more can happen after it."""
        return set()

    def list_implied(self, robot: LeggedRobot, name: str) -> set[str]:
        """Targets of a legged robot of which it says all."""
        return set()


class _Nothing(DamageKind):
    name = "none"
    meaning = "nothing happened"
    text = "nothing"


class _PartScale(DamageKind):
    name = "part_scale"
    sort = "body"
    meaning = "factor on a part's length, thickness and mass [1]"
    text = "{name} x {value:.2f}"
    usage = "PART:SCALE"
    limits = (0.05, 2.0)
    least = sys.float_info.min
    drawn = (0.1, 0.75)  # chosen, as all that is drawn: wide enough to matter
    grows = True
    # paper A: 0.1 to 2; 0.03 are 5 mm of the longest part
    heal_values = Values(SCALES, 0.1, 0.05, 2.0, 0.03)

    def change_plant(self, plant: "Plant", damage: Damage) -> "Plant":
        part = plant.body.anatomy.parts.index(damage.name)
        return _scale_parts_of(plant, [part], damage.value)


class _LimbLoss(DamageKind):
    name = "limb_loss"
    sort = "body"
    meaning = "a part and its descendants are gone; value 0"
    text = "{name} lost"
    usage = "loss:PART"
    is_estimated = True
    heal_values = recover_values = Values()

    def change_plant(self, plant: "Plant", damage: Damage) -> "Plant":
        return _scale_parts_of(plant, _list_lost_parts(plant.body, damage.name), 0.0)

    def change_legged(self, plants: "LeggedPlants", row: int, damage: Damage) -> None:
        """An angle sensor is lost with its joint; a touch sensor touches nothing."""
        robot = plants.robot
        plants.present[row, robot.list_bodies_below(damage.name)] = False
        lost = _list_lost_dofs(robot, damage.name)
        plants.motor_gain[row, lost] = 0.0
        for dof in lost:
            angle = f"{robot.joint_of_motor(dof).name}_position"
            if angle in robot.sensors:
                plants.sensor_gain[row, robot.sensors.index(angle)] = 0.0

    def list_estimated_places(self, robot: LeggedRobot) -> Sequence[str]:
        """The part of each joint."""
        return [site.part for site in robot.damage_sites]

    def list_gone(self, body: Bodies, name: str) -> set[str]:
        gone = set[str]()
        for k in _list_lost_parts(body, name):
            part, joint = body.anatomy.parts[k], body.anatomy.joints[k]
            gone |= {f"body:{part}", f"sensor:{part}_touch", f"joint:{joint}"}
            gone |= {f"actuator:{joint}_servo", f"sensor:{joint}_position"}
        return gone

    def list_implied(self, robot: LeggedRobot, name: str) -> set[str]:
        names = {robot.model.body(k).name for k in robot.list_bodies_below(name)}
        sites = [site.name for site in robot.damage_sites if site.part in names]
        implied = {f"body:{each}" for each in names} | {f"joint:{s}" for s in sites}
        for dof in _list_lost_dofs(robot, name):
            implied.add(f"actuator:{robot.motors[dof]}")
            implied.add(f"sensor:{robot.joint_of_motor(dof).name}_position")
        return implied


class _JointJam(DamageKind):
    name = "joint_jam"
    sort = "joint"
    meaning = "a joint stands still at this angle [rad]"
    text = "{name} jammed at {degrees:.0f} deg"
    usage = "jam:JOINT[:DEGREES]"
    limits = (-90, 90)
    default = 0.0
    is_angle = True
    drawn = (-45 * DEG, 45 * DEG)
    is_estimated = True
    heal_values = Values(JAMS, 8 * DEG, -96 * DEG, 96 * DEG, DEG)
    recover_values = Values()  # where it stood when the robot was built

    def change_plant(self, plant: "Plant", damage: Damage) -> "Plant":
        jam = plant.jam.copy()
        jam[plant.body.anatomy.joints.index(damage.name)] = damage.value
        return replace(plant, jam=jam)

    def change_legged(self, plants: "LeggedPlants", row: int, damage: Damage) -> None:
        (site,) = (s for s in plants.robot.damage_sites if s.name == damage.name)
        plants.unlocked[row, list(site.dofs)] = False

    def list_gone(self, body: Bodies, name: str) -> set[str]:
        return {f"joint:{name}", f"actuator:{name}_servo"}


class _Weakened(DamageKind):
    """What keeps a share of its strength."""

    limits = (0.05, 1.0)
    default = 0.5
    least = 0.0
    drawn = (0.15, 0.5)
    heal_values = Values(SHARES, 0.1, 0.05, 1.0, 0.04)
    recover_values = Values(SHARES, 0.075, 0.02, 1.0)


class _WeakMotor(_Weakened):
    name = "weak_motor"
    sort = "actuator"
    meaning = "factor on a motor's torque and speed [1]"
    text = "{name} at {value:.2f} of its strength"
    usage = "weak:ACTUATOR[:FACTOR]"
    grows = True

    def change_plant(self, plant: "Plant", damage: Damage) -> "Plant":
        factor = np.ones(plant.body.anatomy.size)
        joint = damage.name.removesuffix("_servo")
        factor[plant.body.anatomy.joints.index(joint)] = damage.value
        return replace(plant, torque=plant.torque * factor, speed=plant.speed * factor)

    def change_legged(self, plants: "LeggedPlants", row: int, damage: Damage) -> None:
        motor = plants.robot.motors.index(damage.name)
        plants.motor_gain[row, motor] *= damage.value


class _SensorKind(DamageKind):
    """A sensor that reads a share of what is true, which is the damage's value."""

    sort = "sensor"

    def change_plant(self, plant: "Plant", damage: Damage) -> "Plant":
        gain = plant.gain.get(damage.name, 1.0) * damage.value
        return replace(plant, gain={**plant.gain, damage.name: gain})

    def change_legged(self, plants: "LeggedPlants", row: int, damage: Damage) -> None:
        sensor = plants.robot.sensors.index(damage.name)
        plants.sensor_gain[row, sensor] *= damage.value


class _SensorDead(_SensorKind):
    name = "sensor_dead"
    meaning = "a sensor reads this for ever; value 0"
    text = "sensor {name} dead"
    usage = "dead:SENSOR"
    is_estimated = True
    heal_values = recover_values = Values()

    def list_gone(self, body: Bodies, name: str) -> set[str]:
        return {f"sensor:{name}"}


class _WeakSensor(_Weakened, _SensorKind):
    name = "weak_sensor"
    meaning = "factor on what a sensor reads [1]"
    text = "sensor {name} at {value:.2f}"
    usage = "lie:SENSOR[:FACTOR]"


class _NeuronDead(DamageKind):
    name = "neuron_dead"
    sort = "neuron"
    meaning = "a hidden neuron gives this for ever; value 0"
    text = "hidden neuron {name} dead"
    recover_values = Values()

    def change_legged(self, plants: "LeggedPlants", row: int, damage: Damage) -> None:
        plants.neuron_gain[row, int(damage.name)] = 0.0


class _Slope(DamageKind):
    name = "slope"
    meaning = "the ground tilts by this angle [rad]"
    text = "slope of {degrees:.0f} deg"
    usage = "slope:DEGREES[:AZIMUTH]"
    limits = (0, 40)
    is_angle = True
    has_azimuth = True
    drawn = (5 * DEG, 12 * DEG)
    heal_values = Values(SLOPES, 5 * DEG, 0.0, 30 * DEG, DEG)
    recover_values = Values(SLOPES, 2.5 * DEG, 0.0, 0.5)

    def change_plant(self, plant: "Plant", damage: Damage) -> "Plant":
        return replace(plant, slope=np.array([damage.value, damage.azimuth]))

    def change_legged(self, plants: "LeggedPlants", row: int, damage: Damage) -> None:
        downhill = np.array([*compute_direction(damage.azimuth), 0.0])
        level = plants.robot.model.opt.gravity
        plants.gravity[row] = tilt_gravity(level, damage.value, downhill)


class _GroundFriction(DamageKind):
    name = "ground_friction"
    meaning = "sliding friction of the ground [1]"
    text = "ground friction {value:.2f}"
    usage = "friction:VALUE"
    limits = (0.01, 5.0)
    least = 0.0
    drawn = (0.05, 0.2)
    heal_values = Values(FRICTIONS, 0.1, 0.02, 1.5, 0.02)
    recover_values = Values(FRICTIONS, 0.05, 0.02, 1.5)

    def change_plant(self, plant: "Plant", damage: Damage) -> "Plant":
        return replace(plant, physics=replace(plant.physics, friction=damage.value))

    def change_legged(self, plants: "LeggedPlants", row: int, damage: Damage) -> None:
        plants.friction[row] = damage.value


class _Wind(DamageKind):
    name = "wind"
    meaning = "speed of a steady wind [m/s]"
    text = "wind of {value:.0f} m/s"
    has_azimuth = True
    # a breeze to a strong one
    recover_values = Values((3.0, 6.0, 10.0), 1.5, 0.0, 20.0)

    def change_legged(self, plants: "LeggedPlants", row: int, damage: Damage) -> None:
        plants.wind[row, :2] = damage.value * compute_direction(damage.azimuth)


KINDS: dict[str, DamageKind] = {
    kind.name: kind
    for kind in (
        *(_Nothing(), _PartScale(), _LimbLoss(), _JointJam(), _WeakMotor()),
        *(_SensorDead(), _WeakSensor(), _NeuronDead()),
        *(_Slope(), _GroundFriction(), _Wind()),
    )
}


def _list_lost_parts(body: Bodies, name: str) -> list[int]:
    """A part (0..P-1) and its descendants."""
    root = body.anatomy.parts.index(name) + 1  # node 0 is the torso
    return [node - 1 for node in list_subtree([-1, *body.parent[0]], root)]


def _list_lost_dofs(robot: LeggedRobot, name: str) -> list[int]:
    """Degrees of freedom that are lost with a part, as indices of motors."""
    gone = robot.list_bodies_below(name)
    bodies = [int(robot.joint_of_motor(d).bodyid[0]) for d in range(len(robot.motors))]
    return [dof for dof, body in enumerate(bodies) if body in gone]


def _scale_parts_of(plant: "Plant", parts: list[int], factor: float) -> "Plant":
    """Scale parts, but for what MuJoCo needs of them."""
    scale = np.ones((1, plant.body.anatomy.size))
    least = _LOST_SIZE / plant.body.thickness
    scale[0, parts] = np.maximum(factor, least[0, parts])
    return replace(plant, body=scale_parts(plant.body, scale))
