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
from .base import Effect, Term
from .by_target import BodyEffect, JointEffect, join_terms
from .declaration import SELDOM, Parameter, ParameterSpec, Proposal
from .inertia import add_mass, stretch_body
from .places import BodyPlace, JointPlace
from .protocols import ModelEdit

if TYPE_CHECKING:
    from mujoco import MjModel

# times a joint's inertia, the rotor of one that is stuck; chosen
JAMMED_ARMATURE_RATIO = 1000.0
MAX_JAMMED_RANGE = 0.1  # [rad or m] in which one moves; chosen: a jammed gear gives


def bound_shift(effect: Effect, reach: float) -> tuple[Parameter, ...]:
    """The parameters x, y and z of an effect that moves something by a reach [m]."""
    bounds, scale = (-reach, reach), 0.05 * reach
    return tuple(effect.bound(x, bounds, scale=scale) for x in "xyz")


def _hangs_on_another(body: MovingBody) -> bool:
    """Whether a body neither floats nor is attached to the world."""
    return not body.is_floating and body.parent != 0


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

    def propose_at(self, robot: RobotSummary, body: MovingBody) -> Proposal | None:
        """Of parts that are fixed to each other at the last one, such as a gripper."""
        if not body.mass or body.id in _list_inner_parts(robot):
            return None
        position = [
            replace(
                self.bound(
                    "position",
                    (float(low), float(high)),
                    scale=0.3 * body.size,
                    nominal=float(end),
                ),
                name=f"position_{x}",
            )
            for x, (low, high), end in zip("xyz", body.box, body.far_end, strict=True)
        ]
        # a light hand may bear much: as much as all that moves
        most = max(5 * body.subtree_mass, sum(b.mass for b in robot.bodies))
        m = 0.2 * body.mass
        mass = self.bound("mass", (0.0, most), scale=m)
        starts = tuple((m, *map(float, p)) for p in (body.far_end, body.com))
        return Proposal((mass, *position), starts)

    def edit_model(self, model: "MjModel", place: BodyPlace, values: Floats) -> None:
        add_mass(model, place.body, values[0], values[1:])


def _list_inner_parts(robot: RobotSummary) -> set[int]:
    """Ids of bodies on which another one with mass is fixed, and of the world."""
    model, inner = robot.model, {0}
    for body in robot.bodies:
        parent = body.parent if body.mass else 0
        while parent and model.body_weldid[parent] == model.body_weldid[body.id]:
            inner.add(parent)
            parent = int(model.body_parentid[parent])
    return inner


class ComShift(BodyEffect, ModelEdit[BodyPlace]):
    name = "com_shift"
    description = "The center of mass lies elsewhere."
    equation = "com = stated com + (x, y, z)"
    source = "MuJoCo inertial/pos"
    separate_by = "repeat in another pose"
    phrase = "{at} has its center of mass elsewhere than in the model ({all})"
    parameters = tuple(ParameterSpec(x, "m", nominal=0.0) for x in "xyz")
    log_odds = SELDOM

    def propose_at(self, robot: RobotSummary, body: MovingBody) -> Proposal | None:
        """Begin at none, from which a fit may go either way, then one on each axis."""
        if not body.mass:
            return None
        reach = body.size
        shift = bound_shift(self, reach)
        scales = np.diag([p.scale for p in shift])
        return Proposal(shift, ((0.0, 0.0, 0.0), *map(tuple, scales.tolist())))

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

    def propose_at(self, robot: RobotSummary, body: MovingBody) -> Proposal | None:
        now = body.length
        if not now > 0:
            return None
        bounds, scale = (0.02 * now, 2 * now), 0.1 * now
        length = self.bound("length", bounds, scale=scale, nominal=now)
        shares = (0.2, 0.6, 0.85, 1.15)
        return Proposal((length,), tuple((share * now,) for share in shares))

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

    def propose_at(self, robot: RobotSummary, body: MovingBody) -> Proposal | None:
        if not _hangs_on_another(body):
            return None
        reach = max(body.offset, body.size)  # [m] that it may have moved
        # also a fifth of the way: which foot bears it may change between
        far = 0.2 * reach * np.eye(3)
        starts = np.vstack([np.zeros(3), far, -far]).tolist()
        return Proposal(bound_shift(self, reach), tuple(map(tuple, starts)))

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term at each body, and one at all that have the same parent."""
        found = super().propose_terms(robot)
        by_parent: dict[int, list[Term]] = {}
        for term in found:
            (place,) = term.places
            assert isinstance(place, BodyPlace)  # by `BodyEffect`
            parent = int(robot.model.body_parentid[place.body])
            by_parent.setdefault(parent, []).append(term)
        groups = [group for group in by_parent.values() if len(group) > 1]
        return [*found, *map(join_terms, groups)]

    def edit_model(self, model: "MjModel", place: BodyPlace, values: Floats) -> None:
        model.body_pos[place.body] += values


class LimbLoss(BodyEffect, ModelEdit[BodyPlace]):
    """A lost limb; its joints keep as much of a rotor as their servos need."""

    name = "limb_loss"
    description = "The part, and all that was attached to it, is gone."
    equation = "mass and contacts of the part are zero"
    source = "Bongard, Zykov, Lipson 2006: damage"
    separate_by = "load the joint above it"
    phrase = "{at} is lost"

    def propose_at(self, robot: RobotSummary, body: MovingBody) -> Proposal | None:
        return Proposal((), ((),)) if _hangs_on_another(body) else None

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

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal | None:
        """Of joints that were not seen to move, or not any more."""
        if joint.late_range >= MAX_JAMMED_RANGE and joint.measured:
            return None
        at, reach = joint.late_center, joint.range
        angle = self.bound(
            "angle", (at - reach, at + reach), scale=0.1 * reach, at=joint, nominal=at
        )
        return Proposal((angle,), ((at,),))

    def edit_model(self, model: "MjModel", place: JointPlace, values: Floats) -> None:
        # a spring of 20 ms period or so, critically damped, that a step can carry, and
        # so heavy a rotor that no torque of the robot bends it
        rate = min(300.0, 1 / model.opt.timestep)
        inertia = JAMMED_ARMATURE_RATIO * place.inertia
        model.dof_armature[place.dof] = inertia
        model.jnt_stiffness[place.joint] = inertia * rate**2
        model.qpos_spring[model.jnt_qposadr[place.joint]] = values[0]
        model.dof_damping[place.dof] = 2 * inertia * rate
