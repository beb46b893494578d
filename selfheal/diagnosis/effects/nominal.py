"""The values that a model states, as terms that a fit may change (contract section 2).

Each value is fitted as a factor near one, within bounds that a careful user would
grant. Values that are zero are not fitted.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from ...recording import find_output
from ...recording.actuator_laws import has_affine_force, is_pid
from ...recording.data import Floats
from ..data.robot_summary import (
    Actuator,
    Joint,
    MovingBody,
    RobotSummary,
    find_link_axis,
    measure_extent,
)
from .base import Effect, Term
from .declaration import Parameter
from .inertia import stretch_body
from .places import Place

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
BALL_JOINT = 1  # mjtJoint; a free one is 0
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


class NominalParameter(Effect):
    """A value that the model states, times a factor near one."""

    name = "stated"
    group = "stated"

    def __init__(self, scale: Callable) -> None:
        """`scale(model, place, factor)` multiplies the value in a compiled model."""
        self.scale = scale

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """No terms: `build_nominal_terms` makes them, and no search proposes them."""
        return []

    def edit_model(self, model, place, values: Floats) -> None:
        """Multiply the value in a compiled model.

        Args:
            model: compiled, to be changed.
            place: of the value.
            values: (1) factor [1].
        """
        self.scale(model, place, values[0])


def _make_term(
    scale: Callable, target: str, reach: float, value: float, unit: str, place: Place
) -> Term:
    """The term of a nominal value.

    Args:
        scale: `scale(model, place, factor)` multiplies it in a compiled model.
        target: its name ("joint:knee/damping").
        reach: how far the factor may be from 1.
        value: as the model states it.
        unit: of the value.
        place: indices that `scale` needs.
    """
    parameter = Parameter("factor", "1", 1.0, 1 - reach, 1 + reach, reach / 3)
    fields = {"value": value, "unit": unit}
    return Term(
        NominalParameter(scale), (target,), (place,), (parameter,), ((1.0,),), fields
    )


# ---- multiplying a value in a compiled model, at a place, by a factor


def _scale_dof_field(name: str, count: int = 1) -> Callable:
    """Multiplies a field of `count` degrees of freedom from the place's on."""

    def scale(model, place, factor):
        getattr(model, name)[place["dof"] : place["dof"] + count] *= factor

    return scale


def _scale_stiffness(model, place, factor):
    model.jnt_stiffness[place["joint"]] *= factor


def _scale_mass(model, place, factor):
    model.body_mass[place["body"]] *= factor
    model.body_inertia[place["body"]] *= factor


def _scale_inertia(model, place, factor):
    model.body_inertia[place["body"]] *= factor


def _scale_second_moment(model, place, factor):
    inertia, axis = model.body_inertia[place["body"]], place["principal_axis"]
    more = (factor - 1) * _second_moments(inertia)[axis]
    inertia += more * (np.arange(3) != axis)


def _second_moments(inertia: Floats) -> Floats:
    """Second moments of mass (3) [kg m^2] along the principal axes.

    Args:
        inertia: (3) moments about the same axes [kg m^2].
    """
    return inertia.sum() / 2 - inertia


def _scale_length(model, place, factor):
    stretch_body(model, place["body"], place["axis"], factor)


def _scale_gain(model, place, factor):
    model.actuator_gainprm[place["actuator"], 0] *= factor


def _scale_bias(model, place, factor):
    model.actuator_biasprm[place["actuator"], 1] *= factor


def _scale_kp(model, place, factor):
    _scale_gain(model, place, factor)
    _scale_bias(model, place, factor)


def _scale_gear(model, place, factor):
    model.actuator_gear[find_output(model, place["actuator"])] *= factor


def _scale_kv(model, place, factor):
    model.actuator_biasprm[place["actuator"], 2] *= factor


def _scale_speed_gain(model, place, factor):
    model.actuator_gainprm[place["actuator"], 0] *= factor
    model.actuator_biasprm[place["actuator"], 2] *= factor


def _scale_time_constant(model, place, factor):
    model.actuator_dynprm[place["actuator"], 0] *= factor


