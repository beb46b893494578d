"""The values that a model states, as terms that a fit may change (contract section 2).

Each value is fitted as a factor near one, within bounds that a careful user would
grant. Values that are zero are not fitted.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...recording.actuator_laws import has_affine_force, is_pid
from ...recording.data import Floats
from ..data.robot_summary import (
    Actuator,
    MovingBody,
    RobotSummary,
    find_link_axis,
    measure_extent,
)
from .base import Effect, Term
from .declaration import Parameter, convert_unit
from .inertia import stretch_body
from .places import (
    SLIDE,
    ActuatorPlace,
    BodyPlace,
    GeomsPlace,
    JointPlace,
    Place,
    actuator_place,
    joint_place,
)
from .protocols import ModelEdit

if TYPE_CHECKING:
    from mujoco import MjModel

# multiplies a value of a compiled model, at a place, by a factor
Scale = Callable[["MjModel", Place, float], None]
# units of a hinge's values; `convert_unit` gives those of a slide's
HINGE_UNITS = {
    "damping": "N m s/rad",
    "armature": "kg m^2",
    "frictionloss": "N m",
    "stiffness": "N m/rad",
}
# the contract's bounds, section 2
MASS_BOUND, LENGTH_BOUND, OTHER_BOUND = 0.15, 0.03, 0.30
SIDES = ("size_x", "size_y", "size_z")
MOMENTS = ("second_moment_x", "second_moment_y", "second_moment_z")
# share of the largest second moment below which one changes no motion; chosen
MIN_SECOND_MOMENT_SHARE = 1e-3
# of a body's extent, the distance to its end that makes it a link; chosen
MIN_LINK_SHARE = 0.3
# share of the bounds from which on an interval leaves a value open; chosen
OPEN_INTERVAL_SHARE = 0.9
BALL_JOINT = 1  # mjtJoint; a free one is 0, slides and hinges come after it
DYN_FILTER_TYPES = (2, 3)  # mjtDyn: filter, filterexact
DEFAULT_FRICTION = (1.0, 0.005, 0.0001)  # MuJoCo's geom/friction


def relative_bound(parameter: str) -> float:
    """How far a nominal value ("joint:knee/damping") may move, relative to itself."""
    field = parameter.rpartition("/")[2]
    lengths = dict.fromkeys(("length", *SIDES), LENGTH_BOUND)
    masses = dict.fromkeys(("mass", "inertia", *MOMENTS), MASS_BOUND)
    return {**masses, **lengths}.get(field, OTHER_BOUND)


def is_unidentified(entry: Mapping[str, Any]) -> bool:
    """Whether a re-fitted value's interval is as wide as its bounds, or unknown.

    Args:
        entry: of diagnosis.json's "refit", with "given", "low" and "high".
    """
    given, low, high = (entry[key] for key in ("given", "low", "high"))
    if None in (given, low, high):
        return True
    bound = relative_bound(entry["parameter"])
    return high - low > OPEN_INTERVAL_SHARE * 2 * bound * abs(given)


class NominalParameter(Effect, ModelEdit[Place]):
    """A value that the model states, times a factor near one.

    Attributes:
        value: as the model states it.
        unit: of the value.
    """

    name = "stated"
    group = "stated"

    def __init__(self, scale: Scale, value: float, unit: str) -> None:
        """`scale(model, place, factor)` multiplies the value in a compiled model."""
        self.scale, self.value, self.unit = scale, value, unit

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """No terms: `build_nominal_terms` makes them, and no search proposes them."""
        return []

    def edit_model(self, model: "MjModel", place: Place, values: Floats) -> None:
        """Multiply the value in a compiled model.

        Args:
            values: (1) factor [1].
        """
        self.scale(model, place, values[0])


def _make_term(scale: Scale, target: str, value: float, unit: str, at: Place) -> Term:
    """The term of a nominal value, named "joint:knee/damping", at a place."""
    reach = relative_bound(target)
    parameter = Parameter("factor", "1", 1.0, 1 - reach, 1 + reach, reach / 3)
    effect = NominalParameter(scale, float(value), unit)
    return Term(effect, (target,), (at,), (parameter,), ((1.0,),))


def _scale_fields(index: str, *fields: tuple[str, *tuple[int, ...]]) -> Scale:
    """Multiplies fields of a compiled model at an element.

    Args:
        index: name of the place's attribute that is the fields' first index.
        fields: each a name, and a column where it is not all that changes.
    """

    def scale(model: "MjModel", place: Place, factor: float) -> None:
        for name, *column in fields:
            getattr(model, name)[getattr(place, index), *column] *= factor

    return scale


def _scale_actuator(*columns: tuple[str, int]) -> Scale:
    """Multiplies columns of an actuator's fields ("gainprm", 0)."""
    return _scale_fields("actuator", *((f"actuator_{x}", k) for x, k in columns))


