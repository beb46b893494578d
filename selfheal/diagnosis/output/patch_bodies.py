"""Changed bodies, geoms and sites as edits of text: takes two models, gives edits."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ...mjcf.edit import Edit, Insert, Set, format_number
from ...recording.data import Floats
from ..effects.inertia import spatial_inertia
from .model_source import ModelSource, differs, name_or_id

if TYPE_CHECKING:
    from mujoco import MjModel

# MJCF's other ways to state an orientation, which `quat` takes the place of
TURNED = dict.fromkeys(("axisangle", "xyaxes", "zaxis", "euler"))
# share of the largest moment below which a product of inertia is rounding; chosen
MIN_PRODUCT_SHARE = 1e-7
SIZES = {2: 1, 3: 2, 5: 2}  # numbers of a size: mjtGeom sphere, capsule, cylinder
# which number of a size is half of what `fromto` says; 2 of ellipsoids and boxes
HALF_LENGTHS = {3: 1, 5: 1}
ROUNDING = 1e-12  # share of a vector's largest number below which one is rounding


def edit_bodies(source: ModelSource, old: "MjModel", new: "MjModel") -> Iterator[Edit]:
    """Edits of the bodies whose place, mass, inertia or carried weight differs.

    Args:
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
        for b in range(new.nbody):  # what they stated did not count so far
            changed[b] |= source.scales_masses or source.states_inertia(b)
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


def _edit_inertial(
    source: ModelSource, name: str | int, new: "MjModel", body: int
) -> Edit:
    """The edit that gives a body's text the mass and inertia of the new model."""
    place, turn = (_drop_rounding(v[body]) for v in (new.body_ipos, new.body_iquat))
    if not source.states_inertia(body):
        attributes = {"pos": place, "quat": turn, "mass": new.body_mass[body],
                      "diaginertia": new.body_inertia[body]}  # fmt: skip
        xml = " ".join(f'{k}="{format_number(v)}"' for k, v in attributes.items())
        return Insert("body", name, f"<inertial {xml}/>", first=True)
    element = source.spec.bodies[body]
    changes: dict[str, str | None] = {}
    if differs(element.ipos, place):
        changes["pos"] = format_number(place)
    if differs(element.mass, new.body_mass[body]):
        changes["mass"] = format_number(new.body_mass[body])
    return Set("inertial", name, changes | _edit_moments(source, element, new, body))


def _edit_moments(
    source: ModelSource, element: Any, new: "MjModel", body: int
) -> dict[str, str | None]:
    """Attributes of a stated inertia's moments, in the form that the text has."""
    if np.isfinite(element.fullinertia[0]):
        tensor = spatial_inertia(new, body)
        full = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        close = MIN_PRODUCT_SHARE * full.max()
        if np.abs(full - element.fullinertia).max() <= close:
            return {}
        return {"fullinertia": format_number(_drop_rounding(full))}
    moments = _stated_axes_inertia(source, element, new, body)
    if moments is None:
        quat = _drop_rounding(new.body_iquat[body])
        inertia = format_number(new.body_inertia[body])
        return {**TURNED, "quat": format_number(quat), "diaginertia": inertia}
    if not differs(element.inertia, moments):
        return {}
    return {"diaginertia": format_number(moments)}


