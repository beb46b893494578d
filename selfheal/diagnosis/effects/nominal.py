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
Scale = Callable[["MjModel", Any, float], None]
# units of a hinge's values; `convert_unit` gives those of a slide's
HINGE_UNITS = {"damping": "N m s/rad", "armature": "kg m^2", "frictionloss": "N m",
               "stiffness": "N m/rad"}  # fmt: skip
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
    """The term of a nominal value.

    Args:
        scale: `scale(model, place, factor)` multiplies it in a compiled model.
        target: its name ("joint:knee/damping").
        at: what `scale` acts on.
    """
    reach = relative_bound(target)
    parameter = Parameter("factor", "1", 1.0, 1 - reach, 1 + reach, reach / 3)
    effect = NominalParameter(scale, value, unit)
    return Term(effect, (target,), (at,), (parameter,), ((1.0,),))


# ---- multiplying a value in a compiled model, at a place, by a factor


def _scale_dof_field(name: str, count: int = 1) -> Scale:
    """Multiplies a field of `count` degrees of freedom from the joint's first on."""

    def scale(model: "MjModel", place: JointPlace, factor: float) -> None:
        getattr(model, name)[place.dof : place.dof + count] *= factor

    return scale


def _scale_actuator_fields(*columns: tuple[str, int]) -> Scale:
    """Multiplies columns of an actuator's fields ("gainprm", 0)."""

    def scale(model: "MjModel", place: ActuatorPlace, factor: float) -> None:
        for name, column in columns:
            getattr(model, f"actuator_{name}")[place.actuator, column] *= factor

    return scale


GAIN, STIFFNESS, DAMPING = ("gainprm", 0), ("biasprm", 1), ("biasprm", 2)


def _scale_stiffness(model: "MjModel", place: JointPlace, factor: float) -> None:
    model.jnt_stiffness[place.joint] *= factor


def _scale_mass(model: "MjModel", place: BodyPlace, factor: float) -> None:
    model.body_mass[place.body] *= factor
    model.body_inertia[place.body] *= factor


def _scale_inertia(model: "MjModel", place: BodyPlace, factor: float) -> None:
    model.body_inertia[place.body] *= factor


def _scale_second_moment(axis: int) -> Scale:
    """Multiplies a body's second moment along a principal axis, by its number."""

    def scale(model: "MjModel", place: BodyPlace, factor: float) -> None:
        inertia = model.body_inertia[place.body]
        more = (factor - 1) * _second_moments(inertia)[axis]
        inertia += more * (np.arange(3) != axis)

    return scale


def _second_moments(inertia: Floats) -> Floats:
    """Second moments of mass (3) [kg m^2] along the principal axes.

    Args:
        inertia: (3) moments about the same axes [kg m^2].
    """
    return inertia.sum() / 2 - inertia


def _scale_length(axis: Floats) -> Scale:
    """Stretches a body along a unit vector (3) in its frame."""

    def scale(model: "MjModel", place: BodyPlace, factor: float) -> None:
        stretch_body(model, place.body, axis, factor)

    return scale


def _scale_gear(model: "MjModel", place: ActuatorPlace, factor: float) -> None:
    model.actuator_gear[place.output] *= factor


def _scale_friction(model: "MjModel", place: GeomsPlace, factor: float) -> None:
    for geom in place.geoms:
        model.geom_friction[geom, 0] *= factor


# ---- which values a model states


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
    for body in robot.bodies:
        name, place = f"body:{body.name}", BodyPlace(body=body.id)
        yield _make_term(_scale_mass, f"{name}/mass", body.mass, "kg", place)
        yield from _inertia_terms(robot.model, body)
        for word, axis, length in _list_lengths(robot, body):
            yield _make_term(_scale_length(axis), f"{name}/{word}", length, "m", place)


def _inertia_terms(model: "MjModel", body: MovingBody) -> Iterator[Term]:
    """One factor; of a body that tumbles freely, one along each principal axis.

    Its motion shows only the ratios of its inertias. Inertias made of second moments
    of mass are physically possible for any second moments.
    """
    name, inertia = f"body:{body.name}", model.body_inertia[body.id]
    place = BodyPlace(body=body.id)
    if not (model.jnt_type[model.jnt_bodyid == body.id] <= BALL_JOINT).any():
        largest, target = float(inertia.max()), f"{name}/inertia"
        yield _make_term(_scale_inertia, target, largest, "kg m^2", place)
        return
    moments = _second_moments(inertia)
    for axis, (word, value) in enumerate(zip(MOMENTS, moments, strict=True)):
        if value > MIN_SECOND_MOMENT_SHARE * moments.max():
            scale, target = _scale_second_moment(axis), f"{name}/{word}"
            yield _make_term(scale, target, float(value), "kg m^2", place)


