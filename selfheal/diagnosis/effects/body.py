"""A body that is not the one the model states."""

import numpy as np

from ..data.robot_summary import RobotSummary, find_link_axis, min_stable_inertia
from .base import Effect, Floats, Parameter, Term, extend_places

HEAVY = 1000.0  # times a joint's inertia, the rotor of one that is stuck; chosen
STILL = 1.5  # times a reading's noise, the spread of one that tells no motion; chosen
LEFT = 1e-3  # of a lost limb's mass and inertia; chosen: nothing, and it still steps


class BodyEffect(Effect):
    """What all of them share: a body that moves."""

    group = "body"
    rarity = 2

    def make_parameters(self, robot: RobotSummary, body) -> tuple[Parameter, ...]:
        """Its numbers at a body; `body` is a `scene.Moving`."""
        raise NotImplementedError

    def make_initial_values(
        self, robot: RobotSummary, body
    ) -> tuple[tuple[float, ...], ...]:
        """Values to begin a search at."""
        raise NotImplementedError

    def applies_to(self, robot: RobotSummary, body) -> bool:
        """Whether it could be at this body."""
        return True

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """At every body that moves."""
        return [
            Term(
                self,
                (f"body:{body.name}",),
                ({"body": body.id},),
                self.make_parameters(robot, body),
                self.make_initial_values(robot, body),
            )
            for body in robot.bodies
            if self.applies_to(robot, body)
        ]


class Payload(BodyEffect):
    name = "payload"
    vector_parameter = "position"
    rarity = 1
    description = "A mass that the model does not have."
    equation = "a point of that mass fixed to the body"
    source = "MuJoCo geom/mass"
    separate_by = "repeat with a second known mass, or in another pose"
    regime = "high_load"

    def make_parameters(self, robot, body):
        axis = [
            Parameter(
                "position_" + x,
                "m",
                float(body.far_end[i]),
                float(body.box[i, 0]),
                float(body.box[i, 1]),
                0.3 * body.size,
            )
            for i, x in enumerate("xyz")
        ]
        # a light hand may bear much: as much as all that moves
        most = max(5 * body.subtree_mass, sum(b.mass for b in robot.bodies))
        mass = Parameter("mass", "kg", 0.0, 0.0, most, 0.2 * body.mass)
        return (mass, *axis)

    def make_initial_values(self, robot, body):
        m = 0.2 * body.mass
        return tuple((m, *map(float, p)) for p in (body.far_end, body.com))

    def applies_to(self, robot, body):
        """Of parts that are fixed to each other the last one, such as a gripper."""
        model, inner = robot.model, {0}
        for other in robot.bodies:
            parent = other.parent if other.mass else 0
            while parent and model.body_weldid[parent] == model.body_weldid[other.id]:
                inner.add(parent)
                parent = int(model.body_parentid[parent])
        return bool(body.mass) and body.id not in inner

    def edit_model(self, model, place, values):
        add_mass(model, place["body"], values[0], values[1:])


def spatial_inertia(model, body: int) -> Floats:
    """Inertia (3, 3) [kg m^2] of a body about its center of mass, in its frame."""
    turn = _rotation_matrix(model.body_iquat[body])
    return turn @ np.diag(model.body_inertia[body]) @ turn.T


def _rotation_matrix(quaternion: Floats) -> Floats:
    """The rotation (3, 3) of a quaternion (4)."""
    import mujoco

    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, quaternion)
    return flat.reshape(3, 3)


def set_spatial_inertia(
    model, body: int, mass: float, com: Floats, inertia: Floats
) -> None:
    """Give a body its mass [kg], center of mass (3) [m] and inertia (3, 3) [kg m^2].

    The inertia is about the center of mass, in the body's frame.
    """
    import mujoco

    old = model.body_iquat[body].copy()
    turn = _rotation_matrix(old)
    sizes, further = _principal_axes(turn.T @ inertia @ turn)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, further.ravel())
    mujoco.mju_mulQuat(model.body_iquat[body], old, quaternion)
    model.body_mass[body] = mass
    model.body_ipos[body] = com
    model.body_inertia[body] = np.maximum(sizes, 1e-12)
    model.body_sameframe[body] = 0


def _principal_axes(inertia: Floats) -> tuple[Floats, Floats]:
    """Principal moments (3) of an inertia, and their axes (3, 3) in its frame.

    By the rotations of Jacobi (1846), none beyond 45 degrees: axes that are principal
    already stay, also where two moments are equal and any axes would do.
    """
    turned, axes = inertia, np.eye(3)
    for p, q in 8 * ((0, 1), (0, 2), (1, 2)):
        apart, product = turned[p, p] - turned[q, q], turned[p, q]
        if abs(product) <= 1e-13 * np.trace(inertia):  # rounding
            continue
        angle = 0.5 * np.arctan2(2 * np.copysign(product, product * apart), abs(apart))
        turn = np.eye(3)
        turn[p, p] = turn[q, q] = np.cos(angle)
        turn[q, p], turn[p, q] = np.sin(angle), -np.sin(angle)
        turned, axes = turn.T @ turned @ turn, axes @ turn
    return np.diag(turned), axes


