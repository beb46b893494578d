"""A fit's changes as edits of the MJCF's text: takes terms and values, gives edits."""

from collections.abc import Iterator, Sequence

import numpy as np

from ...mjcf.edit import Edit, Set, format_number
from ...recording.data import Floats
from ..effects.base import Term, implements
from ..simulation.model_variants import ModelVariant, split_values
from .model_source import ModelSource, differs, name_or_id
from .patch_actuators import edit_actuators
from .patch_bodies import edit_bodies, edit_geoms, edit_sites


def build_edits(
    source: ModelSource, variant: ModelVariant, terms: Sequence[Term], values: Floats
) -> list[Edit]:
    """What to change in the text so that the terms are true, as far as MuJoCo can."""
    model = variant.build_model(terms, values)
    found: list[Edit] = []
    for term, part in zip(terms, split_values(terms, values), strict=True):
        if implements(term.effect, "edit_text"):
            for place in term.places:
                found += (
                    term.effect.edit_text(variant.model, variant.map_place(place), part)
                    or []
                )
    found = [
        *found,
        *_edit_joints(source, variant.model, model),
        *edit_actuators(source, variant.model, model, found),
        *edit_bodies(source, variant.model, model),
        *edit_geoms(source, variant.model, model),
        *edit_sites(source, variant.model, model),
        *_edit_option(variant.model, model),
    ]
    return found


def _edit_joints(source: ModelSource, old, new) -> Iterator[Edit]:
    given = {j.name for j in source.spec.joints}
    for j in range(new.njnt):
        name = old.joint(j).name
        if not new.jnt_type[j]:  # what floats states nothing
            continue
        v, q = int(new.jnt_dofadr[j]), int(new.jnt_qposadr[j])
        predicted: dict[str, str | None] = {}
        damping = [
            np.append(m.dof_damping[v], m.dof_dampingpoly[v]) for m in (old, new)
        ]
        if differs(*damping):
            used = np.flatnonzero(damping[1])
            predicted["damping"] = format_number(
                damping[1][: (used[-1] if used.size else 0) + 1]
            )
        for field, attribute in (("dof_frictionloss", "frictionloss"),
                                 ("dof_armature", "armature")):  # fmt: skip
            if differs(getattr(old, field)[v], getattr(new, field)[v]):
                predicted[attribute] = format_number(getattr(new, field)[v])
        if differs(old.jnt_stiffness[j], new.jnt_stiffness[j]):
            predicted["stiffness"] = format_number(new.jnt_stiffness[j])
        turn = source.degree and new.jnt_type[j] != 2
        if differs(old.qpos_spring[q], new.qpos_spring[q]):
            predicted["springref"] = format_number(
                _to_text_angle(new.qpos_spring[q], turn)
            )
        if differs(old.jnt_range[j], new.jnt_range[j]):
            predicted["range"] = format_number(_to_text_angle(new.jnt_range[j], turn))
            predicted["limited"] = "true"
        if differs(old.jnt_solref[j], new.jnt_solref[j]):
            predicted["solreflimit"] = format_number(new.jnt_solref[j])
        if name not in given:  # its effect has said the rest
            predicted = {
                k: v for k, v in predicted.items() if k in ("range", "limited")
            }
        if predicted:
            yield Set("joint", name_or_id(old.joint, j), predicted)


def _to_text_angle(value, degree: bool):
    return np.rad2deg(value) if degree else value


def _edit_option(old, new) -> Iterator[Edit]:
    predicted: dict[str, str | None] = {
        field: format_number(getattr(new.opt, field))
        for field in ("gravity", "density", "viscosity", "wind")
        if differs(getattr(old.opt, field), getattr(new.opt, field))
    }
    if predicted:
        yield Set("option", "", predicted)