GAIN, STIFFNESS, DAMPING = ("gainprm", 0), ("biasprm", 1), ("biasprm", 2)


def _scale_degrees_of_freedom(field: str, count: int) -> Scale:
    """Multiplies a field of a joint's degrees of freedom, so many of them."""

    def scale(model: "MjModel", place: Place, factor: float) -> None:
        assert isinstance(place, JointPlace)  # by `_joint_terms`
        getattr(model, field)[place.dof : place.dof + count] *= factor

    return scale


def _scale_second_moment(body: int, axis: int) -> Scale:
    """Multiplies a body's second moment along a principal axis, by its number."""

    def scale(model: "MjModel", place: Place, factor: float) -> None:
        inertia = model.body_inertia[body]
        more = (factor - 1) * _second_moments(inertia)[axis]
        inertia += more * (np.arange(3) != axis)

    return scale


def _second_moments(inertia: Floats) -> Floats:
    """Second moments of mass (3) [kg m^2] along the axes of inertia (3) [kg m^2]."""
    return inertia.sum() / 2 - inertia


def _scale_length(body: int, axis: Floats) -> Scale:
    """Stretches a body along a unit vector (3) in its frame."""
    return lambda model, place, factor: stretch_body(model, body, axis, factor)


def build_nominal_terms(robot: RobotSummary) -> list[Term]:
    """One term for each value that the model states and that is not zero."""
    return [
        *_body_terms(robot),
        *_joint_terms(robot.model),
        *_actuator_terms(robot),
        *_geom_terms(robot),
    ]


def _body_terms(robot: RobotSummary) -> Iterator[Term]:
    """Masses, inertias and lengths of the bodies that move."""
    scale_mass = _scale_fields("body", ("body_mass",), ("body_inertia",))
    for body in robot.bodies:
        name, place = f"body:{body.name}", BodyPlace(body=body.id)
        yield _make_term(scale_mass, f"{name}/mass", body.mass, "kg", place)
        yield from _inertia_terms(robot.model, body)
        for word, axis, length in _list_lengths(robot, body):
            scale = _scale_length(body.id, axis)
            yield _make_term(scale, f"{name}/{word}", length, "m", place)


def _inertia_terms(model: "MjModel", body: MovingBody) -> Iterator[Term]:
    """One factor; of a body that tumbles freely, one along each principal axis.

    Its motion shows only the ratios of its inertias. Inertias made of second moments
    of mass are physically possible for any second moments.
    """
    name, inertia = f"body:{body.name}", model.body_inertia[body.id]
    place = BodyPlace(body=body.id)
    if not (model.jnt_type[model.jnt_bodyid == body.id] <= BALL_JOINT).any():
        scale, target = _scale_fields("body", ("body_inertia",)), f"{name}/inertia"
        yield _make_term(scale, target, inertia.max(), "kg m^2", place)
        return
    moments = _second_moments(inertia)
    for axis, (word, value) in enumerate(zip(MOMENTS, moments, strict=True)):
        if value > MIN_SECOND_MOMENT_SHARE * moments.max():
            scale = _scale_second_moment(body.id, axis)
            yield _make_term(scale, f"{name}/{word}", value, "kg m^2", place)


def _list_lengths(
    robot: RobotSummary, body: MovingBody
) -> Iterator[tuple[str, Floats, float]]:
    """Names, axes (3) and values [m] of the lengths that a body has.

    A link has one. A box has three, that matter where something touches it or is
    attached to it.
    """
    if body.length > MIN_LINK_SHARE * body.size:
        axis, length = find_link_axis(robot.model, body.id)
        yield "length", axis, length
    elif robot.has_contact or body.id in robot.model.body_parentid:
        sides = measure_extent(robot.model, body.id)
        for word, axis, side in zip(SIDES, np.eye(3), sides, strict=True):
            if side > 0:
                yield word, axis, float(side)


