"""Changed bodies, geoms and sites as edits of text: takes two models, gives edits."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ...mjcf.edit import Edit, Insert, Set, format_number
from ...recording.data import Floats
from ..effects.inertia import spatial_inertia
from .model_source import (
    Attributes,
    ModelSource,
    differs,
    edit_attributes,
    name_or_id,
)

if TYPE_CHECKING:
    from mujoco import MjModel, MjsBody, MjsGeom, MjsSite
    from numpy.typing import ArrayLike

    Shape: TypeAlias = MjsGeom | MjsSite
    Element: TypeAlias = MjsBody | Shape

# MJCF's other forms of an orientation, which `quat` replaces
TURNED = dict.fromkeys(("axisangle", "xyaxes", "zaxis", "euler"))
# share of the largest moment below which a product of inertia is rounding; chosen
MIN_PRODUCT_SHARE = 1e-7
SIZES = {2: 1, 3: 2, 5: 2}  # numbers of a size: mjtGeom sphere, capsule, cylinder
# which number of a size is half of what `fromto` says; 2 of ellipsoids and boxes
HALF_LENGTHS = {3: 1, 5: 1}
# attributes of a geom in contact, by fields
CONTACT = {
    f"geom_{name}": name
    for name in ("friction", "solref", "priority", "contype", "conaffinity")
}
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
        carried = edit_attributes(old, new, b, {"body_gravcomp": "gravcomp"})
        if carried:
            yield Set("body", name_or_id(old.body, b), carried)
        if changed[b]:
            yield _edit_inertial(source, name_or_id(old.body, b), new, b)


def _edit_inertial(
    source: ModelSource, name: str | int, new: "MjModel", body: int
) -> Edit:
    """The edit that gives a body's text the mass and inertia of the new model."""
    place, turn = (_drop_rounding(v[body]) for v in (new.body_ipos, new.body_iquat))
    if not source.states_inertia(body):
        values = place, turn, new.body_mass[body], new.body_inertia[body]
        names = "pos", "quat", "mass", "diaginertia"
        xml = " ".join(
            f'{name}="{format_number(value)}"'
            for name, value in zip(names, values, strict=True)
        )
        return Insert("body", name, f"<inertial {xml}/>", first=True)
    element = source.spec.bodies[body]
    changes: Attributes = {}
    if differs(element.ipos, place):
        changes["pos"] = format_number(place)
    if differs(element.mass, new.body_mass[body]):
        changes["mass"] = format_number(new.body_mass[body])
    return Set("inertial", name, changes | _edit_moments(source, element, new, body))


def _edit_moments(
    source: ModelSource, element: "MjsBody", new: "MjModel", body: int
) -> Attributes:
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
    source: ModelSource, element: "MjsBody", new: "MjModel", body: int
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


def _moved_position(
    source: ModelSource, element: "Element", old: Floats, new: Floats
) -> str:
    """The `pos` of an element that has moved in its body from a place (3) [m]."""
    return _format_moved(element.pos, _turn_into_frame(source, element, new - old))


def _moved_ends(
    source: ModelSource, element: "Shape", moved: Floats, grown: float
) -> Attributes:
    """The `fromto` of an element that has moved in its body.

    Args:
        moved: (3) the displacement of its middle, in the axes of the body [m].
        grown: its new length over the old one.
    """
    shift, ends = _turn_into_frame(source, element, moved), np.array(element.fromto)
    half = (grown - 1) / 2 * (ends[3:] - ends[:3])
    return {"fromto": _format_moved(ends, np.concatenate([shift - half, shift + half]))}


def _turn_into_frame(source: ModelSource, element: "Element", shift: Floats) -> Floats:
    """A displacement (3) [m] of a body's axes, in those of the <frame>s in it."""
    import mujoco

    _, turn = source.resolve_frame(element)
    back, turned = np.empty(4), np.empty(3)
    mujoco.mju_negQuat(back, turn)
    mujoco.mju_rotVecQuat(turned, shift, back)
    return turned


def _format_moved(given: "ArrayLike", shift: Floats) -> str:
    """Numbers (N) of a text after a shift (N), each as given where there is none."""
    return format_number(np.array(given) + _drop_rounding(shift))


def _drop_rounding(vector: Floats) -> Floats:
    """A vector (N) with zeros for what is nothing but rounding beside its largest."""
    size = np.abs(vector)
    return np.where(size > ROUNDING * size.max(), vector, 0.0)


def _edit_span(
    source: ModelSource, element: "Shape", kind: int, moved: Floats, sizes: list[Floats]
) -> Attributes:
    """Attributes of a geom that is stated by `fromto` and differs.

    Args:
        moved: (3) the displacement of its middle, in the axes of the body [m].
        sizes: (3) before and after [m].
    """
    half = HALF_LENGTHS.get(kind, 2)
    old, new = sizes
    attributes: Attributes = {}
    if moved.any() or differs(old[half], new[half]):
        attributes = _moved_ends(source, element, moved, new[half] / old[half])
    if differs(old[:half], new[:half]):
        attributes["size"] = format_number(new[:half])
    return attributes


def edit_geoms(source: ModelSource, old: "MjModel", new: "MjModel") -> Iterator[Edit]:
    """Edits of the geoms that differ between two models, as `edit_bodies`."""
    for g, element in enumerate(source.spec.geoms):
        attributes: Attributes = {}
        places = [m.geom_pos[g] for m in (old, new)]
        sizes = [m.geom_size[g] for m in (old, new)]
        moved, grown = differs(*places), differs(*sizes)
        if np.isfinite(element.fromto[0]) and (moved or grown):
            shift = places[1] - places[0] if moved else np.zeros(3)
            kind = int(new.geom_type[g])
            attributes |= _edit_span(source, element, kind, shift, sizes)
        elif moved:
            attributes["pos"] = _moved_position(source, element, *places)
        # a mesh keeps its size
        if grown and old.geom_dataid[g] < 0 and "fromto" not in attributes:
            attributes["size"] = _format_size(new, g)
        attributes |= edit_attributes(old, new, g, CONTACT)
        if attributes:
            yield Set("geom", name_or_id(old.geom, g), attributes)


def _format_size(model: "MjModel", geom: int) -> str:
    """The `size` of a geom, with as many numbers as its type has."""
    count = SIZES.get(int(model.geom_type[geom]), 3)
    return format_number(model.geom_size[geom, :count])


def edit_sites(source: ModelSource, old: "MjModel", new: "MjModel") -> Iterator[Edit]:
    """Edits of the sites that have moved between two models, as `edit_bodies`."""
    for s, element in enumerate(source.spec.sites):
        places = [m.site_pos[s] for m in (old, new)]
        if not differs(*places):
            continue
        if np.isfinite(element.fromto[0]):
            moved = _moved_ends(source, element, places[1] - places[0], 1.0)
        else:
            moved = {"pos": _moved_position(source, element, *places)}
        yield Set("site", name_or_id(old.site, s), moved)
