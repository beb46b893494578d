"""A fit's changes as edits of the MJCF's text: takes terms and values, gives edits.

Effects edit a compiled model. What differs from the model as given becomes attributes
of its text, and effects that numbers cannot say bring edits of their own.
"""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...mjcf.edit import Edit, Set, format_number
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
from .patch_actuators import edit_actuators
from .patch_bodies import edit_bodies, edit_geoms, edit_sites

if TYPE_CHECKING:
    from mujoco import MjModel

FREE_JOINT, SLIDE_JOINT = 0, 2  # mjtJoint
OPTIONS = ("gravity", "density", "viscosity", "wind")  # of mjOption, that effects set
# attributes by fields: of a joint's first degree of freedom, of its limits
_DOF = {"dof_frictionloss": "frictionloss", "dof_armature": "armature"}
_LIMITS = {"jnt_actfrcrange": "actuatorfrcrange", "jnt_solref": "solreflimit"}


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
        *edit_actuators(source, old, new, edits),
        *edit_bodies(source, old, new),
        *edit_geoms(source, old, new),
        *edit_sites(source, old, new),
        *_edit_option(old, new),
    ]


def _edit_joints(source: ModelSource, old: "MjModel", new: "MjModel") -> Iterator[Edit]:
    """Edits of the joints that differ between two models.

    Of a joint that an effect adds only its range may differ; the effect's own edit
    states the rest.

    Args:
        old: compiled, as the text states it, with the joints that effects add.
        new: compiled, as the text is to be.
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
