"""A body that is not the one the model states: its mass, its shape, its attachment."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...body.changes import LOST_SHARE, list_subtree
from ...recording.data import Floats
from ..data.robot_summary import (
    Joint,
    MovingBody,
    RobotSummary,
    find_link_axis,
    min_stable_inertia,
)
from .base import Term
from .by_target import BodyEffect, JointEffect, join_terms
from .declaration import SELDOM, Parameters, ParameterSpec, Starts
from .inertia import add_mass, stretch_body
from .places import BodyPlace, JointPlace
from .protocols import ModelEdit

if TYPE_CHECKING:
    from mujoco import MjModel

# times a joint's inertia, the rotor of one that is stuck; chosen
JAMMED_ARMATURE_RATIO = 1000.0
MAX_JAMMED_RANGE = 0.1  # [rad or m] in which one moves; chosen: a jammed gear gives


class Payload(BodyEffect, ModelEdit[BodyPlace]):
    name = "payload"
    description = "A mass that the model does not have."
    equation = "a point of that mass fixed to the body"
    source = "MuJoCo geom/mass"
    separate_by = "repeat with a second known mass, or in another pose"
    phrase = "{at} carries a mass of {mass} {lacks}"
    parameters = (
        ParameterSpec("mass", "kg", nominal=0.0, nonnegative=True),
        ParameterSpec("position", "m", size=3),  # in the body's frame
    )
    log_odds = SELDOM

    def make_parameters(self, robot: RobotSummary, body: MovingBody) -> Parameters:
        position = [
            replace(
                self.bound(
                    "position",
                    nominal=float(body.far_end[i]),
                    low=float(body.box[i, 0]),
                    high=float(body.box[i, 1]),
                    scale=0.3 * body.size,
                ),
                name=f"position_{x}",
            )
            for i, x in enumerate("xyz")
        ]
        # a light hand may bear much: as much as all that moves
        most = max(5 * body.subtree_mass, sum(b.mass for b in robot.bodies))
        mass = self.bound("mass", low=0.0, high=most, scale=0.2 * body.mass)
        return (mass, *position)

    def make_initial_values(self, robot: RobotSummary, body: MovingBody) -> Starts:
        m = 0.2 * body.mass
        return tuple((m, *map(float, p)) for p in (body.far_end, body.com))

    def applies_to(self, robot: RobotSummary, body: MovingBody) -> bool:
        """Of parts that are fixed to each other the last one, such as a gripper."""
        model, inner = robot.model, {0}
        for other in robot.bodies:
            parent = other.parent if other.mass else 0
            while parent and model.body_weldid[parent] == model.body_weldid[other.id]:
                inner.add(parent)
                parent = int(model.body_parentid[parent])
        return bool(body.mass) and body.id not in inner

    def edit_model(self, model: "MjModel", place: BodyPlace, values: Floats) -> None:
        add_mass(model, place.body, values[0], values[1:])


class ComShift(BodyEffect, ModelEdit[BodyPlace]):
    name = "com_shift"
    description = "The center of mass lies elsewhere."
    equation = "com = stated com + (x, y, z)"
    source = "MuJoCo inertial/pos"
    separate_by = "repeat in another pose"
    phrase = "{at} has its center of mass elsewhere than in the model ({all})"
    parameters = tuple(ParameterSpec(x, "m", nominal=0.0) for x in "xyz")
    log_odds = SELDOM

    def make_parameters(self, robot: RobotSummary, body: MovingBody) -> Parameters:
        reach = body.size
        return tuple(
            self.bound(x, low=-reach, high=reach, scale=0.05 * reach) for x in "xyz"
        )

    def make_initial_values(self, robot: RobotSummary, body: MovingBody) -> Starts:
        """None, from which a fit may go either way; one each way tells its response."""
        scales = [p.scale for p in self.make_parameters(robot, body)]
        return ((0.0, 0.0, 0.0), *map(tuple, np.diag(scales).tolist()))

    def applies_to(self, robot: RobotSummary, body: MovingBody) -> bool:
        return bool(body.mass)

    def edit_model(self, model: "MjModel", place: BodyPlace, values: Floats) -> None:
        body = place.body
        model.body_ipos[body] += values
        model.body_sameframe[body] = 0


class LinkLength(BodyEffect, ModelEdit[BodyPlace]):
    name = "link_length"
    description = "The part is longer or shorter than stated."
    equation = "everything in the body scales along it by length / stated length"
    source = "Bongard, Zykov, Lipson 2006: part scales"
    separate_by = "touch one known point with the part in two poses"
    phrase = "{at} has a length of {length}, {other}"
    parameters = (ParameterSpec("length", "m", nonnegative=True, is_in_model=True),)
    overrides = ("length",)

    def make_parameters(self, robot: RobotSummary, body: MovingBody) -> Parameters:
        now = body.length
        return (
            self.bound(
                "length", nominal=now, low=0.02 * now, high=2 * now, scale=0.1 * now
            ),
        )

    def make_initial_values(self, robot: RobotSummary, body: MovingBody) -> Starts:
        return tuple((share * body.length,) for share in (0.2, 0.6, 0.85, 1.15))

    def applies_to(self, robot: RobotSummary, body: MovingBody) -> bool:
        return body.length > 0

    def edit_model(self, model: "MjModel", place: BodyPlace, values: Floats) -> None:
        axis, length = find_link_axis(model, place.body)
        stretch_body(model, place.body, axis, values[0] / length)


class MountShift(BodyEffect, ModelEdit[BodyPlace]):
    name = "mount_shift"
    description = "The part is attached elsewhere on its parent."
    equation = "body pos = stated pos + (x, y, z)"
    source = "MuJoCo body/pos"
    separate_by = "move the part while its parent is held"
    phrase = "{at} is attached elsewhere than in the model ({all})"
    parameters = tuple(ParameterSpec(x, "m", nominal=0.0) for x in "xyz")

    def make_parameters(self, robot: RobotSummary, body: MovingBody) -> Parameters:
        reach = self._max_shift(body)
        return tuple(
            self.bound(x, low=-reach, high=reach, scale=0.05 * reach) for x in "xyz"
        )

    def make_initial_values(self, robot: RobotSummary, body: MovingBody) -> Starts:
        # also a fifth of the way: which foot bears it may change between
        far = 0.2 * self._max_shift(body) * np.eye(3)
        return tuple(map(tuple, np.vstack([np.zeros(3), far, -far]).tolist()))

    def _max_shift(self, body: MovingBody) -> float:
        """The farthest [m] that a body's mount may have moved."""
        return max(body.offset, body.size)

    def applies_to(self, robot: RobotSummary, body: MovingBody) -> bool:
        return not body.is_floating and body.parent != 0

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term at each body, and one at all that hang on the same parent."""
        found = super().propose_terms(robot)
        by_parent: dict[int, list[Term]] = {}
        bodies = [b for b in robot.bodies if self.applies_to(robot, b)]
        for body, term in zip(bodies, found, strict=True):
            by_parent.setdefault(body.parent, []).append(term)
        groups = [group for group in by_parent.values() if len(group) > 1]
        return [*found, *map(join_terms, groups)]

    def edit_model(self, model: "MjModel", place: BodyPlace, values: Floats) -> None:
        model.body_pos[place.body] += values


class LimbLoss(BodyEffect, ModelEdit[BodyPlace]):
    """A lost limb; its joints keep as much of a rotor as their servos need."""

    name = "limb_loss"
    description = "The part, and all that hung on it, is gone."
    equation = "mass and contacts of the part are zero"
    source = "Bongard, Zykov, Lipson 2006: damage"
    separate_by = "load the joint above it"
    phrase = "{at} is lost"

    def make_parameters(self, robot: RobotSummary, body: MovingBody) -> Parameters:
        return ()

    def make_initial_values(self, robot: RobotSummary, body: MovingBody) -> Starts:
        return ((),)

    def applies_to(self, robot: RobotSummary, body: MovingBody) -> bool:
        return not body.is_floating and body.parent != 0

    def edit_model(self, model: "MjModel", place: BodyPlace, values: Floats) -> None:
        for body in list_subtree(model.body_parentid, place.body):
            model.body_mass[body] *= LOST_SHARE
            model.body_inertia[body] *= LOST_SHARE
            for dof in np.flatnonzero(model.dof_bodyid == body):
                least = min_stable_inertia(model, model.dof_jntid[dof])
                model.dof_armature[dof] = max(model.dof_armature[dof], least)
            geoms = np.flatnonzero(model.geom_bodyid == body)
            model.geom_size[geoms] *= LOST_SHARE
            model.geom_pos[geoms] *= LOST_SHARE
            model.geom_contype[geoms] = 0
            model.geom_conaffinity[geoms] = 0


class JointJam(JointEffect, ModelEdit[JointPlace]):
    name = "joint_jam"
    group = "body"
    description = "The joint is stuck at an angle."
    equation = "q = angle"
    source = "Bongard, Lipson 2005: damage"
    separate_by = "command the joint"
    phrase = "{at} is stuck at {angle}"
    parameters = (ParameterSpec("angle", "rad"),)

    def make_parameters(self, robot: RobotSummary, joint: Joint) -> Parameters:
        return (
            self.bound(
                "angle",
                joint,
                nominal=joint.late_center,
                low=joint.late_center - joint.range,
                high=joint.late_center + joint.range,
                scale=0.1 * joint.range,
            ),
        )

    def make_initial_values(self, robot: RobotSummary, joint: Joint) -> Starts:
        return ((joint.late_center,),)

    def applies_to(self, robot: RobotSummary, joint: Joint) -> bool:
        """Of joints that were not seen to move, or not any more."""
        return joint.late_range < MAX_JAMMED_RANGE or not joint.measured

    def edit_model(self, model: "MjModel", place: JointPlace, values: Floats) -> None:
        # a spring of 20 ms period or so, critically damped, that a step can carry, and
        # so heavy a rotor that no torque of the robot bends it
        rate = min(300.0, 1 / model.opt.timestep)
        inertia = JAMMED_ARMATURE_RATIO * place.inertia
        model.dof_armature[place.dof] = inertia
        model.jnt_stiffness[place.joint] = inertia * rate**2
        model.qpos_spring[model.jnt_qposadr[place.joint]] = values[0]
        model.dof_damping[place.dof] = 2 * inertia * rate
