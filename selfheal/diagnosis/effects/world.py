"""The robot's surroundings."""

from copy import copy
from dataclasses import replace

import numpy as np

from ..data.robot_summary import RobotSummary
from .base import Effect, Floats, Parameter, Term

STEEPEST = 0.5  # [rad] of a slope that nobody saw; chosen
FLAT = 1e-6  # of the largest torque of weight: no torque at all
POSES = 16  # that tell it; chosen
IN_LINE = 0.01  # [rad] by which a flat robot's slope may be off its plane; chosen


class WorldEffect(Effect):
    """What all of them share: one place, the world."""

    group = "world"

    def make_term(self, parameters, starts) -> Term:
        """The term at the world."""
        return Term(self, ("world",), ({},), parameters, starts)


class Slope(WorldEffect):
    name = "slope"
    description = "What is taken for horizontal is tilted."
    equation = "gravity turned by tilt towards the downhill direction azimuth"
    source = "MuJoCo option/gravity"
    separate_by = "turn the robot by 180 degrees: a slope turns with the room"

    def propose_terms(self, robot):
        if not np.linalg.norm(robot.model.opt.gravity):
            return []
        tilt = Parameter("tilt", "rad", 0.0, 0.0, STEEPEST, 0.03)
        plane = _find_plane_azimuths(robot.model)
        if plane is None:
            azimuth = Parameter("azimuth", "rad", 0.0, -10.0, 10.0, 0.5)
            turns = np.deg2rad((0, 90, 180, -90))
            starts = tuple((0.05, float(a)) for a in turns)
            return [self.make_term((tilt, azimuth), starts)]
        # across its plane a slope would only seem to weaken the gravity
        found = []
        for side, a in enumerate(plane):
            low, high = a - IN_LINE, a + IN_LINE
            azimuth = Parameter("azimuth", "rad", a, low, high, IN_LINE)
            term = self.make_term((tilt, azimuth), ((0.05, a),))
            found.append(replace(term, finding_fields={"side": 1 - 2 * side}))
        return found

    def is_consistent(self, values):
        return bool(values[0] < 0.99 * STEEPEST)  # else it stands for another thing

    def edit_model(self, model, place, values):
        tilt, azimuth = values
        size = np.linalg.norm(model.opt.gravity)
        up = -model.opt.gravity / size
        down = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        down -= (down @ up) * up
        down /= max(np.linalg.norm(down), 1e-9)
        model.opt.gravity[:] = size * (np.sin(tilt) * down - np.cos(tilt) * up)


def _find_plane_azimuths(model) -> tuple[float, ...] | None:
    """Azimuths [rad] of the slopes that a robot feels; None: of all.

    The two of its plane where its parts move in one, none where they move upright.
    """
    import mujoco

    other, data, rng = copy(model), mujoco.MjData(model), np.random.default_rng(0)
    if np.abs(model.opt.gravity[:2]).any():
        return None
    felt = np.zeros((3, POSES, model.nv))
    for pose in range(POSES):
        data.qpos[:] = model.qpos0 + rng.normal(size=model.nq)
        mujoco.mj_normalizeQuat(model, data.qpos)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for torque, other.opt.gravity[:] in zip(felt, np.eye(3), strict=True):
            mujoco.mj_rne(other, data, 0, torque[pose])
    across = felt[:2].reshape(2, -1)
    turns, sizes, _ = np.linalg.svd(across, full_matrices=False)
    flat = sizes < FLAT * np.linalg.norm(felt)
    if not flat[1]:
        return None
    along = float(np.arctan2(turns[1, 0], turns[0, 0]))
    along = (along + np.pi / 2) % np.pi - np.pi / 2  # the one nearer to +x
    return () if flat[0] else (along, along + np.pi)


class FluidDrag(WorldEffect):
    name = "fluid_drag"
    rarity = 1
    description = "Air or water resists the parts that move through it."
    equation = "MuJoCo's inertia-box fluid model, of density or viscosity"
    source = "MuJoCo option/density, viscosity"
    separate_by = "change the area of a moving part"
    regime = "fast"

    def propose_terms(self, robot):
        now = robot.model.opt
        return [
            self._make_term("density", "kg/m^3", now.density, 1e4, (1.2, 50.0, 500.0)),
            self._make_term(
                "viscosity", "Pa s", now.viscosity, 100.0, (0.01, 0.3, 3.0)
            ),
        ]

    def _make_term(self, name: str, unit: str, now: float, high: float, starts) -> Term:
        parameter = Parameter(name, unit, float(now), 0.0, high, starts[1])
        begin = tuple((s,) for s in starts)
        return Term(self, ("world",), ({"field": name},), (parameter,), begin)

    def edit_model(self, model, place, values):
        setattr(model.opt, place["field"], values[0])


class Wind(WorldEffect):
    name = "wind"
    rarity = 1
    description = "The air moves."
    equation = "drag of the velocity relative to (vx, vy, vz)"
    source = "MuJoCo option/wind"
    separate_by = "turn the robot by 180 degrees"

    def propose_terms(self, robot):
        if not (robot.model.opt.density or robot.model.opt.viscosity):
            return []
        speed, wind = _terminal_speed(robot), robot.model.opt.wind
        most = max(50.0, speed)
        axes = tuple(
            Parameter("v" + x, "m/s", float(wind[i]), -most, most, 0.1 * speed)
            for i, x in enumerate("xyz")
        )
        starts = np.kron([[0.05], [0.5]], speed * np.eye(3)[:2])
        return [self.make_term(axes, tuple(map(tuple, starts.tolist())))]

    def edit_model(self, model, place, values):
        model.opt.wind[:] = values