def _stated_axes_inertia(
    source: ModelSource, element: Any, new: "MjModel", body: int
) -> Floats | None:
    """Principal moments (3) [kg m^2] about the axes that the text states.

    Returns:
        None where the principal axes are others now.
    """
    import mujoco

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
        old: (3) its compiled position before [m].
        new: (3) its compiled position after [m].
    """
    return _format_moved(element.pos, _turn_into_frame(source, element, new - old))


def _moved_ends(
    source: ModelSource, element: Any, moved: Floats, grown: float
) -> dict[str, str | None]:
    """The `fromto` of an element that has moved in its body.

    Args:
        moved: (3) the way of its middle, in the axes of the body [m].
        grown: its new length over the old one.
    """
    way, ends = _turn_into_frame(source, element, moved), np.array(element.fromto)
    half = (grown - 1) / 2 * (ends[3:] - ends[:3])
    return {"fromto": _format_moved(ends, np.concatenate([way - half, way + half]))}


def _turn_into_frame(source: ModelSource, element: Any, way: Floats) -> Floats:
    """A way (3) in the axes of a body [m], in those of the <frame>s in it."""
    import mujoco

    _, turn = source.resolve_frame(element)
    back, turned = np.empty(4), np.empty(3)
    mujoco.mju_negQuat(back, turn)
    mujoco.mju_rotVecQuat(turned, way, back)
    return turned


def _format_moved(given: Any, way: Floats) -> str:
    """Numbers (N) of a text after a way (N), each as given where it has not moved."""
    return format_number(np.array(given) + _drop_rounding(way))


def _drop_rounding(vector: Floats) -> Floats:
    """A vector (N) with zeros for what is nothing but rounding beside its largest."""
    size = np.abs(vector)
    return np.where(size > ROUNDING * size.max(), vector, 0.0)


def _edit_span(
    source: ModelSource, element: Any, kind: int, moved: Floats, sizes: list[Floats]
) -> dict[str, str | None]:
    """Attributes of a geom or site that is stated by `fromto` and differs.

    Args:
        moved: (3) the way of its middle, in the axes of the body [m].
        sizes: (3) before and after [m].
    """
    half = HALF_LENGTHS.get(kind, 2)
    old, new = sizes
    attributes = {}
    if moved.any() or differs(old[half], new[half]):
        attributes = _moved_ends(source, element, moved, new[half] / old[half])
    if differs(old[:half], new[:half]):
        attributes["size"] = format_number(new[:half])
    return attributes


def edit_geoms(source: ModelSource, old: "MjModel", new: "MjModel") -> Iterator[Edit]:
    """Edits of the geoms that differ between two models.

    Args:
        old: compiled, as the text states it.
        new: compiled, as the text is to be.
    """
    for g in range(new.ngeom):
        attributes: dict[str, str | None] = {}
        element = source.spec.geoms[g]
        moved = differs(old.geom_pos[g], new.geom_pos[g])
        grown = differs(old.geom_size[g], new.geom_size[g])
        if np.isfinite(element.fromto[0]) and (moved or grown):
            way = new.geom_pos[g] - old.geom_pos[g] if moved else np.zeros(3)
            sizes = [m.geom_size[g] for m in (old, new)]
            attributes |= _edit_span(source, element, int(new.geom_type[g]), way, sizes)
        elif moved:
            attributes["pos"] = _moved_position(
                source, element, old.geom_pos[g], new.geom_pos[g]
            )
        # a mesh keeps its size
        if grown and old.geom_dataid[g] < 0 and "fromto" not in attributes:
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


def _format_size(model: "MjModel", geom: int) -> str:
    """The `size` of a geom, with as many numbers as its type has."""
    count = SIZES.get(int(model.geom_type[geom]), 3)
    return format_number(model.geom_size[geom, :count])


def edit_sites(source: ModelSource, old: "MjModel", new: "MjModel") -> Iterator[Edit]:
    """Edits of the sites that have moved between two models.

    Args:
        old: compiled, as the text states it.
        new: compiled, as the text is to be.
    """
    for s in range(new.nsite):
        if not differs(old.site_pos[s], new.site_pos[s]):
            continue
        element = source.spec.sites[s]
        if np.isfinite(element.fromto[0]):
            way = new.site_pos[s] - old.site_pos[s]
            attributes = _moved_ends(source, element, way, 1.0)
        else:
            pos = _moved_position(source, element, old.site_pos[s], new.site_pos[s])
            attributes = {"pos": pos}
        yield Set("site", name_or_id(old.site, s), attributes)
