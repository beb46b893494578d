"""Physics of the robot's surroundings: gravity, the medium around it, the ground."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...body.changes import compute_direction, tilt_gravity
from ...errors import InputError
from ...recording.data import Floats
from ..data.robot_summary import RobotSummary
from .base import Term
from .by_target import WorldEffect
from .declaration import (
    SELDOM,
    Finding,
    FindingField,
    Parameter,
    ParameterSpec,
    Proposal,
)
from .places import GeomsPlace, Place
from .protocols import ModelEdit

if TYPE_CHECKING:
    from mujoco import MjModel

MAX_TILT = 0.5  # [rad] of a slope that nobody saw; chosen
# share of the largest torque of weight below which a direction has none; chosen:
# rounding of mj_rne
MIN_WEIGHT_TORQUE_CHANGE = 1e-6
RANDOM_POSES = 16  # random ones, whose torques of weight are compared; chosen
# [rad] by which a flat robot's slope may be off its plane; chosen
TILT_TOLERANCE = 0.01


@dataclass(frozen=True, kw_only=True)
class SlopePlace(Place):
    """The ground below a robot.

    Attributes:
        side: 1 or -1, of the two ways in which a flat robot's plane may slope; None:
            any azimuth.
    """

    side: int | None = None


class Slope(WorldEffect, ModelEdit[Place]):
    name = "slope"
    description = "What is taken for horizontal is tilted."
    equation = "gravity turned by tilt towards the downhill direction azimuth"
    source = "MuJoCo option/gravity"
    separate_by = "turn the robot by 180 degrees: a slope turns with the room"
    phrase = "the ground slopes by {tilt}, {other}"
    parameters = (
        ParameterSpec("tilt", "rad", nominal=0.0, nonnegative=True),
        ParameterSpec("azimuth", "rad", nominal=0.0),  # downhill, from +x towards +y
    )
    finding_fields = (FindingField("side", (1, -1), is_required=False),)
    place_type = SlopePlace

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term of any azimuth, or two of a robot whose parts move in one plane."""
        if not np.linalg.norm(robot.model.opt.gravity):
            return []
        tilt = self.bound("tilt", (0.0, MAX_TILT), scale=0.03)
        plane = _find_plane_azimuths(robot.model)
        if plane is None:
            azimuth = self.bound("azimuth", (-10.0, 10.0), scale=0.5)
            turns = np.deg2rad((0, 90, 180, -90))
            starts = tuple((0.05, float(a)) for a in turns)
            proposal = Proposal((tilt, azimuth), starts)
            return [self.make_term("world", SlopePlace(), proposal)]
        # across its plane a slope would only seem to weaken the gravity
        found = []
        for side, a in enumerate(plane):
            bounds = (a - TILT_TOLERANCE, a + TILT_TOLERANCE)
            azimuth = self.bound("azimuth", bounds, scale=TILT_TOLERANCE, nominal=a)
            proposal = Proposal((tilt, azimuth), ((0.05, a),))
            place = SlopePlace(side=1 - 2 * side)
            found.append(self.make_term("world", place, proposal))
        return found

    def is_consistent(self, parameters: Sequence[Parameter], values: Floats) -> bool:
        return bool(values[0] < 0.99 * MAX_TILT)  # else it stands for another effect

    def edit_model(self, model: "MjModel", place: Place, values: Floats) -> None:
        tilt, azimuth = values
        up = -model.opt.gravity / np.linalg.norm(model.opt.gravity)
        down = np.array([*compute_direction(azimuth), 0.0])
        down -= (down @ up) * up
        down /= max(np.linalg.norm(down), 1e-9)
        model.opt.gravity[:] = tilt_gravity(model.opt.gravity, tilt, down)


def _find_plane_azimuths(model: "MjModel") -> tuple[float, ...] | None:
    """Azimuths [rad] of the slopes that change a robot's torques of weight.

    Returns:
        The two of its plane where its parts move in one, none where they move upright
        only; None: any azimuth.
    """
    import mujoco

    other, data, rng = copy(model), mujoco.MjData(model), np.random.default_rng(0)
    if np.abs(model.opt.gravity[:2]).any():
        return None
    # torques, of gravity along each axis
    weight = np.zeros((3, RANDOM_POSES, model.nv))
    for pose in range(RANDOM_POSES):
        data.qpos[:] = model.qpos0 + rng.normal(size=model.nq)
        mujoco.mj_normalizeQuat(model, data.qpos)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for torque, other.opt.gravity[:] in zip(weight, np.eye(3), strict=True):
            mujoco.mj_rne(other, data, 0, torque[pose])
    across = weight[:2].reshape(2, -1)
    turns, sizes, _ = np.linalg.svd(across, full_matrices=False)
    flat = sizes < MIN_WEIGHT_TORQUE_CHANGE * np.linalg.norm(weight)
    if not flat[1]:
        return None
    along = float(np.arctan2(turns[1, 0], turns[0, 0]))
    along = (along + np.pi / 2) % np.pi - np.pi / 2  # the one nearer to +x
    return () if flat[0] else (along, along + np.pi)


