"""Legged robots that know their body: a name in; places, motors and sensors out."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, UnknownNameError
from .changes import list_subtree
from .damage import Damage

if TYPE_CHECKING:
    import mujoco

LEGGED = ("hexapod", "quadruped")
REACHES = (30.0, 45.0)  # [deg] overview.txt 4.2.1 and 4.2.2
HIDDEN = 4  # neurons of the hidden layer (issue: 68 and 120 synapses)


@dataclass(frozen=True)
class DamageSite:
    """Where a joint can break or jam.

    Attributes:
        part: the part that is lost with it.
        dofs: its degrees of freedom, as indices of motors.
    """

    name: str
    part: str
    dofs: tuple[int, ...]


@dataclass(frozen=True)
class LeggedRobot:
    """A robot of Bongard and Lipson 2004.

    Attributes:
        reach: how far each joint flexes or extends from its default [rad].
        apart: whether every degree of freedom is a place of its own.
        model: the compiled MJCF; nobody writes to it.
    """

    name: str
    reach: float
    apart: bool
    model: "mujoco.MjModel"

    @cached_property
    def motors(self) -> tuple[str, ...]:
        """(D) names of the actuators."""
        return tuple(self.model.actuator(k).name for k in range(self.model.nactuator))

    @cached_property
    def sensors(self) -> tuple[str, ...]:
        """(S) names of the sensors: touches, then angles."""
        return tuple(self.model.sensor(k).name for k in range(self.model.nsensor))

    @property
    def feet(self) -> int:
        """How many of the sensors are touches."""
        return sum(name.endswith("_touch") for name in self.sensors)

    @property
    def has_bias(self) -> bool:
        """Whether the network has an input that is always 1: 68 synapses need one."""
        return self.name == "quadruped"

    @property
    def synapses(self) -> int:
        """(inputs) x HIDDEN + HIDDEN x (motors): 68 and 120."""
        return HIDDEN * (len(self.sensors) + self.has_bias + len(self.motors))

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """(P) names of the parts that can be lost, in the order of the tree."""
        return tuple(self.model.body(k).name for k in range(2, self.model.nbody))

    @cached_property
    def damage_sites(self) -> tuple[DamageSite, ...]:
        """Joints as damage counts them; hips of two degrees of freedom are one.

        That is how the overview's 12 joints (4.3) and 18 degrees of freedom (4.2.1) of
        the hexapod are both right.
        """
        found: dict[str, DamageSite] = {}
        for dof, joint in enumerate(self._joints):
            part = self.model.body(int(joint.bodyid[0])).name
            shared = int(self.model.body_jntnum[joint.bodyid[0]]) > 1
            name = joint.name
            if shared and not self.apart:
                name = f"{part.removesuffix('_upper')}_hip"
            before = found[name].dofs if name in found else ()
            found[name] = DamageSite(name, part, (*before, dof))
        return tuple(found.values())

    @property
    def targets(self) -> dict[str, tuple[str, ...]]:
        """Names of what may break, by what it is."""
        return {
            "body": self.parts,
            "joint": tuple(site.name for site in self.damage_sites),
            "actuator": self.motors,
            "sensor": self.sensors,
            "neuron": tuple(map(str, range(HIDDEN))),
        }

    @cached_property
    def _joints(self) -> "list[mujoco._MjModelJointViews]":
        """The joint of each motor."""
        ids = self.model.actuator_trnid[:, 0]
        return [self.model.joint(int(k)) for k in ids]

    def joint_of_motor(self, motor: int) -> "mujoco._MjModelJointViews":
        """A motor's joint in the model."""
        return self._joints[motor]

    def list_bodies_below(self, part: str) -> list[int]:
        """Bodies of the model that are lost with a part."""
        return list_subtree(self.model.body_parentid, int(self.model.body(part).id))


def load_legged_robot(
    name: str, reach: float = REACHES[0], apart: bool = False
) -> LeggedRobot:
    """The robot of a name.

    Args:
        name: of `LEGGED`.
        reach: [deg], of `REACHES`.
        apart: whether the hexapod's hips count as two joints each (18, not 12).

    Raises:
        UnknownNameError: there is none of that name.
        InputError: the reach is none that the overview gives.
    """
    if name not in LEGGED:
        raise UnknownNameError("legged robot", name, LEGGED)
    if reach not in REACHES:
        raise InputError(f"joints reach 30 or 45 degrees, not {reach:g}")
    import mujoco

    text = (files("selfheal.models") / name / f"{name}.xml").read_text("utf-8")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return LeggedRobot(name, float(np.radians(reach)), apart, model)


def reduce_damages(robot: LeggedRobot, damages: Sequence[Damage]) -> tuple[Damage, ...]:
    """Damages in one order, without those that others among them already say.

    Descendants of a lost part are lost, nothing of them jams or is driven, and the
    angle sensor of a broken joint is gone.
    """
    kept = dict.fromkeys(damages)
    for damage in damages:
        if damage.kind == "limb_loss":
            said = _list_implied_targets(robot, damage)
            kept = {d: None for d in kept if d == damage or d.target not in said}
    return tuple(sorted(kept, key=lambda d: (d.kind, d.target, d.value, d.azimuth)))


def _list_implied_targets(robot: LeggedRobot, loss: Damage) -> set[str]:
    """Targets of which the loss of a part says all."""
    gone = robot.list_bodies_below(loss.name)
    names = {robot.model.body(k).name for k in gone}
    said = {f"body:{name}" for name in names}
    said |= {f"joint:{p.name}" for p in robot.damage_sites if p.part in names}
    for dof, motor in enumerate(robot.motors):
        joint = robot.joint_of_motor(dof)
        if int(joint.bodyid[0]) in gone:
            said |= {f"actuator:{motor}", f"sensor:{joint.name}_position"}
    return said