def _list_lengths(
    robot: RobotSummary, body: MovingBody
) -> Iterator[tuple[str, Floats, float]]:
    """Names, axes (3) and values [m] of the lengths that a body has.

    A link has one. A box has three, that matter where something touches it or hangs on
    it.
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
    """Damping, armature, dry friction and stiffness of hinges, slides and balls."""
    for j in np.flatnonzero(model.jnt_type > BALL_JOINT).tolist():
        unit = "m" if model.jnt_type[j] == SLIDE else "rad"
        fields = {name: convert_unit(u, unit) for name, u in HINGE_UNITS.items()}
        yield from _state_joint(model, j, fields, 1)
    for j in np.flatnonzero(model.jnt_type == BALL_JOINT).tolist():
        fields = {k: u for k, u in HINGE_UNITS.items() if k != "frictionloss"}
        yield from _state_joint(model, j, fields, 3)


def _state_joint(
    model: "MjModel", joint: int, fields: Mapping[str, str], count: int
) -> Iterator[Term]:
    """What the model states of a joint: the same along its axes, so many of them."""
    target, place = (
        f"joint:{model.joint(joint).name or joint}",
        joint_place(model, joint),
    )
    for field, unit in fields.items():
        if field == "stiffness":
            scale: Scale = _scale_stiffness
            value = model.jnt_stiffness[joint]
        else:
            scale = _scale_dof_field(f"dof_{field}", count)
            value = getattr(model, f"dof_{field}")[place.dof]
        if value:
            yield _make_term(scale, f"{target}/{field}", float(value), unit, place)


def _actuator_terms(robot: RobotSummary) -> Iterator[Term]:
    """Gains, gears and time constants of actuators whose law MJCF states by these."""
    for a in robot.actuators:
        if has_affine_force(robot.model, a.id):
            yield from _affine_terms(robot.model, a)
        elif is_pid(robot.model, a.id):
            yield from _pid_terms(robot.model, a)


def _pid_terms(model: "MjModel", a: Actuator) -> Iterator[Term]:
    """What the model states of one <pid>: its gains."""
    place, stiffness = actuator_place(model, a.id), f"{a.force}/{a.unit}"
    _, kp, kv = -model.actuator_biasprm[a.id, :3]
    for field, column, value, unit in (
        ("kp", STIFFNESS, kp, stiffness),
        ("kv", DAMPING, kv, f"{a.force} s/{a.unit}"),
        ("ki", GAIN, model.actuator_gainprm[a.id, 0], f"{stiffness}/s"),
    ):
        if value:
            scale, target = _scale_actuator_fields(column), f"actuator:{a.name}/{field}"
            yield _make_term(scale, target, float(value), unit, place)


def _affine_terms(model: "MjModel", a: Actuator) -> Iterator[Term]:
    """What the model states of one actuator: kp or gain, gear, kv, time constant."""
    name, place = f"actuator:{a.name}", actuator_place(model, a.id)

    def state(field: str, value: float, unit: str, *columns: tuple[str, int]) -> Term:
        scale = _scale_actuator_fields(*columns) if columns else _scale_gear
        return _make_term(scale, f"{name}/{field}", float(value), unit, place)

    by_length, by_command = f"{a.force}/{a.unit}", f"{a.force}/ctrl"
    gain, bias = model.actuator_gainprm[a.id, 0], model.actuator_biasprm[a.id]
    speed = bool(gain and bias[2] == -gain and not bias[1])  # <velocity>: one kv
    if not speed and (gain not in (0.0, 1.0) or bias[1]):
        if a.servo:
            yield state("kp", gain, by_length, GAIN, STIFFNESS)
        else:
            yield state("gain", gain, by_command, GAIN)
            if bias[1]:  # of another length than the joint's
                yield state("bias", -bias[1], by_length, STIFFNESS)
    gear = float(model.actuator_gear[place.output, 0])
    is_plain_motor = gain == 1.0 and not bias.any() and a.dof >= 0
    if is_plain_motor and abs(gear) == 1.0:  # its strength, which a gear would say
        yield state("gain", 1.0, by_command, GAIN)
    elif is_plain_motor and gear:
        yield state("gear", gear, "1")
    if bias[2]:
        columns = (GAIN, DAMPING) if speed else (DAMPING,)
        yield state("kv", -bias[2], f"{a.force} s/{a.unit}", *columns)
    time = float(model.actuator_dynprm[a.id, 0])
    if model.actuator_dyntype[a.id] in DYN_FILTER_TYPES and time:
        yield state("timeconst", time, "s", ("dynprm", 0))


def _geom_terms(robot: RobotSummary) -> Iterator[Term]:
    """Sliding friction where the model states it; MuJoCo's default is no statement."""
    model = robot.model
    if not robot.has_contact:
        return
    is_stated = np.abs(model.geom_friction - DEFAULT_FRICTION).max(axis=1) > 1e-12
    solid = (model.geom_contype | model.geom_conaffinity) > 0
    for g in np.flatnonzero(is_stated & solid).tolist():
        target = f"geom:{model.geom(g).name or g}/friction"
        value, place = float(model.geom_friction[g, 0]), GeomsPlace(geoms=(g,))
        yield _make_term(_scale_friction, target, value, "1", place)