@dataclass(frozen=True, kw_only=True)
class FluidPlace(Place):
    """A medium.

    Attributes:
        field: of mjOption, that says it.
    """

    field: str


class FluidDrag(WorldEffect, ModelEdit[FluidPlace]):
    name = "fluid_drag"
    description = "Air or water resists the parts that move through it."
    equation = "MuJoCo's inertia-box fluid model, of density or viscosity"
    source = "MuJoCo option/density, viscosity"
    separate_by = "change the area of a moving part"
    phrase = "a fluid {lacks} drags at {at} ({all})"
    parameters = (
        ParameterSpec("density", "kg/m^3", nonnegative=True, is_in_model=True),
        ParameterSpec("viscosity", "Pa s", nonnegative=True, is_in_model=True),
    )
    parameter_sets = (("density",), ("viscosity",))
    log_odds = SELDOM

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """Two terms, one of the density and one of the viscosity."""
        now = robot.model.opt
        return [
            self._make_term("density", now.density, 1e4, (1.2, 50.0, 500.0)),
            self._make_term("viscosity", now.viscosity, 100.0, (0.01, 0.3, 3.0)),
        ]

    def _make_term(
        self, name: str, now: float, high: float, starts: Sequence[float]
    ) -> Term:
        p = self.bound(name, (0.0, high), scale=starts[1], nominal=float(now))
        proposal = Proposal((p,), tuple((s,) for s in starts))
        return self.make_term("world", FluidPlace(field=name), proposal)

    def find_place(self, model: "MjModel", finding: Finding) -> Place:
        return FluidPlace(field=finding["parameters"][0]["name"])

    def edit_model(self, model: "MjModel", place: FluidPlace, values: Floats) -> None:
        setattr(model.opt, place.field, values[0])


class Wind(WorldEffect, ModelEdit[Place]):
    name = "wind"
    description = "The air moves."
    equation = "drag of the velocity relative to (vx, vy, vz)"
    source = "MuJoCo option/wind"
    separate_by = "turn the robot by 180 degrees"
    phrase = "a wind {lacks} blows ({all})"
    parameters = tuple(ParameterSpec("v" + x, "m/s") for x in "xyz")
    log_odds = SELDOM

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term where the model has a medium that could blow."""
        if not (robot.model.opt.density or robot.model.opt.viscosity):
            return []
        speed, wind = _terminal_speed(robot), robot.model.opt.wind
        most = max(50.0, speed)
        axes = tuple(
            self.bound("v" + x, (-most, most), scale=0.1 * speed, nominal=float(now))
            for x, now in zip("xyz", wind, strict=True)
        )
        starts = np.kron([[0.05], [0.5]], speed * np.eye(3)[:2])
        proposal = Proposal(axes, tuple(map(tuple, starts.tolist())))
        return [self.make_term("world", Place(), proposal)]

    def edit_model(self, model: "MjModel", place: Place, values: Floats) -> None:
        model.opt.wind[:] = values


def _terminal_speed(robot: RobotSummary) -> float:
    """The lowest terminal velocity [m/s] of the robot's bodies, to order of magnitude.

    Of a body of size d: sqrt(2 g m / (density d^2)) in a dense medium, and
    g m / (3 pi viscosity d) in a viscous one (Stokes 1851).
    """
    medium, g = robot.model.opt, 9.81  # [m/s^2]
    speeds = []
    for body in robot.bodies:
        if medium.density:
            area = medium.density * body.size**2
            speeds.append(np.sqrt(2 * g * body.mass / area))
        if medium.viscosity:
            thick = 3 * np.pi * medium.viscosity * body.size
            speeds.append(g * body.mass / thick)
    return float(min(speeds, default=1.0))


class GroundEffect(WorldEffect):
    """An effect on contacts with the ground, or with one geom of it.

    MuJoCo takes the larger friction of two geoms and the mean of their solref, or both
    of the one with the higher priority. Where both count, both geoms' are scaled by one
    factor, and so is the contact's. What the model states of each of them is kept.
    """

    target_kinds = ("world", "geom")

    def propose_place(self, robot: RobotSummary) -> GeomsPlace | None:
        """The geoms of the ground; None where nothing touched anything."""
        return find_ground_geoms(robot.model) if robot.has_contact else None

    def find_place(self, model: "MjModel", finding: Finding) -> Place:
        place = super().find_place(model, finding)
        if isinstance(place, GeomsPlace):
            return place
        ground = find_ground_geoms(model)
        if ground is None:
            raise InputError(
                f"the model has no ground, whose {self.name} the diagnosis names; "
                "would fit: a geom of the world that something can touch"
            )
        return ground


def find_ground_geoms(model: "MjModel") -> GeomsPlace | None:
    """The world's geoms that something which moves can touch; None without any."""
    fixed = np.flatnonzero(model.body_weldid[model.geom_bodyid] == 0)
    touch = model.geom_contype[fixed] | model.geom_conaffinity[fixed]
    place = GeomsPlace(geoms=tuple(int(g) for g in fixed[touch > 0]))
    return place if _find_contact_sides(model, place)[1].size else None