def _scale_friction(model, place, factor):
    model.geom_friction[place["geom"], 0] *= factor


# ---- which values a model states


def build_nominal_terms(robot: RobotSummary) -> list[Term]:
    """One term for each value that the model states and that is not zero."""
    return [
        *_body_terms(robot),
        *_joint_terms(robot),
        *_actuator_terms(robot),
        *_geom_terms(robot),
    ]


def _body_terms(robot: RobotSummary) -> list[Term]:
    """Masses, inertias and lengths of the bodies that move."""
    found = []
    for body in robot.bodies:
        name, place = f"body:{body.name}", Place(body=body.id)
        found.append(
            _make_term(_scale_mass, f"{name}/mass", MASS_BOUND, body.mass, "kg", place)
        )
        found += _inertia_terms(robot.model, body)
        for word, axis, length in _list_lengths(robot, body):
            place = Place(body=body.id, axis=axis)
            target = f"{name}/{word}"
            found.append(
                _make_term(_scale_length, target, LENGTH_BOUND, length, "m", place)
            )
    return found


def _inertia_terms(model, body: MovingBody) -> list[Term]:
    """One factor; of a body that tumbles freely, one along each principal axis.

    Its motion shows only the ratios of its inertias. Inertias made of second moments
    of mass are physically possible for any second moments.
    """
    name, inertia = f"body:{body.name}", model.body_inertia[body.id]
    tumbles = (model.jnt_type[model.jnt_bodyid == body.id] <= BALL_JOINT).any()
    if not tumbles:
        largest, place = float(inertia.max()), Place(body=body.id)
        target = f"{name}/inertia"
        return [
            _make_term(_scale_inertia, target, MASS_BOUND, largest, "kg m^2", place)
        ]
    moments = _second_moments(inertia)
    return [
        _make_term(
            _scale_second_moment,
            f"{name}/{word}",
            MASS_BOUND,
            float(value),
            "kg m^2",
            Place(body=body.id, principal_axis=axis),
        )
        for axis, (word, value) in enumerate(zip(MOMENTS, moments, strict=True))
        if value > MIN_SECOND_MOMENT_SHARE * moments.max()
    ]


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


def _joint_terms(robot: RobotSummary) -> list[Term]:
    """Damping, armature, dry friction and stiffness of hinges, slides and balls."""
    model = robot.model
    found = [term for joint in robot.joints for term in _hinge_terms(model, joint)]
    for j in np.flatnonzero(model.jnt_type == BALL_JOINT):
        found += _ball_terms(model, int(j))
    return found


def _hinge_terms(model, joint: Joint) -> Iterator[Term]:
    """What the model states of a hinge or slide."""
    target = f"joint:{joint.name or joint.id}"
    inertia = "kg m^2" if joint.unit == "rad" else "kg"
    for field, unit in (
        ("damping", f"{joint.force} s/{joint.unit}"),
        ("armature", inertia),
        ("frictionloss", joint.force),
    ):
        if value := float(getattr(model, f"dof_{field}")[joint.dof]):
            scale, place = _scale_dof_field(f"dof_{field}"), Place(dof=joint.dof)
            yield _make_term(
                scale, f"{target}/{field}", OTHER_BOUND, value, unit, place
            )
    if value := float(model.jnt_stiffness[joint.id]):
        unit, place = f"{joint.force}/{joint.unit}", Place(joint=joint.id)
        target = f"{target}/stiffness"
        yield _make_term(_scale_stiffness, target, OTHER_BOUND, value, unit, place)


def _ball_terms(model, joint: int) -> Iterator[Term]:
    """What the model states of a ball joint: the same along its three axes."""
    first = int(model.jnt_dofadr[joint])
    target = f"joint:{model.joint(joint).name or joint}"
    for field, unit in ("damping", "N m s/rad"), ("armature", "kg m^2"):
        if value := float(getattr(model, f"dof_{field}")[first]):
            scale, place = _scale_dof_field(f"dof_{field}", 3), Place(dof=first)
            yield _make_term(
                scale, f"{target}/{field}", OTHER_BOUND, value, unit, place
            )
    if value := float(model.jnt_stiffness[joint]):
        target, place = f"{target}/stiffness", Place(joint=joint)
        yield _make_term(_scale_stiffness, target, OTHER_BOUND, value, "N m/rad", place)


