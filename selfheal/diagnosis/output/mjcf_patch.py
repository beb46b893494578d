"""A compiled change as an edit of text: takes two models, gives MJCF attributes."""

import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ModelError
from ...mjcf.edit import (
    Edit,
    Insert,
    Rename,
    Set,
    apply_edits,
    format_number,
    list_tags,
)
from ...recording.data import Floats
from ..effects.base import Term, implements
from ..simulation.model_variants import ModelVariant, split_values

# other ways to say how something is turned
TURNED = dict.fromkeys(("axisangle", "xyaxes", "zaxis", "euler"))
# what the kinds of actuators say, and a <general> one cannot
SHORT = dict.fromkeys(
    (
        "kp", "kv", "gain", "dampratio", "timeconst", "inheritrange", "diameter",
        "area", "bias",
    )
)  # fmt: skip

DYNAMICS = {1: "integrator", 2: "filter", 3: "filterexact"}  # mjtDyn


class ModelSource:
    """What the text of a model says and a compiled one does not.

    Attributes:
        spec: as MuJoCo reads the text.
        degree: whether hinges' angles are written in degrees.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """`path`: of the MJCF or URDF."""
        self.spec = compile_patched(path, ())
        self.degree = bool(self.spec.compiler.degree)
        self._actuators = list_tags(path, "actuator")
        self._inertials = {name for name, _ in list_tags(path, "inertial")}

    def actuator_tag(self, name: str, index: int) -> str:
        """The tag of an actuator."""
        named = [tag for n, tag in self._actuators if name and n == name]
        unnamed = [tag for _, tag in self._actuators[index : index + 1]]
        return (named or unnamed or ["general"])[0]

    def states_inertia(self, body: str) -> bool:
        """Whether a body has an <inertial>."""
        return body in self._inertials

    @property
    def overrides_masses(self) -> bool:
        """Whether masses and inertias are not those that the bodies state."""
        compiler, always = self.spec.compiler, 1  # mjINERTIAFROMGEOM_TRUE
        return int(compiler.inertiafromgeom) == always or compiler.settotalmass > 0

    def resolve_orientation(self, quat: Floats, alt: Any) -> Floats:
        """How something is turned (4), whichever way the spec says so."""
        if int(alt.type) == 0:  # mjORIENTATION_QUAT
            return np.array(quat) / np.linalg.norm(quat)
        how = self.spec.compiler
        turned = self.spec.resolve_orientation(
            degree=how.degree, sequence=how.eulerseq, orientation=alt
        )
        return np.array(turned)

    def resolve_frame(self, element: Any) -> tuple[Floats, Floats]:
        """Place (3) and turn (4) of the <frame>s around an element of the spec."""
        import mujoco

        place, turn = np.zeros(3), np.array([1.0, 0, 0, 0])
        while element.frame is not None:
            element = element.frame
            its = self.resolve_orientation(element.quat, element.alt)
            mujoco.mju_rotVecQuat(place, place.copy(), its)
            place += element.pos
            mujoco.mju_mulQuat(turn, its, turn.copy())
        return place, turn


def compile_patched(path: str | os.PathLike[str], changes: Sequence[Edit]) -> Any:
    """The edited text as MuJoCo's spec, whose bodies are numbered as in a model.

    Raises:
        ModelError: an edit speaks of what has no text, or MuJoCo refuses the new one.
    """
    import mujoco

    with tempfile.TemporaryDirectory() as folder:
        new = Path(folder) / "model.xml"
        new.write_bytes(apply_edits(path, changes, folder).encode())  # MJCF of a URDF
        try:
            spec = mujoco.MjSpec.from_file(str(new))
            spec.compile()
        except ValueError as error:
            said = " ".join(str(error).split())
            raise ModelError(f"MuJoCo refuses the patch: {said}") from error
    return spec


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
        *_edit_actuators(source, variant.model, model, found),
        *_edit_bodies(source, variant.model, model),
        *_edit_geoms(source, variant.model, model),
        *_edit_sites(source, variant.model, model),
        *_edit_option(variant.model, model),
    ]
    return found


def _differs(a, b) -> bool:
    a, b = np.asarray(a, float), np.asarray(b, float)
    return bool((np.abs(a - b) > 1e-9 * (1e-6 + np.abs(a) + np.abs(b))).any())


def _name_or_id(thing, index: int):
    return thing(index).name or int(index)


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
        if _differs(*damping):
            used = np.flatnonzero(damping[1])
            predicted["damping"] = format_number(
                damping[1][: (used[-1] if used.size else 0) + 1]
            )
        for field, attribute in (("dof_frictionloss", "frictionloss"),
                                 ("dof_armature", "armature")):  # fmt: skip
            if _differs(getattr(old, field)[v], getattr(new, field)[v]):
                predicted[attribute] = format_number(getattr(new, field)[v])
        if _differs(old.jnt_stiffness[j], new.jnt_stiffness[j]):
            predicted["stiffness"] = format_number(new.jnt_stiffness[j])
        turn = source.degree and new.jnt_type[j] != 2
        if _differs(old.qpos_spring[q], new.qpos_spring[q]):
            predicted["springref"] = format_number(
                _to_text_angle(new.qpos_spring[q], turn)
            )
        if _differs(old.jnt_range[j], new.jnt_range[j]):
            predicted["range"] = format_number(_to_text_angle(new.jnt_range[j], turn))
            predicted["limited"] = "true"
        if _differs(old.jnt_solref[j], new.jnt_solref[j]):
            predicted["solreflimit"] = format_number(new.jnt_solref[j])
        if name not in given:  # its effect has said the rest
            predicted = {
                k: v for k, v in predicted.items() if k in ("range", "limited")
            }
        if predicted:
            yield Set("joint", _name_or_id(old.joint, j), predicted)


def _to_text_angle(value, degree: bool):
    return np.rad2deg(value) if degree else value


def _edit_actuators(
    source: ModelSource, old, new, before: Sequence[Edit]
) -> Iterator[Edit]:
    general = {e.name for e in before if isinstance(e, Rename)}
    for a in range(new.nu):
        name = _name_or_id(old.actuator, a)
        given = source.actuator_tag(old.actuator(a).name, a)
        tag = "general" if name in general else given
        predicted = _edit_force_law(tag, old, new, a)
        to = "general" if "gainprm" in predicted else tag
        if to == tag and _differs(old.actuator_dynprm[a, 0], new.actuator_dynprm[a, 0]):
            attribute = "dynprm" if tag == "general" else "timeconst"
            predicted[attribute] = format_number(new.actuator_dynprm[a, 0])
        if _differs(old.actuator_gear[a], new.actuator_gear[a]):
            used = np.flatnonzero(new.actuator_gear[a])
            predicted["gear"] = format_number(new.actuator_gear[a, : used[-1] + 1])
        limits = [
            (m.actuator_forcelimited[a], *m.actuator_forcerange[a]) for m in (old, new)
        ]
        if _differs(*limits):
            predicted["forcelimited"] = "true"
            predicted["forcerange"] = format_number(new.actuator_forcerange[a])
        predicted |= _keep_inherited_range(source, old, new, a, to != given)
        if predicted and to != tag:
            yield Rename("actuator", name, to, predicted)
        elif predicted:
            yield Set("actuator", name, predicted)


def _edit_force_law(tag: str, old, new, a: int) -> dict[str, str | None]:
    """What makes a force of the command, if that differs, as the tag says it.

    As <general> where the tag cannot say it.
    """
    gain, bias = new.actuator_gainprm[a, :3], new.actuator_biasprm[a, :3]
    before = [old.actuator_gainprm[a, :3], old.actuator_biasprm[a, :3]]
    if not _differs(before, [gain, bias]):
        return {}
    if tag == "general":
        return {"gainprm": format_number(gain), "biasprm": format_number(bias)}
    pulls = not _differs([gain[0], *bias[:2]], [-bias[1], 0, bias[1]])
    if tag in ("position", "intvelocity") and pulls:
        return {
            "kp": format_number(gain[0]),
            "kv": format_number(-bias[2]),
            "dampratio": None,
        }
    if tag == "velocity" and not _differs([gain[0], *bias[:2]], [-bias[2], 0, 0]):
        return {"kv": format_number(gain[0])}
    predicted: dict[str, str | None] = {
        **SHORT,
        "gaintype": "affine" if new.actuator_gaintype[a] == 1 else "fixed",
        "gainprm": format_number(gain),
        "biastype": "affine" if bias.any() else "none",
        "biasprm": format_number(bias),
    }
    if kind := DYNAMICS.get(int(new.actuator_dyntype[a])):
        predicted |= {
            "dyntype": kind,
            "dynprm": format_number(new.actuator_dynprm[a, 0]),
        }
    return predicted


def _keep_inherited_range(source: ModelSource, old, new, a: int, general: bool) -> dict:
    """The range that an actuator took from its joint, if it no longer would."""
    joint = int(new.actuator_trnid[a, 0])
    if not source.spec.actuators[a].inheritrange:
        return {}
    if not general and not _differs(old.jnt_range[joint], new.jnt_range[joint]):
        return {}
    which = "act" if new.actuator_actlimited[a] else "ctrl"
    value = format_number(getattr(new, f"actuator_{which}range")[a])
    return {f"{which}range": value, "inheritrange": None if general else "0"}


def _edit_bodies(source: ModelSource, old, new) -> Iterator[Edit]:
    fields = ("body_mass", "body_ipos", "body_inertia", "body_iquat")
    changed = [
        any(_differs(getattr(old, f)[b], getattr(new, f)[b]) for f in fields)
        for b in range(new.nbody)
    ]
    if source.overrides_masses and any(changed):
        compiler = {"inertiafromgeom": "auto", "settotalmass": None}
        yield Set("compiler", "", compiler)
        changed = [True] * new.nbody  # what they stated did not count so far
    for b in range(1, new.nbody):
        name = _name_or_id(old.body, b)
        if _differs(old.body_pos[b], new.body_pos[b]):
            moved = _moved_position(
                source, source.spec.bodies[b], old.body_pos, new.body_pos, b
            )
            yield Set("body", name, {"pos": moved})
        if not changed[b]:
            continue
        predicted: dict[str, str | None] = {
            "pos": format_number(new.body_ipos[b]),
            "quat": format_number(new.body_iquat[b]),
            "mass": format_number(new.body_mass[b]),
            "diaginertia": format_number(new.body_inertia[b]),
        }
        if source.states_inertia(str(name)):
            moments = _stated_axes_inertia(source, source.spec.bodies[b], new, b)
            if moments is None:
                predicted |= {"fullinertia": None, **TURNED}
            else:
                predicted |= {"diaginertia": format_number(moments)}
                del predicted["quat"]
            yield Set("inertial", name, predicted)
        else:
            xml = " ".join(f'{k}="{v}"' for k, v in predicted.items())
            yield Insert("body", name, f"<inertial {xml}/>", first=True)


def _stated_axes_inertia(
    source: ModelSource, element: Any, new, body: int
) -> Floats | None:
    """Inertia (3) along the axes that the text states; None: it has others now."""
    import mujoco

    if np.isfinite(element.fullinertia[0]):
        return None
    now, nominal_terms = np.empty(9), np.empty(9)
    mujoco.mju_quat2Mat(now, new.body_iquat[body])
    mujoco.mju_quat2Mat(
        nominal_terms, source.resolve_orientation(element.iquat, element.ialt)
    )
    turn = nominal_terms.reshape(3, 3).T @ now.reshape(3, 3)
    tensor = turn @ np.diag(new.body_inertia[body]) @ turn.T
    moments = np.diag(tensor)
    apart = np.abs(tensor - np.diag(moments)).max()
    return moments if apart < 1e-7 * moments.max() else None


def _moved_position(
    source: ModelSource, element: Any, old: Floats, new: Floats, index: int
) -> str:
    """The `pos` of an element after it has moved in its body."""
    import mujoco

    _, turn = source.resolve_frame(element)
    back, way = np.empty(4), np.empty(3)
    mujoco.mju_negQuat(back, turn)
    mujoco.mju_rotVecQuat(way, new[index] - old[index], back)
    return format_number(element.pos + way)


def _placed_attributes(
    source: ModelSource, element: Any, pos: Floats, quat: Floats
) -> dict:
    """The `pos` and `quat` of an element that is so in its body, and no `fromto`."""
    import mujoco

    place, turn = source.resolve_frame(element)
    back, its, at = np.empty(4), np.empty(4), np.empty(3)
    mujoco.mju_negQuat(back, turn)
    mujoco.mju_mulQuat(its, back, quat)
    mujoco.mju_rotVecQuat(at, pos - place, back)
    return {
        "fromto": None,
        **TURNED,
        "pos": format_number(at),
        "quat": format_number(its),
    }


def _edit_geoms(source: ModelSource, old, new) -> Iterator[Edit]:
    for g in range(new.ngeom):
        predicted: dict[str, str | None] = {}
        element = source.spec.geoms[g]
        moved = _differs(old.geom_pos[g], new.geom_pos[g])
        grown = _differs(old.geom_size[g], new.geom_size[g])
        if (moved or grown) and np.isfinite(element.fromto[0]):
            predicted |= _placed_attributes(
                source, element, new.geom_pos[g], new.geom_quat[g]
            )
            predicted["size"] = _format_size(new, g)
        elif moved:
            predicted["pos"] = _moved_position(
                source, element, old.geom_pos, new.geom_pos, g
            )
        if grown and new.geom_dataid[g] < 0:  # a mesh keeps its size
            predicted["size"] = _format_size(new, g)
        for field, attribute in (
            ("geom_friction", "friction"), ("geom_solref", "solref"),
            ("geom_priority", "priority"), ("geom_contype", "contype"),
            ("geom_conaffinity", "conaffinity"),
        ):  # fmt: skip
            if _differs(getattr(old, field)[g], getattr(new, field)[g]):
                predicted[attribute] = format_number(getattr(new, field)[g])
        if predicted:
            yield Set("geom", _name_or_id(old.geom, g), predicted)


def _format_size(model, geom: int) -> str:
    """As many numbers as the geom's type has."""
    used = {2: 1, 3: 2, 5: 2}  # mjtGeom: sphere, capsule, cylinder
    return format_number(
        model.geom_size[geom, : used.get(int(model.geom_type[geom]), 3)]
    )


def _edit_sites(source: ModelSource, old, new) -> Iterator[Edit]:
    for s in range(new.nsite):
        if not _differs(old.site_pos[s], new.site_pos[s]):
            continue
        element = source.spec.sites[s]
        if np.isfinite(element.fromto[0]):
            predicted = _placed_attributes(
                source, element, new.site_pos[s], new.site_quat[s]
            )
            predicted["size"] = format_number(new.site_size[s])
        else:
            predicted = {
                "pos": _moved_position(source, element, old.site_pos, new.site_pos, s)
            }
        yield Set("site", _name_or_id(old.site, s), predicted)


def _edit_option(old, new) -> Iterator[Edit]:
    predicted: dict[str, str | None] = {
        field: format_number(getattr(new.opt, field))
        for field in ("gravity", "density", "viscosity", "wind")
        if _differs(getattr(old.opt, field), getattr(new.opt, field))
    }
    if predicted:
        yield Set("option", "", predicted)
