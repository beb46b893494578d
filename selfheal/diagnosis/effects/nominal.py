"""What the model states and a careful user would let a fit change (contract 2)."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from ..data.robot_summary import (
    MovingBody,
    RobotSummary,
    find_link_axis,
    has_affine_force,
    measure_extent,
)
from .base import Effect, Floats, Parameter, Term
from .body import stretch_body

MASS, LENGTH, REST = 0.15, 0.03, 0.30  # the contract's bounds, section 2
SIDES = ("size_x", "size_y", "size_z")
MOMENTS = ("second_moment_x", "second_moment_y", "second_moment_z")
THIN = 1e-3  # of the largest second moment, one that matters to no motion; chosen
LONG = 0.3  # of a body's extent, the distance to its end that makes it a link; chosen
LOOSE = 0.9  # of what is allowed: an interval as wide says nothing; chosen


def relative_bound(parameter: str) -> float:
    """How far a stated value may move, relative to itself ("joint:knee/damping")."""
    field = parameter.rpartition("/")[2]
    lengths = dict.fromkeys(("length", *SIDES), LENGTH)
    masses = dict.fromkeys(("mass", "inertia", *MOMENTS), MASS)
    return {**masses, **lengths}.get(field, REST)


def is_unidentified(entry: Mapping[str, Any]) -> bool:
    """Whether the data leave a re-fitted value as open as a careful user would."""
    given, low, high = (entry[key] for key in ("given", "low", "high"))
    if None in (given, low, high):
        return True
    return high - low > LOOSE * 2 * relative_bound(entry["parameter"]) * abs(given)


class NominalParameter(Effect):
    """A number that the model states, times a factor near one."""

    name = "stated"
    group = "stated"

    def __init__(self, scale: Callable) -> None:
        """`scale(model, place, factor)` edits a compiled model."""
        self.scale = scale

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """It is not searched for."""
        return []

    def edit_model(self, model, place, values: Floats) -> None:
        self.scale(model, place, values[0])


def _make_term(
    scale, target: str, reach: float, value: float, unit: str, **place
) -> Term:
    parameter = Parameter("factor", "1", 1.0, 1 - reach, 1 + reach, reach / 3)
    note = {"value": value, "unit": unit}
    return Term(
        NominalParameter(scale), (target,), (place,), (parameter,), ((1.0,),), note
    )


def _scale_field(name: str) -> Callable:
    def scale(model, place, factor):
        getattr(model, name)[place["at"]] *= factor

    return scale


def _scale_dof_field(name: str, count: int = 1) -> Callable:
    def scale(model, place, factor):
        getattr(model, name)[place["dof"] : place["dof"] + count] *= factor

    return scale


def _scale_stiffness(model, place, factor):
    model.jnt_stiffness[place["joint"]] *= factor


def _scale_mass(model, place, factor):
    model.body_mass[place["at"]] *= factor
    model.body_inertia[place["at"]] *= factor


def _scale_second_moment(model, place, factor):
    inertia, side = model.body_inertia[place["at"]], place["side"]
    more = (factor - 1) * _second_moments(inertia)[side]
    inertia += more * (np.arange(3) != side)


def _second_moments(inertia: Floats) -> Floats:
    """Of mass (3) [kg m^2] along the principal axes, which inertias (3) are about."""
    return inertia.sum() / 2 - inertia


def _scale_gain(model, place, factor):
    model.actuator_gainprm[place["at"], 0] *= factor


def _scale_bias(model, place, factor):
    model.actuator_biasprm[place["at"], 1] *= factor


def _scale_kp(model, place, factor):
    _scale_gain(model, place, factor)
    _scale_bias(model, place, factor)


def _scale_gear(model, place, factor):
    model.actuator_gear[place["at"]] *= factor


def _scale_kv(model, place, factor):
    model.actuator_biasprm[place["at"], 2] *= factor


def _scale_speed_gain(model, place, factor):
    model.actuator_gainprm[place["at"], 0] *= factor
    model.actuator_biasprm[place["at"], 2] *= factor


def _scale_time_constant(model, place, factor):
    model.actuator_dynprm[place["at"], 0] *= factor


def _scale_length(model, place, factor):
    stretch_body(model, place["at"], place["axis"], factor)


def _scale_friction(model, place, factor):
    model.geom_friction[place["at"], 0] *= factor


def build_nominal_terms(robot: RobotSummary) -> list[Term]:
    """Everything that the model states and that is not zero, as terms."""
    return [
        *_body_terms(robot),
        *_joint_terms(robot),
        *_actuator_terms(robot),
        *_geom_terms(robot),
    ]


def _body_terms(robot: RobotSummary) -> list[Term]:
    found = []
    for body in robot.bodies:
        name = f"body:{body.name}"
        found.append(
            _make_term(
                _scale_mass,
                f"{name}/mass",
                MASS,
                body.mass,
                "kg",
                at=body.id,
                name="mass",
            )
        )
        found += _inertia_terms(robot.model, body)
        for word, axis, length in _list_lengths(robot, body):
            found.append(
                _make_term(
                    _scale_length,
                    f"{name}/{word}",
                    LENGTH,
                    length,
                    "m",
                    at=body.id,
                    axis=axis,
                )
            )
    return found


def _inertia_terms(model, body: MovingBody) -> list[Term]:
    """One factor; of a body that tumbles freely, one along each principal axis.

    Its motion tells only how its inertias compare. Those that are sums of second
    moments of mass are possible ones, whatever these are.
    """
    name, inertia = f"body:{body.name}", model.body_inertia[body.id]
    tumbles = (model.jnt_type[model.jnt_bodyid == body.id] <= 1).any()  # free or ball
    if not tumbles:
        scale, largest = _scale_field("body_inertia"), float(inertia.max())
        return [
            _make_term(scale, f"{name}/inertia", MASS, largest, "kg m^2", at=body.id)
        ]
    own = _second_moments(inertia)
    return [
        _make_term(_scale_second_moment, f"{name}/{word}", MASS, float(value), "kg m^2",
              at=body.id, side=side)
        for side, (word, value) in enumerate(zip(MOMENTS, own, strict=True))
        if value > THIN * own.max()
    ]  # fmt: skip


def _list_lengths(
    robot: RobotSummary, body: MovingBody
) -> Iterator[tuple[str, Floats, float]]:
    """Names, axes (3) and values [m] of the lengths that a body has.

    A link has one. A box has three, that matter where something touches it or hangs on
    it.
    """
    if body.length > LONG * body.size:
        axis, length = find_link_axis(robot.model, body.id)
        yield "length", axis, length
    elif robot.has_contact or body.id in robot.model.body_parentid:
        sides = measure_extent(robot.model, body.id)
        for word, axis, side in zip(SIDES, np.eye(3), sides, strict=True):
            if side > 0:
                yield word, axis, float(side)


def _joint_terms(robot: RobotSummary) -> list[Term]:
    model, found = robot.model, []
    for joint in robot.joints:
        speed = f"{joint.force} s/{joint.unit}"
        inertia = "kg m^2" if joint.unit == "rad" else "kg"
        for field, unit in (
            ("damping", speed), ("armature", inertia), ("frictionloss", joint.force)
        ):  # fmt: skip
            value = float(getattr(model, f"dof_{field}")[joint.dof])
            if value:
                scale = _scale_dof_field(f"dof_{field}")
                target = f"joint:{joint.name or joint.id}/{field}"
                found.append(
                    _make_term(scale, target, REST, value, unit, dof=joint.dof)
                )
        if model.jnt_stiffness[joint.id]:
            found.append(
                _make_term(
                    _scale_stiffness,
                    f"joint:{joint.name or joint.id}/stiffness",
                    REST,
                    float(model.jnt_stiffness[joint.id]),
                    f"{joint.force}/{joint.unit}",
                    joint=joint.id,
                )
            )
    for j in np.flatnonzero(model.jnt_type == 1):  # ball: the same along three axes
        found += _ball_terms(model, int(j))
    return found


def _ball_terms(model, joint: int) -> Iterator[Term]:
    first = int(model.jnt_dofadr[joint])
    target = f"joint:{model.joint(joint).name or joint}"
    for field, unit in ("damping", "N m s/rad"), ("armature", "kg m^2"):
        if value := float(getattr(model, f"dof_{field}")[first]):
            scale = _scale_dof_field(f"dof_{field}", 3)
            yield _make_term(scale, f"{target}/{field}", REST, value, unit, dof=first)
    if value := float(model.jnt_stiffness[joint]):
        target = f"{target}/stiffness"
        yield _make_term(_scale_stiffness, target, REST, value, "N m/rad", joint=joint)


def _actuator_terms(robot: RobotSummary) -> list[Term]:
    model, found = robot.model, []
    for a in robot.actuators:
        if not has_affine_force(model, a.id):
            continue
        name = f"actuator:{a.name}"
        gain, bias = model.actuator_gainprm[a.id, 0], model.actuator_biasprm[a.id]
        speed = bool(gain and bias[2] == -gain and not bias[1])  # <velocity>: one kv
        if not speed and (gain not in (0.0, 1.0) or bias[1]):
            unit = f"{a.force}/{a.unit}" if a.servo else f"{a.force}/ctrl"
            word, scale = ("kp", _scale_kp) if a.servo else ("gain", _scale_gain)
            target = f"{name}/{word}"
            found.append(_make_term(scale, target, REST, float(gain), unit, at=a.id))
            if bias[1] and not a.servo:  # of another length than the joint's
                unit, value = f"{a.force}/{a.unit}", float(-bias[1])
                found.append(
                    _make_term(_scale_bias, f"{name}/bias", REST, value, unit, at=a.id)
                )
        gear = float(model.actuator_gear[a.id, 0])
        if (
            gain == 1.0
            and not bias.any()
            and a.dof >= 0
            and abs(gear) not in (0.0, 1.0)
        ):
            found.append(
                _make_term(_scale_gear, f"{name}/gear", REST, gear, "1", at=a.id)
            )
        if bias[2]:
            unit = f"{a.force} s/{a.unit}"
            scale = _scale_speed_gain if speed else _scale_kv
            value = float(-bias[2])
            found.append(_make_term(scale, f"{name}/kv", REST, value, unit, at=a.id))
        if model.actuator_dyntype[a.id] in (2, 3) and model.actuator_dynprm[a.id, 0]:
            value = float(model.actuator_dynprm[a.id, 0])
            found.append(
                _make_term(
                    _scale_time_constant, f"{name}/timeconst", REST, value, "s", at=a.id
                )
            )
    return found


def _geom_terms(robot: RobotSummary) -> list[Term]:
    """Sliding friction where it is stated; MuJoCo's default is nobody's statement."""
    model = robot.model
    if not robot.has_contact:
        return []
    nominal_terms = (
        np.abs(model.geom_friction - [1.0, 0.005, 0.0001]).max(axis=1) > 1e-12
    )
    solid = (model.geom_contype | model.geom_conaffinity) > 0
    return [
        _make_term(_scale_friction, f"geom:{model.geom(g).name or g}/friction", REST,
              float(model.geom_friction[g, 0]), "1", at=int(g))
        for g in np.flatnonzero(nominal_terms & solid)
    ]  # fmt: skip
