"""A compiled change as an edit of text: takes two models, gives MJCF attributes."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence

import numpy as np

from ..recording.data import Floats
from .patch import Insert, Rename, Set, number
from .plant import Plant, parts
from .terms import Term, does

Edit = Set | Insert | Rename


class Source:
    """What the text of a model says and a compiled one does not.

    Attributes:
        degree: whether hinges' angles are written in degrees.
    """

    def __init__(self, text: str) -> None:
        """`text`: of the MJCF, included files in place."""
        root = ElementTree.fromstring(text)
        compiler = root.find("compiler")
        angle = "degree" if compiler is None else compiler.get("angle", "degree")
        self.degree = angle == "degree"
        section = root.find("actuator")
        self._actuators = [] if section is None else list(section)
        self._inertials = {
            body.get("name")
            for body in root.iter("body")
            if body.find("inertial") is not None
        }

    def actuator(self, name: str, index: int) -> str:
        """The tag of an actuator."""
        for element in self._actuators:
            if name and element.get("name") == name:
                return element.tag
        return self._actuators[index].tag if index < len(self._actuators) else "general"

    def states_inertia(self, body: str) -> bool:
        """Whether a body has an <inertial>."""
        return body in self._inertials


def edits(
    source: Source, plant: Plant, terms: Sequence[Term], values: Floats
) -> list[Edit]:
    """What to change in the text so that the terms are true, as far as MuJoCo can."""
    model = plant.variant(terms, values)
    found: list[Edit] = []
    for term, part in zip(terms, parts(terms, values), strict=True):
        if does(term.effect, "changes"):
            for place in term.places:
                found += (
                    term.effect.changes(plant.model, plant.place(place), part) or []
                )
    found = [
        *found,
        *_of_joints(source, plant.model, model),
        *_of_actuators(source, plant.model, model, found),
        *_of_bodies(source, plant.model, model),
        *_of_geoms(plant.model, model),
        *_of_option(plant.model, model),
    ]
    return found


def native(term: Term) -> bool:
    """Whether plain MuJoCo can do all that an effect does."""
    ways = ("command", "act", "measure")
    return does(term.effect, "changes") or not any(does(term.effect, w) for w in ways)


def _differs(a, b) -> bool:
    a, b = np.asarray(a, float), np.asarray(b, float)
    return bool((np.abs(a - b) > 1e-9 * (1e-6 + np.abs(a) + np.abs(b))).any())


def _name(thing, index: int):
    return thing(index).name or int(index)


def _of_joints(source: Source, old, new) -> Iterator[Edit]:
    for j in range(new.njnt):
        name = old.joint(j).name
        if new.jnt_type[j] not in (2, 3) or name.endswith(("_play", "_flex")):
            continue
        v, q = int(new.jnt_dofadr[j]), int(new.jnt_qposadr[j])
        told: dict[str, str | None] = {}
        damping = [
            np.append(m.dof_damping[v], m.dof_dampingpoly[v]) for m in (old, new)
        ]
        if _differs(*damping):
            used = np.flatnonzero(damping[1])
            told["damping"] = number(damping[1][: (used[-1] if used.size else 0) + 1])
        for field, attribute in (("dof_frictionloss", "frictionloss"),
                                 ("dof_armature", "armature")):  # fmt: skip
            if _differs(getattr(old, field)[v], getattr(new, field)[v]):
                told[attribute] = number(getattr(new, field)[v])
        if _differs(old.jnt_stiffness[j], new.jnt_stiffness[j]):
            told["stiffness"] = number(new.jnt_stiffness[j])
        turn = source.degree and new.jnt_type[j] == 3
        if _differs(old.qpos_spring[q], new.qpos_spring[q]):
            told["springref"] = number(_angle(new.qpos_spring[q], turn))
        if _differs(old.jnt_range[j], new.jnt_range[j]):
            told["range"] = number(_angle(new.jnt_range[j], turn))
            told["limited"] = "true"
        if told:
            yield Set("joint", _name(old.joint, j), told)


def _angle(value, degree: bool):
    return np.rad2deg(value) if degree else value


def _of_actuators(source: Source, old, new, before: Sequence[Edit]) -> Iterator[Edit]:
    general = {e.name for e in before if isinstance(e, Rename)}
    for a in range(new.nu):
        told: dict[str, str | None] = {}
        law = [
            np.concatenate([m.actuator_gainprm[a, :3], m.actuator_biasprm[a, :3]])
            for m in (old, new)
        ]
        tag = source.actuator(old.actuator(a).name, a)
        tag = "general" if _name(old.actuator, a) in general else tag
        if _differs(*law):
            told |= _law(tag, new, a)
        if _differs(old.actuator_dynprm[a, 0], new.actuator_dynprm[a, 0]):
            attribute = "dynprm" if tag == "general" else "timeconst"
            told[attribute] = number(new.actuator_dynprm[a, 0])
        limits = [
            (m.actuator_forcelimited[a], *m.actuator_forcerange[a]) for m in (old, new)
        ]
        if _differs(*limits):
            told["forcelimited"] = "true"
            told["forcerange"] = number(new.actuator_forcerange[a])
        if not told:
            continue
        if "gainprm" in told and tag != "general":
            yield Rename("actuator", _name(old.actuator, a), "general", told)
        else:
            yield Set("actuator", _name(old.actuator, a), told)


def _law(tag: str, model, a: int) -> dict[str, str | None]:
    gain, bias = model.actuator_gainprm[a, :3], model.actuator_biasprm[a, :3]
    if tag == "position":
        return {"kp": number(gain[0]), "kv": number(-bias[2]), "dampratio": None}
    if tag == "velocity":
        return {"kv": number(gain[0])}
    told: dict[str, str | None] = {"gainprm": number(gain), "biasprm": number(bias)}
    if tag != "general":
        told["biastype"] = "affine" if bias.any() else "none"
    return told


def _of_bodies(source: Source, old, new) -> Iterator[Edit]:
    for b in range(1, new.nbody):
        name = _name(old.body, b)
        if _differs(old.body_pos[b], new.body_pos[b]):
            yield Set("body", name, {"pos": number(new.body_pos[b])})
        fields = ("body_mass", "body_ipos", "body_inertia", "body_iquat")
        if not any(_differs(getattr(old, f)[b], getattr(new, f)[b]) for f in fields):
            continue
        told = {
            "pos": number(new.body_ipos[b]),
            "quat": number(new.body_iquat[b]),
            "mass": number(new.body_mass[b]),
            "diaginertia": number(new.body_inertia[b]),
        }
        if source.states_inertia(str(name)):
            gone = dict.fromkeys(
                ("fullinertia", "axisangle", "xyaxes", "zaxis", "euler")
            )
            yield Set("inertial", name, {**gone, **told})
        else:
            xml = " ".join(f'{k}="{v}"' for k, v in told.items())
            yield Insert("body", name, f"<inertial {xml}/>", first=True)


def _of_geoms(old, new) -> Iterator[Edit]:
    for g in range(new.ngeom):
        told: dict[str, str | None] = {}
        moved = _differs(old.geom_pos[g], new.geom_pos[g])
        if moved or _differs(old.geom_size[g], new.geom_size[g]):
            if new.geom_dataid[g] < 0:  # a mesh keeps its size
                told |= {
                    "fromto": None,
                    "pos": number(new.geom_pos[g]),
                    "quat": number(new.geom_quat[g]),
                    "size": number(new.geom_size[g]),
                }
        for field, attribute in (
            ("geom_friction", "friction"), ("geom_solref", "solref"),
            ("geom_priority", "priority"), ("geom_contype", "contype"),
            ("geom_conaffinity", "conaffinity"),
        ):  # fmt: skip
            if _differs(getattr(old, field)[g], getattr(new, field)[g]):
                told[attribute] = number(getattr(new, field)[g])
        if told:
            yield Set("geom", _name(old.geom, g), told)
    for s in range(new.nsite):
        if _differs(old.site_pos[s], new.site_pos[s]):
            pos = {"fromto": None, "pos": number(new.site_pos[s])}
            yield Set("site", _name(old.site, s), pos)


def _of_option(old, new) -> Iterator[Edit]:
    told: dict[str, str | None] = {
        field: number(getattr(new.opt, field))
        for field in ("gravity", "density", "viscosity", "wind")
        if _differs(getattr(old.opt, field), getattr(new.opt, field))
    }
    if told:
        yield Set("option", "", told)