def _terminal_speed(robot: RobotSummary) -> float:
    """The least speed [m/s] at which the medium would carry a body's weight, or so."""
    medium, g = robot.model.opt, 9.81
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
    """What happens where something touches the ground.

    MuJoCo takes the larger friction of two geoms and the mean of their solref, or both
    of the one with the higher priority. Where both count, both geoms' are scaled by one
    factor, and so is the contact's: what the model states of each of them is kept.
    """

    def find_place(self, robot: RobotSummary) -> dict | None:
        """The place: the world's geoms that touch anything; None where nothing can."""
        return find_ground_geoms(robot.model) if robot.has_contact else None


def find_ground_geoms(model) -> dict[str, tuple[int, ...]] | None:
    """The world's geoms that something which moves can touch; None without any."""
    fixed = np.flatnonzero(model.body_weldid[model.geom_bodyid] == 0)
    touch = model.geom_contype[fixed] | model.geom_conaffinity[fixed]
    place = {"geoms": tuple(int(g) for g in fixed[touch > 0])}
    return place if _find_contact_sides(model, place)[1].size else None


def _find_contact_sides(model, place) -> tuple[np.ndarray, np.ndarray]:
    """The ground's geoms, and those of bodies that move which it can touch."""
    a = np.array(place["geoms"], int)
    b = np.flatnonzero(model.body_weldid[model.geom_bodyid] != 0)
    meets = model.geom_contype[a][:, None] & model.geom_conaffinity[b]
    meets |= model.geom_conaffinity[a][:, None] & model.geom_contype[b]
    return a, b[meets.any(axis=0)]


def _find_deciding_sides(model, place) -> tuple[np.ndarray, ...]:
    """Of both sides, or of the one with the higher priority: what contacts go by."""
    ground, moving = sides = _find_contact_sides(model, place)
    ours, theirs = (model.geom_priority[g] for g in sides)
    if ours.min() > theirs.max():
        return (ground,)
    return (moving,) if theirs.min() > ours.max() else sides


class GroundFriction(GroundEffect):
    name = "ground_friction"
    description = "The ground is more slippery, or rougher, than stated."
    equation = "|f_tangential| <= friction f_normal, where the contact is roughest"
    source = "MuJoCo geom/friction"
    separate_by = "push the resting robot until it slides"
    regime = "contact"

    def propose_terms(self, robot):
        place = self.find_place(robot)
        if place is None:
            return []
        sides = _find_deciding_sides(robot.model, place)
        now = _largest_friction(robot.model, sides)
        parameter = Parameter("friction", "1", now, 0.0, max(5.0, 2 * now), 0.2)
        starts = ((0.1,), (0.3,), (0.6,), (1.5,))
        return [Term(self, ("world",), (place,), (parameter,), starts)]

    def edit_model(self, model, place, values):
        sides = _find_deciding_sides(model, place)
        now = _largest_friction(model, sides)
        for geoms in sides:
            if now:
                model.geom_friction[geoms, 0] *= values[0] / now
            else:
                model.geom_friction[geoms, 0] = values[0]


def _largest_friction(model, sides) -> float:
    """Of the roughest contact."""
    return float(max(model.geom_friction[g, 0].max() for g in sides))


class GroundCompliance(GroundEffect):
    name = "ground_compliance"
    description = "The ground gives way, or bounces, otherwise than stated."
    equation = "contact as a spring and damper of timeconst and dampratio, on average"
    source = "MuJoCo geom/solref"
    separate_by = "drop a part from two heights"
    regime = "contact"

    def propose_terms(self, robot):
        """Where solref is a time and a ratio; its other form has no absent value."""
        place = self.find_place(robot)
        if place is None:
            return []
        sides = _find_deciding_sides(robot.model, place)
        if any((robot.model.geom_solref[g] <= 0).any() for g in sides):
            return []
        time, ratio = map(float, _mean_solref(robot.model, sides))
        least = 2 * robot.timestep  # MuJoCo computes no shorter one
        parameters = (
            Parameter("timeconst", "s", time, least, max(0.3, 2 * time), 0.005),
            Parameter("dampratio", "1", ratio, 0.02, max(5.0, 2 * ratio), 0.1),
        )
        shares = ((1.0, 0.3), (0.5, 0.1), (2.5, 0.5), (3.0, 1.0))
        starts = tuple((max(a * time, least), b * ratio) for a, b in shares)
        return [Term(self, ("world",), (place,), parameters, starts)]

    def edit_model(self, model, place, values):
        sides = _find_deciding_sides(model, place)
        ratio = values / _mean_solref(model, sides)
        for geoms in sides:
            model.geom_solref[geoms] *= ratio


def _mean_solref(model, sides) -> Floats:
    """Time constant [s] and damping ratio [1] of a contact, on average."""
    return np.mean([model.geom_solref[g].mean(axis=0) for g in sides], axis=0)