def _actuator_terms(robot: RobotSummary) -> list[Term]:
    """Gains, gears and time constants of actuators whose law MJCF states by these."""
    model = robot.model
    found: list[Term] = []
    for a in robot.actuators:
        if has_affine_force(model, a.id):
            found += _affine_terms(model, a)
        elif is_pid(model, a.id):
            found += _pid_terms(model, a)
    return found


def _pid_terms(model, a: Actuator) -> Iterator[Term]:
    """What the model states of one <pid>: its gains."""
    place, stiffness = Place(actuator=a.id), f"{a.force}/{a.unit}"
    _, kp, kv = -model.actuator_biasprm[a.id, :3]
    for field, scale, value, unit in (
        ("kp", _scale_bias, kp, stiffness),
        ("kv", _scale_kv, kv, f"{a.force} s/{a.unit}"),
        ("ki", _scale_gain, model.actuator_gainprm[a.id, 0], f"{stiffness}/s"),
    ):
        if value:
            target = f"actuator:{a.name}/{field}"
            yield _make_term(scale, target, OTHER_BOUND, float(value), unit, place)


def _affine_terms(model, a: Actuator) -> Iterator[Term]:
    """What the model states of one actuator: kp or gain, gear, kv, time constant."""
    name, place = f"actuator:{a.name}", Place(actuator=a.id)
    gain, bias = model.actuator_gainprm[a.id, 0], model.actuator_biasprm[a.id]
    speed = bool(gain and bias[2] == -gain and not bias[1])  # <velocity>: one kv
    if not speed and (gain not in (0.0, 1.0) or bias[1]):
        unit = f"{a.force}/{a.unit}" if a.servo else f"{a.force}/ctrl"
        word, scale = ("kp", _scale_kp) if a.servo else ("gain", _scale_gain)
        yield _make_term(scale, f"{name}/{word}", OTHER_BOUND, float(gain), unit, place)
        if bias[1] and not a.servo:  # of another length than the joint's
            unit, value = f"{a.force}/{a.unit}", float(-bias[1])
            yield _make_term(
                _scale_bias, f"{name}/bias", OTHER_BOUND, value, unit, place
            )
    gear = float(model.actuator_gear[find_output(model, a.id), 0])
    is_plain_motor = gain == 1.0 and not bias.any() and a.dof >= 0
    if is_plain_motor and abs(gear) == 1.0:  # its strength, which a gear would say
        unit = f"{a.force}/ctrl"
        yield _make_term(_scale_gain, f"{name}/gain", OTHER_BOUND, 1.0, unit, place)
    elif is_plain_motor and gear:
        yield _make_term(_scale_gear, f"{name}/gear", OTHER_BOUND, gear, "1", place)
    if bias[2]:
        unit = f"{a.force} s/{a.unit}"
        scale = _scale_speed_gain if speed else _scale_kv
        yield _make_term(scale, f"{name}/kv", OTHER_BOUND, float(-bias[2]), unit, place)
    if (
        model.actuator_dyntype[a.id] in DYN_FILTER_TYPES
        and model.actuator_dynprm[a.id, 0]
    ):
        value, target = float(model.actuator_dynprm[a.id, 0]), f"{name}/timeconst"
        yield _make_term(_scale_time_constant, target, OTHER_BOUND, value, "s", place)


def _geom_terms(robot: RobotSummary) -> list[Term]:
    """Sliding friction where the model states it; MuJoCo's default is no statement."""
    model = robot.model
    if not robot.has_contact:
        return []
    is_stated = np.abs(model.geom_friction - DEFAULT_FRICTION).max(axis=1) > 1e-12
    solid = (model.geom_contype | model.geom_conaffinity) > 0
    return [
        _make_term(
            _scale_friction,
            f"geom:{model.geom(g).name or g}/friction",
            OTHER_BOUND,
            float(model.geom_friction[g, 0]),
            "1",
            Place(geom=int(g)),
        )
        for g in np.flatnonzero(is_stated & solid)
    ]