def _find_contact_sides(
    model: "MjModel", place: GeomsPlace
) -> tuple[np.ndarray, np.ndarray]:
    """The ground's geoms, and those of bodies that move which it can touch."""
    a = np.array(place.geoms, int)
    b = np.flatnonzero(model.body_weldid[model.geom_bodyid] != 0)
    meets = model.geom_contype[a][:, None] & model.geom_conaffinity[b]
    meets |= model.geom_conaffinity[a][:, None] & model.geom_contype[b]
    return a, b[meets.any(axis=0)]


def _find_deciding_sides(model: "MjModel", place: GeomsPlace) -> tuple[np.ndarray, ...]:
    """Geoms whose parameters a contact has: both sides, or that of higher priority."""
    ground, moving = sides = _find_contact_sides(model, place)
    ours, theirs = (model.geom_priority[g] for g in sides)
    if ours.min() > theirs.max():
        return (ground,)
    return (moving,) if theirs.min() > ours.max() else sides


class GroundFriction(GroundEffect, ModelEdit[GeomsPlace]):
    name = "ground_friction"
    description = "The ground is more slippery, or rougher, than stated."
    equation = "|f_tangential| <= friction f_normal, where the contact is roughest"
    source = "MuJoCo geom/friction"
    separate_by = "push the resting robot until it slides"
    phrase = "contact has a friction of {friction}, {other}"
    parameters = (ParameterSpec("friction", "1", nonnegative=True, is_in_model=True),)

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term where the robot touched the ground."""
        place = self.propose_place(robot)
        if place is None:
            return []
        sides = _find_deciding_sides(robot.model, place)
        now = _largest_friction(robot.model, sides)
        bounds = (0.0, max(5.0, 2 * now))
        p = self.bound("friction", bounds, scale=0.2, nominal=now)
        starts = ((0.1,), (0.3,), (0.6,), (1.5,))
        return [self.make_term("world", place, Proposal((p,), starts))]

    def edit_model(self, model: "MjModel", place: GeomsPlace, values: Floats) -> None:
        sides = _find_deciding_sides(model, place)
        now = _largest_friction(model, sides)
        for geoms in sides:
            if now:
                model.geom_friction[geoms, 0] *= values[0] / now
            else:
                model.geom_friction[geoms, 0] = values[0]


def _largest_friction(model: "MjModel", sides: Sequence[np.ndarray]) -> float:
    """The sliding friction [1] of the roughest geom."""
    return float(max(model.geom_friction[g, 0].max() for g in sides))


class GroundCompliance(GroundEffect, ModelEdit[GeomsPlace]):
    name = "ground_compliance"
    description = "The ground gives way, or bounces, otherwise than stated."
    equation = "contact as a spring and damper of timeconst and dampratio, on average"
    source = "MuJoCo geom/solref"
    separate_by = "drop a part from two heights"
    phrase = "contact gives way, {other} ({all})"
    parameters = (
        ParameterSpec("timeconst", "s", nonnegative=True, is_in_model=True),
        ParameterSpec("dampratio", "1", nonnegative=True, is_in_model=True),
    )

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term where the robot touched the ground.

        Not where solref is negative, that is, stiffness and damping: that form has no
        nominal time constant.
        """
        place = self.propose_place(robot)
        if place is None:
            return []
        sides = _find_deciding_sides(robot.model, place)
        if any((robot.model.geom_solref[g] <= 0).any() for g in sides):
            return []
        time, ratio = map(float, _mean_solref(robot.model, sides))
        least = 2 * robot.timestep  # MuJoCo computes no shorter one
        most = max(0.3, 2 * time), max(5.0, 2 * ratio)
        parameters = (
            self.bound("timeconst", (least, most[0]), scale=0.005, nominal=time),
            self.bound("dampratio", (0.02, most[1]), scale=0.1, nominal=ratio),
        )
        shares = ((1.0, 0.3), (0.5, 0.1), (2.5, 0.5), (3.0, 1.0))
        starts = tuple((max(a * time, least), b * ratio) for a, b in shares)
        return [self.make_term("world", place, Proposal(parameters, starts))]

    def edit_model(self, model: "MjModel", place: GeomsPlace, values: Floats) -> None:
        sides = _find_deciding_sides(model, place)
        ratio = values / _mean_solref(model, sides)
        for geoms in sides:
            model.geom_solref[geoms] *= ratio


def _mean_solref(model: "MjModel", sides: Sequence[np.ndarray]) -> Floats:
    """Time constant [s] and damping ratio [1] (2) of a contact, mean over geoms."""
    return np.mean([model.geom_solref[g].mean(axis=0) for g in sides], axis=0)