def _joint_terms(model: "MjModel") -> Iterator[Term]:
    """Damping, armature, dry friction and stiffness of hinges and slides, then balls.

    Along a ball's axes they are the same.
    """
    joints = np.flatnonzero(model.jnt_type >= BALL_JOINT).tolist()
    for j in sorted(joints, key=lambda j: bool(model.jnt_type[j] == BALL_JOINT)):
        is_ball, place = model.jnt_type[j] == BALL_JOINT, joint_place(model, j)
        for field, hinge_unit in HINGE_UNITS.items():
            if field == "stiffness":
                scale = _scale_fields("joint", ("jnt_stiffness",))
                value = model.jnt_stiffness[j]
            else:
                scale = _scale_degrees_of_freedom(f"dof_{field}", 3 if is_ball else 1)
                value = getattr(model, f"dof_{field}")[place.dof]
            if value and not (is_ball and field == "frictionloss"):
                target = f"joint:{model.joint(j).name or j}/{field}"
                unit = "m" if model.jnt_type[j] == SLIDE else "rad"
                unit = convert_unit(hinge_unit, unit)
                yield _make_term(scale, target, value, unit, place)


def _actuator_terms(robot: RobotSummary) -> Iterator[Term]:
    """Gains, gears and time constants of actuators whose law MJCF states by these."""
    for a in robot.actuators:
        place = actuator_place(robot.model, a.id)
        if is_pid(robot.model, a.id):
            values = _list_pid_values(robot.model, a)
        else:
            values = _list_affine_values(robot.model, a, place)
        for field, value, unit, scale in values:
            yield _make_term(scale, f"actuator:{a.name}/{field}", value, unit, place)


def _list_pid_values(
    model: "MjModel", a: Actuator
) -> Iterator[tuple[str, float, str, Scale]]:
    """Gains of a <pid>: the name, value, unit and scale of each."""
    stiffness, (_, kp, kv) = f"{a.force}/{a.unit}", -model.actuator_biasprm[a.id, :3]
    for field, column, value, unit in (
        ("kp", STIFFNESS, kp, stiffness),
        ("kv", DAMPING, kv, f"{a.force} s/{a.unit}"),
        ("ki", GAIN, model.actuator_gainprm[a.id, 0], f"{stiffness}/s"),
    ):
        if value:
            yield field, value, unit, _scale_actuator(column)


def _list_affine_values(
    model: "MjModel", a: Actuator, place: ActuatorPlace
) -> Iterator[tuple[str, float, str, Scale]]:
    """What states an affine law: the name, value, unit and scale of each; else none."""
    if not has_affine_force(model, a.id):
        return
    by_length, by_command = f"{a.force}/{a.unit}", f"{a.force}/ctrl"
    gain, bias = model.actuator_gainprm[a.id, 0], model.actuator_biasprm[a.id]
    speed = bool(gain and bias[2] == -gain and not bias[1])  # <velocity>: one kv
    if not speed and (gain not in (0.0, 1.0) or bias[1]):
        if a.servo:
            yield "kp", gain, by_length, _scale_actuator(GAIN, STIFFNESS)
        else:
            yield "gain", gain, by_command, _scale_actuator(GAIN)
            if bias[1]:  # of another length than the joint's
                yield "bias", -bias[1], by_length, _scale_actuator(STIFFNESS)
    gear = float(model.actuator_gear[place.output, 0])
    is_plain_motor = gain == 1.0 and not bias.any() and a.dof >= 0
    if is_plain_motor and abs(gear) == 1.0:  # its strength, which a gear would say
        yield "gain", 1.0, by_command, _scale_actuator(GAIN)
    elif is_plain_motor and gear:
        yield "gear", gear, "1", _scale_fields("output", ("actuator_gear",))
    if bias[2]:
        columns = (GAIN, DAMPING) if speed else (DAMPING,)
        yield "kv", -bias[2], f"{a.force} s/{a.unit}", _scale_actuator(*columns)
    time = float(model.actuator_dynprm[a.id, 0])
    if model.actuator_dyntype[a.id] in DYN_FILTER_TYPES and time:
        yield "timeconst", time, "s", _scale_actuator(("dynprm", 0))


def _geom_terms(robot: RobotSummary) -> Iterator[Term]:
    """Sliding friction where the model states it; MuJoCo's default is no statement."""
    model, scale = robot.model, _scale_fields("geoms", ("geom_friction", 0))
    if not robot.has_contact:
        return
    is_stated = np.abs(model.geom_friction - DEFAULT_FRICTION).max(axis=1) > 1e-12
    solid = (model.geom_contype | model.geom_conaffinity) > 0
    for g in np.flatnonzero(is_stated & solid).tolist():
        target, place = f"geom:{model.geom(g).name or g}", GeomsPlace(geoms=(g,))
        value = model.geom_friction[g, 0]
        yield _make_term(scale, f"{target}/friction", value, "1", place)