def _point_inertia(mass: float, at: Floats) -> Floats:
    return mass * (at @ at * np.eye(3) - np.outer(at, at))


def add_mass(model, body: int, mass: float, at: Floats) -> None:
    """Fix a point mass [kg] to a body, at (3) [m] in its frame."""
    m, c = float(model.body_mass[body]), model.body_ipos[body].copy()
    total = m + mass
    com = (m * c + mass * at) / total
    inertia = (
        spatial_inertia(model, body)
        + _point_inertia(m, c - com)
        + _point_inertia(mass, at - com)
    )
    set_spatial_inertia(model, body, total, com, inertia)


class ComShift(BodyEffect):
    name = "com_shift"
    rarity = 1
    description = "The center of mass lies elsewhere."
    equation = "com = stated com + (x, y, z)"
    source = "MuJoCo inertial/pos"
    separate_by = "repeat in another pose"
    regime = "high_load"

    def make_parameters(self, robot, body):
        unit = body.size
        return tuple(Parameter(x, "m", 0.0, -unit, unit, 0.05 * unit) for x in "xyz")

    def make_initial_values(self, robot, body):
        return ((0.0, 0.0, 0.0),)

    def applies_to(self, robot, body):
        return bool(body.mass)

    def edit_model(self, model, place, values):
        body = place["body"]
        model.body_ipos[body] += values
        model.body_sameframe[body] = 0


class LinkLength(BodyEffect):
    name = "link_length"
    overrides = ("length",)
    description = "The part is longer or shorter than stated."
    equation = "everything in the body scales along it by length / stated length"
    source = "Bongard, Zykov, Lipson 2006: part scales"
    separate_by = "touch one known point with the part in two poses"

    def make_parameters(self, robot, body):
        nominal_terms = body.length
        return (
            Parameter(
                "length",
                "m",
                nominal_terms,
                0.02 * nominal_terms,
                2 * nominal_terms,
                0.1 * nominal_terms,
            ),
        )

    def make_initial_values(self, robot, body):
        return tuple((share * body.length,) for share in (0.2, 0.6, 0.85, 1.15))

    def applies_to(self, robot, body):
        return body.length > 0

    def edit_model(self, model, place, values):
        axis, length = find_link_axis(model, place["body"])
        stretch_body(model, place["body"], axis, values[0] / length)


def stretch_body(model, body: int, axis: Floats, ratio: float) -> None:
    """Scale what a body holds, and where its children hang, along an axis (3) of it."""
    grow = np.eye(3) + (ratio - 1) * np.outer(axis, axis)
    inertia = spatial_inertia(model, body)
    moments = grow @ (np.trace(inertia) / 2 * np.eye(3) - inertia) @ grow
    com = grow @ model.body_ipos[body]
    inertia = np.trace(moments) * np.eye(3) - moments
    set_spatial_inertia(model, body, float(model.body_mass[body]), com, inertia)
    for child in np.flatnonzero(model.body_parentid == body):
        if child != body:
            model.body_pos[child] = grow @ model.body_pos[child]
    for geom in np.flatnonzero(model.geom_bodyid == body):
        model.geom_pos[geom] = grow @ model.geom_pos[geom]
        lies = np.abs(
            _rotation_matrix(model.geom_quat[geom]).T @ axis
        )  # along its own axes
        if lies.max() > 0.99:
            _stretch_geom(model, int(geom), int(lies.argmax()), ratio)
    for site in np.flatnonzero(model.site_bodyid == body):
        model.site_pos[site] = grow @ model.site_pos[site]


def _stretch_geom(model, geom: int, axis: int, ratio: float) -> None:
    import mujoco

    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        model.geom_size[geom, axis] *= ratio
    elif axis == 2 and kind in (
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_CYLINDER,
    ):
        model.geom_size[geom, 1] *= ratio
    model.geom_rbound[geom] *= max(ratio, 1.0)


