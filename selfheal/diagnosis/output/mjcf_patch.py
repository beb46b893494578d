"""A fit's changes as edits of the MJCF's text: takes terms and values, gives edits.

Effects edit a compiled model. What differs from the model as given becomes attributes
of its text, and effects that numbers cannot say bring edits of their own.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...mjcf.edit import Edit, Rename, Set, format_number
from ...recording import find_controls, find_output
from ...recording.data import Floats
from ..effects.base import Term
from ..effects.protocols import TextForm
from ..simulation.model_variants import ModelVariant, split_values
from .model_source import (
    Attributes,
    ModelSource,
    differs,
    edit_attributes,
    name_or_id,
)
from .patch_bodies import edit_bodies, edit_geoms, edit_sites

if TYPE_CHECKING:
    from mujoco import MjModel

FREE_JOINT, SLIDE_JOINT = 0, 2  # mjtJoint
OPTIONS = ("gravity", "density", "viscosity", "wind")  # of mjOption, that effects set
# attributes by fields: of a joint's first degree of freedom, of its limits
_DOF = {"dof_frictionloss": "frictionloss", "dof_armature": "armature"}
_LIMITS = {"jnt_actfrcrange": "actuatorfrcrange", "jnt_solref": "solreflimit"}
# attributes of the kinds of actuators that a <general> one does not have
SHORT = dict.fromkeys(
    [
        "kp",
        "kv",
        "gain",
        "dampratio",
        "timeconst",
        "inheritrange",
        "diameter",
        "area",
        "bias",
    ]
)
DYNAMICS = {1: "integrator", 2: "filter", 3: "filterexact"}  # mjtDyn
AFFINE = 1  # mjtGain, mjtBias


def build_edits(
    source: ModelSource, variant: ModelVariant, terms: Sequence[Term], values: Floats
) -> list[Edit]:
    """Edits after which the text states what terms say, as far as MuJoCo can.

    Args:
        variant: the compiled model with the joints that the terms add.
        values: (P) of all their parameters.
    """
    old, new = variant.model, variant.build_model(terms, values)
    edits: list[Edit] = []
    for term, part in zip(terms, split_values(terms, values), strict=True):
        if isinstance(term.effect, TextForm):
            for place in term.places:
                edits += term.effect.edit_text(old, place.renumber(variant), part)
    return [
        *edits,
        *_edit_joints(source, old, new),
        *_edit_actuators(source, old, new, edits),
        *edit_bodies(source, old, new),
        *edit_geoms(source, old, new),
        *edit_sites(source, old, new),
        *_edit_option(old, new),
    ]


def _edit_joints(source: ModelSource, old: "MjModel", new: "MjModel") -> Iterator[Edit]:
    """Edits of the joints that differ between two models.

    Of a joint that an effect adds only its range may differ; the effect's own edit
    states the rest.
    """
    given = {j.name for j in source.spec.joints}
    for j in range(new.njnt):
        if new.jnt_type[j] == FREE_JOINT:  # it states nothing
            continue
        attributes = _joint_attributes(source, old, new, j)
        if old.joint(j).name not in given:
            own = ("range", "limited")
            attributes = {k: v for k, v in attributes.items() if k in own}
        if attributes:
            yield Set("joint", name_or_id(old.joint, j), attributes)


def _joint_attributes(
    source: ModelSource, old: "MjModel", new: "MjModel", j: int
) -> Attributes:
    """Attributes of a joint whose values differ between two models."""
    v, q = int(new.jnt_dofadr[j]), int(new.jnt_qposadr[j])
    attributes: Attributes = {}
    damping = [np.append(m.dof_damping[v], m.dof_dampingpoly[v]) for m in (old, new)]
    if differs(*damping):
        used = np.flatnonzero(damping[1])
        count = (used[-1] if used.size else 0) + 1
        attributes["damping"] = format_number(damping[1][:count])
    attributes |= edit_attributes(old, new, v, _DOF)
    attributes |= edit_attributes(old, new, j, {"jnt_stiffness": "stiffness"})
    in_degrees = source.degree and new.jnt_type[j] != SLIDE_JOINT
    if differs(old.qpos_spring[q], new.qpos_spring[q]):
        angle = _to_text_angle(new.qpos_spring[q], in_degrees)
        attributes["springref"] = format_number(angle)
    if differs(old.jnt_range[j], new.jnt_range[j]):
        ends = _to_text_angle(new.jnt_range[j], in_degrees)
        attributes |= {"range": format_number(ends), "limited": "true"}
    return attributes | edit_attributes(old, new, j, _LIMITS)


def _to_text_angle(value: Floats, in_degrees: bool) -> Floats:
    """An angle or length [rad or m] as the text has it [deg, rad or m]."""
    return np.rad2deg(value) if in_degrees else value


def _edit_option(old: "MjModel", new: "MjModel") -> Iterator[Edit]:
    """The edit of <option>, if any of the fields that effects set differs."""
    attributes: Attributes = {
        field: format_number(getattr(new.opt, field))
        for field in OPTIONS
        if differs(getattr(old.opt, field), getattr(new.opt, field))
    }
    if attributes:
        yield Set("option", "", attributes)


def _edit_actuators(
    source: ModelSource, old: "MjModel", new: "MjModel", before: Sequence[Edit]
) -> Iterator[Edit]:
    """Edits of the actuators that differ between two models.

    Args:
        before: edits that come first, and may make an actuator a <general> one.
    """
    general = {e.name for e in before if isinstance(e, Rename)}
    for a in range(new.nactuator):
        name = name_or_id(old.actuator, a)
        given = source.actuator_tag(old.actuator(a).name, a)
        tag = "general" if name in general else given
        attributes = _edit_force_law(tag, old, new, a)
        to = "general" if "gainprm" in attributes else tag
        if to == tag and differs(old.actuator_dynprm[a, 0], new.actuator_dynprm[a, 0]):
            attribute = "dynprm" if tag == "general" else "timeconst"
            attributes[attribute] = format_number(new.actuator_dynprm[a, 0])
        gear = new.actuator_gear[out := find_output(new, a)]
        if differs(old.actuator_gear[out], gear):
            attributes["gear"] = format_number(gear[: np.flatnonzero(gear)[-1] + 1])
        ranges = [m.actuator_forcerange[a] for m in (old, new)]
        limited = [m.actuator_forcelimited[a] for m in (old, new)]
        if differs(*limited) or differs(*ranges):
            attributes["forcelimited"] = "true"
            attributes["forcerange"] = format_number(ranges[1])
        for control in find_controls(new, a):
            fields = {"actuator_ctrlrange": "ctrlrange"}
            attributes |= edit_attributes(old, new, control, fields)
        attributes |= _keep_inherited_range(source, old, new, a, to != given)
        if attributes and to != tag:
            yield Rename("actuator", name, to, attributes)
        elif attributes:
            yield Set("actuator", name, attributes)


def _edit_force_law(tag: str, old: "MjModel", new: "MjModel", a: int) -> Attributes:
    """Attributes of gain and bias where they differ, in the form that the tag has.

    A tag that has no such form gets those of <general>.
    """
    gain, bias = new.actuator_gainprm[a, :3], new.actuator_biasprm[a, :3]
    before = [old.actuator_gainprm[a, :3], old.actuator_biasprm[a, :3]]
    if not differs(before, [gain, bias]):
        return {}
    if tag == "pid":
        integral = {"ki": format_number(gain[0])} if gain[0] else {}
        kp, kv = format_number(-bias[1]), format_number(-bias[2])
        return {"kp": kp, "kv": kv, "dampratio": None, **integral}
    if tag == "general":
        return {"gainprm": format_number(gain), "biasprm": format_number(bias)}
    is_servo = not differs([gain[0], *bias[:2]], [-bias[1], 0, bias[1]])
    if tag in ("position", "intvelocity") and is_servo:
        kp, kv = format_number(gain[0]), format_number(-bias[2])
        return {"kp": kp, "kv": kv, "dampratio": None}
    if tag == "velocity" and not differs([gain[0], *bias[:2]], [-bias[2], 0, 0]):
        return {"kv": format_number(gain[0])}
    attributes: Attributes = {
        **SHORT,
        "gaintype": "affine" if new.actuator_gaintype[a] == AFFINE else "fixed",
        "gainprm": format_number(gain),
        "biastype": "affine" if bias.any() else "none",
        "biasprm": format_number(bias),
    }
    if kind := DYNAMICS.get(int(new.actuator_dyntype[a])):
        dynprm = format_number(new.actuator_dynprm[a, 0])
        attributes |= {"dyntype": kind, "dynprm": dynprm}
    return attributes


def _keep_inherited_range(
    source: ModelSource, old: "MjModel", new: "MjModel", a: int, general: bool
) -> Attributes:
    """Attributes that keep the range that an actuator took from its joint.

    Args:
        general: whether it becomes a <general> one, which inherits no range.
    """
    joint = int(new.actuator_trnid[a, 0])
    if not source.spec.actuators[a].inheritrange:
        return {}
    if not general and not differs(old.jnt_range[joint], new.jnt_range[joint]):
        return {}
    which = "act" if new.actuator_actlimited[a] else "ctrl"
    row = a if which == "act" else find_controls(new, a)[0]
    value = format_number(getattr(new, f"actuator_{which}range")[row])
    return {f"{which}range": value, "inheritrange": None if general else "0"}
