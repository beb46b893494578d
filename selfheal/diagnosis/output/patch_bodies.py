"""Changed bodies, geoms and sites as edits of text: takes two models, gives edits."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...mjcf.edit import Edit, Insert, Set, format_number
from ...recording.data import Floats
from .model_source import ModelSource, differs, name_or_id

# MJCF's other ways to state an orientation, which `quat` takes the place of
TURNED = dict.fromkeys(("axisangle", "xyaxes", "zaxis", "euler"))
# share of the largest moment below which a product of inertia is rounding; chosen
MIN_PRODUCT_SHARE = 1e-7
SIZES = {2: 1, 3: 2, 5: 2}  # numbers of a size: mjtGeom sphere, capsule, cylinder


def edit_bodies(source: ModelSource, old, new) -> Iterator[Edit]:
    """Edits of the bodies whose place, mass, inertia or carried weight differs.

    Args:
        source: what the text states.
        old: compiled, as the text states it.
        new: compiled, as the text is to be.
    """
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
        if differs(old.body_pos[b], new.body_pos[b]):
            element = source.spec.bodies[b]
            pos = _moved_position(source, element, old.body_pos[b], new.body_pos[b])
            yield Set("body", name_or_id(old.body, b), {"pos": pos})
        if differs(old.body_gravcomp[b], new.body_gravcomp[b]):
            gravcomp = format_number(new.body_gravcomp[b])
            yield Set("body", name_or_id(old.body, b), {"gravcomp": gravcomp})
        if changed[b]:
            yield _edit_inertial(source, name_or_id(old.body, b), new, b)


def _edit_inertial(source: ModelSource, name: str | int, new, body: int) -> Edit:
    """The edit that gives a body's text the mass and inertia of the new model.

    Args:
        source: what the text states.
        name: of the body in the text.
        new: compiled, as the text is to be.
        body: its id.
    """
    attributes: dict[str, str | None] = {
        "pos": format_number(new.body_ipos[body]),
        "quat": format_number(new.body_iquat[body]),
        "mass": format_number(new.body_mass[body]),
        "diaginertia": format_number(new.body_inertia[body]),
    }
    if not source.states_inertia(str(name)):
        xml = " ".join(f'{k}="{v}"' for k, v in attributes.items())
        return Insert("body", name, f"<inertial {xml}/>", first=True)
    moments = _stated_axes_inertia(source, source.spec.bodies[body], new, body)
    if moments is None:
        attributes |= {"fullinertia": None, **TURNED}
    else:
        attributes |= {"diaginertia": format_number(moments)}
        del attributes["quat"]
    return Set("inertial", name, attributes)


def _stated_axes_inertia(
    source: ModelSource, element: Any, new, body: int
) -> Floats | None:
    """Principal moments (3) [kg m^2] about the axes that the text states.

    Args:
        source: what the text states.
        element: of the body in the spec.
        new: compiled, as the text is to be.
        body: its id.

    Returns:
        None where the principal axes are others now.
    """
    import mujoco

    if np.isfinite(element.fullinertia[0]):
        return None
    now, given = np.empty(9), np.empty(9)
    mujoco.mju_quat2Mat(now, new.body_iquat[body])
    mujoco.mju_quat2Mat(given, source.resolve_orientation(element.iquat, element.ialt))
    turn = given.reshape(3, 3).T @ now.reshape(3, 3)
    tensor = turn @ np.diag(new.body_inertia[body]) @ turn.T
    moments = np.diag(tensor)
    apart = np.abs(tensor - np.diag(moments)).max()
    return moments if apart < MIN_PRODUCT_SHARE * moments.max() else None


def _moved_position(source: ModelSource, element: Any, old: Floats, new: Floats) -> str:
    """The `pos` of an element that has moved in its body.

    Args:
        source: what the text states.
        element: of the spec.
        old: (3) its compiled position before [m].
        new: (3) its compiled position after [m].
    """
    import mujoco

    _, turn = source.resolve_frame(element)
    back, way = np.empty(4), np.empty(3)
    mujoco.mju_negQuat(back, turn)
    mujoco.mju_rotVecQuat(way, new - old, back)
    return format_number(element.pos + way)


def _placed_attributes(
    source: ModelSource, element: Any, pos: Floats, quat: Floats
) -> dict[str, str | None]:
    """The `pos` and `quat` of an element, in the place of its `fromto`.

    Args:
        source: what the text states.
        element: of the spec.
        pos: (3) its position in its body [m].
        quat: (4) its orientation in its body.
    """
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
    """Edits of the geoms that differ between two models.

    Args:
        source: what the text states.
        old: compiled, as the text states it.
        new: compiled, as the text is to be.
    """
    for g in range(new.ngeom):
        attributes: dict[str, str | None] = {}
        element = source.spec.geoms[g]
        moved = differs(old.geom_pos[g], new.geom_pos[g])
        grown = differs(old.geom_size[g], new.geom_size[g])
        if (moved or grown) and np.isfinite(element.fromto[0]):
            attributes |= _placed_attributes(
                source, element, new.geom_pos[g], new.geom_quat[g]
            )
            attributes["size"] = _format_size(new, g)
        elif moved:
            attributes["pos"] = _moved_position(
                source, element, old.geom_pos[g], new.geom_pos[g]
            )
        if grown and old.geom_dataid[g] < 0:  # a mesh keeps its size
            attributes["size"] = _format_size(new, g)
        for field, attribute in (
            ("geom_friction", "friction"), ("geom_solref", "solref"),
            ("geom_priority", "priority"), ("geom_contype", "contype"),
            ("geom_conaffinity", "conaffinity"),
        ):  # fmt: skip
            if differs(getattr(old, field)[g], getattr(new, field)[g]):
                attributes[attribute] = format_number(getattr(new, field)[g])
        if attributes:
            yield Set("geom", name_or_id(old.geom, g), attributes)


def _format_size(model, geom: int) -> str:
    """The `size` of a geom, with as many numbers as its type has."""
    count = SIZES.get(int(model.geom_type[geom]), 3)
    return format_number(model.geom_size[geom, :count])


def edit_sites(source: ModelSource, old, new) -> Iterator[Edit]:
    """Edits of the sites that have moved between two models.

    Args:
        source: what the text states.
        old: compiled, as the text states it.
        new: compiled, as the text is to be.
    """
    for s in range(new.nsite):
        if not differs(old.site_pos[s], new.site_pos[s]):
            continue
        element = source.spec.sites[s]
        if np.isfinite(element.fromto[0]):
            attributes = _placed_attributes(
                source, element, new.site_pos[s], new.site_quat[s]
            )
            attributes["size"] = format_number(new.site_size[s])
        else:
            pos = _moved_position(source, element, old.site_pos[s], new.site_pos[s])
            attributes = {"pos": pos}
        yield Set("site", name_or_id(old.site, s), attributes)