class MountShift(BodyEffect):
    name = "mount_shift"
    description = "The part is attached elsewhere on its parent."
    equation = "body pos = stated pos + (x, y, z)"
    source = "MuJoCo body/pos"
    separate_by = "move the part while its parent is held"

    def make_parameters(self, robot, body):
        reach = self._max_shift(body)
        return tuple(Parameter(x, "m", 0.0, -reach, reach, 0.05 * reach) for x in "xyz")

    def make_initial_values(self, robot, body):
        # also a fifth of the way: which foot bears it may change between
        far = 0.2 * self._max_shift(body) * np.eye(3)
        return tuple(map(tuple, np.vstack([np.zeros(3), far, -far]).tolist()))

    def _max_shift(self, body):
        return max(body.offset, body.size)

    def applies_to(self, robot, body):
        return not body.is_floating and body.parent != 0

    def propose_terms(self, robot):
        """At each body, and at all that hang alike on one parent."""
        found = super().propose_terms(robot)
        alike: dict[int, list[Term]] = {}
        for term in found:
            parent = int(robot.model.body_parentid[term.places[0]["body"]])
            alike.setdefault(parent, []).append(term)
        for group in alike.values():
            if len(group) > 1:
                targets = tuple(t.targets[0] for t in group)
                places = tuple(t.places[0] for t in group)
                first = group[0]
                found.append(
                    Term(self, targets, places, first.parameters, first.initial_values)
                )
        return found

    def edit_model(self, model, place, values):
        model.body_pos[place["body"]] += values


class LimbLoss(BodyEffect):
    """What remains at its joints is as much of a rotor as their servos need."""

    name = "limb_loss"
    description = "The part, and all that hung on it, is gone."
    equation = "mass and contacts of the part are zero"
    source = "Bongard, Zykov, Lipson 2006: damage"
    separate_by = "load the joint above it"

    def make_parameters(self, robot, body):
        return ()

    def make_initial_values(self, robot, body):
        return ((),)

    def applies_to(self, robot, body):
        return not body.is_floating and body.parent != 0

    def propose_terms(self, robot):
        return [
            extend_places(t, parts=len(_list_subtree(robot.model, t.places[0]["body"])))
            for t in super().propose_terms(robot)
        ]

    def rate_rarity(self, term, values):
        return self.rarity + term.places[0]["parts"] - 1  # no more than has to be lost

    def edit_model(self, model, place, values):
        for body in _list_subtree(model, place["body"]):
            model.body_mass[body] *= LEFT
            model.body_inertia[body] *= LEFT
            for dof in np.flatnonzero(model.dof_bodyid == body):
                least = min_stable_inertia(model, model.dof_jntid[dof])
                model.dof_armature[dof] = max(model.dof_armature[dof], least)
            geoms = np.flatnonzero(model.geom_bodyid == body)
            model.geom_size[geoms] *= LEFT
            model.geom_pos[geoms] *= LEFT
            model.geom_contype[geoms] = 0
            model.geom_conaffinity[geoms] = 0


def _list_subtree(model, body: int) -> list[int]:
    """A body and all that hang on it."""
    found = [body]
    for other in range(body + 1, model.nbody):
        if model.body_parentid[other] in found:
            found.append(other)
    return found


def _is_still(robot: RobotSummary, joint: str) -> bool:
    """Whether a joint's readings are one angle and noise."""
    kind = "joint_position"
    own = [c for c in robot.channels if (c.kind, c.target) == (kind, joint)]
    return any(c.spread < STILL * c.noise[0] for c in own)


class JointJam(Effect):
    name = "joint_jam"
    group = "body"
    description = "The joint is stuck at an angle."
    equation = "q = angle"
    source = "Bongard, Lipson 2005: damage"
    separate_by = "command the joint"

    def propose_terms(self, robot):
        """At every joint that was not seen to move."""
        return [
            Term(
                self,
                (f"joint:{joint.name}",),
                (
                    {
                        "joint": joint.id,
                        "dof": joint.dof,
                        "inertia": joint.inertia,
                        "still": _is_still(robot, joint.name),
                    },
                ),
                (
                    Parameter(
                        "angle",
                        joint.unit,
                        joint.range_center,
                        joint.range_center - joint.range,
                        joint.range_center + joint.range,
                        0.1 * joint.range,
                    ),
                ),
                ((joint.range_center,),),
            )
            for joint in robot.joints
            if joint.range < 0.1 or not joint.measured
        ]

    def is_directly_observed(self, term):
        """Where readings are one angle and noise, as a huge friction would have it."""
        return term.places[0]["still"]

    def edit_model(self, model, place, values):
        # a spring of 20 ms period or so, critically damped, that a step can carry, and
        # so heavy a rotor that no torque of the robot bends it
        rate, inertia = min(300.0, 1 / model.opt.timestep), HEAVY * place["inertia"]
        model.dof_armature[place["dof"]] = inertia
        model.jnt_stiffness[place["joint"]] = inertia * rate**2
        model.qpos_spring[model.jnt_qposadr[place["joint"]]] = values[0]
        model.dof_damping[place["dof"]] = 2 * inertia * rate
