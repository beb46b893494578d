"""Changed bodies, geoms and sites as edits of text: takes two models, gives attributes."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...mjcf.edit import Edit, Insert, Set, format_number
from ...recording.data import Floats
from .model_source import ModelSource, differs, name_or_id

# MJCF's other ways to state an orientation, which `quat` takes the place of
TURNED = dict.fromkeys(("axisangle", "xyaxes", "zaxis", "euler"))


def edit_bodies(source: ModelSource, old, new) -> Iterator[Edit]:
    fields = ("body_mass", "body_ipos", "body_inertia", "body_iquat")
    changed = [
        any(differs(getattr(old, f)[b], getattr(new, f)[b]) for f in fields)
        for b in range(new.nbody)
    ]
    if source.overrides_masses and any(changed):
        compiler = {"inertiafromgeom": "auto", "settotalmass": None}
        yield Set("compiler", "", compiler)
        changed = [True] * new.nbody  # what they stated did not count so far
    for b in range(1, new.nbody):
        name = name_or_id(old.body, b)
        if differs(old.body_pos[b], new.body_pos[b]):
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


def edit_geoms(source: ModelSource, old, new) -> Iterator[Edit]:
    for g in range(new.ngeom):
        predicted: dict[str, str | None] = {}
        element = source.spec.geoms[g]
        moved = differs(old.geom_pos[g], new.geom_pos[g])
        grown = differs(old.geom_size[g], new.geom_size[g])
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
            if differs(getattr(old, field)[g], getattr(new, field)[g]):
                predicted[attribute] = format_number(getattr(new, field)[g])
        if predicted:
            yield Set("geom", name_or_id(old.geom, g), predicted)


def _format_size(model, geom: int) -> str:
    """As many numbers as the geom's type has."""
    used = {2: 1, 3: 2, 5: 2}  # mjtGeom: sphere, capsule, cylinder
    return format_number(
        model.geom_size[geom, : used.get(int(model.geom_type[geom]), 3)]
    )


def edit_sites(source: ModelSource, old, new) -> Iterator[Edit]:
    for s in range(new.nsite):
        if not differs(old.site_pos[s], new.site_pos[s]):
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
        yield Set("site", name_or_id(old.site, s), predicted)
