"""A patch of a URDF: takes two models, gives the user's text with little changed."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

import numpy as np

from ...errors import ModelError
from ...mjcf.document import MjcfDocument, is_urdf
from ...mjcf.edit import format_number, unified_diff
from ...mjcf.xml_text import Element, encode_text, format_path
from ...mujoco_files import read_spec_file
from ...preparation.prepare import SOURCE
from ...recording.data import Floats
from ..effects.inertia import point_inertia, rotation_matrix, spatial_inertia
from .actuators import describe_joints
from .model_source import differs

if TYPE_CHECKING:
    import mujoco
    from numpy.typing import ArrayLike

# fields of a compiled model and what a user calls them, for what URDF cannot hold
_JOINT_FIELDS = {
    "dof_damping": "damping",
    "dof_dampingpoly": "damping of higher order",
    "dof_frictionloss": "dry friction",
    "dof_armature": "armature",
    "jnt_stiffness": "stiffness",
    "jnt_range": "range",
}
_BODY_FIELDS = {
    "body_mass": "mass",
    "body_ipos": "center of mass",
    "body_pos": "place",
    "body_gravcomp": "carried weight",
}
_DYNAMICS = {"damping": "dof_damping", "friction": "dof_frictionloss"}  # of <dynamics>
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")  # of <inertia>
_GEOM_FIELDS = ("size", "pos", "friction", "solref", "contype")
_WORLD_FIELDS = ("gravity", "density", "viscosity", "wind")
_RELATIVE = 1e-5  # by which values differ that are one; of the digits of two texts


def find_urdf(model: str | os.PathLike[str]) -> str | None:
    """Path of the URDF that a model is, or was prepared from; None: it has none."""
    if is_urdf(model):
        return os.fspath(model)
    document = MjcfDocument(model, in_place=False)
    for text in (e for s in document.list_sections("custom") for e in s.elements()):
        if text.get("name") == SOURCE:
            path = os.path.join(document.home, text.get_path("data"))
            return path if os.path.isfile(path) else None
    return None


def explain_urdf(
    path: str | os.PathLike[str], given: "mujoco.MjModel", patched: "mujoco.MjModel"
) -> list[str]:
    """What a user should know of the patched URDF.

    Args:
        given: the MJCF that MuJoCo makes of it, compiled.
        patched: the MJCF with all changes, compiled.
    """
    try:
        left = UrdfPatch(path, given, patched).left
    except ModelError as error:
        return [f"There is no patched.urdf. {error}"]
    held = "patched.urdf cannot hold what patched.xml has: {}."
    return [held.format(left)] if left else []


class UrdfPatch:
    """A URDF in which what it can hold is as in a patched model.

    Attributes:
        diff: unified, of the given text to the patched one, beside each other.
        left: what URDF cannot hold, in words; empty: it holds all.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        given: "mujoco.MjModel",
        patched: "mujoco.MjModel",
    ) -> None:
        """Edit the text of a URDF.

        Args:
            given: the MJCF that MuJoCo makes of it, compiled.
            patched: the MJCF with all changes, compiled.
        """
        self._document = document = MjcfDocument(path, in_place=True)
        (name, text), *_ = document.list_texts().items()
        self._given, self._patched = given, patched
        self._joint_values = [describe_joints(model) for model in (given, patched)]
        elements = list(document.root.elements())
        self._joints = [e for e in elements if e.tag == "joint"]
        for joint in self._joints:
            self._edit_joint(joint)
        for link in [e for e in elements if e.tag == "link"]:
            self._edit_link(link)
        new = document.file.to_text()
        self.diff = unified_diff(text, new, name)
        self.left = "; ".join(_list_differences(_compile_urdf(path, new), patched))

    def to_text(self, folder: Path) -> str:
        """The text, with meshes found from a folder; nothing can be edited after it."""
        home, document = self._document.home, self._document
        compilers = [e for e in document.root.walk() if e.tag == "compiler"]
        meshes = [e for e in document.root.walk() if e.tag == "mesh"]
        held = [
            c for c in compilers if c.get("meshdir") or c.get("strippath") == "true"
        ]
        for element in held:
            path = os.path.join(home, element.get_path("meshdir"))
            element.set({"meshdir": format_path(os.path.relpath(path, folder))})
        for mesh in meshes if not held else ():
            name = mesh.get_path("filename")
            if name and "://" not in name:
                path = os.path.relpath(os.path.join(home, name), folder)
                mesh.set({"filename": format_path(path)})
        return document.file.to_text()

    def _edit_joint(self, element: Element) -> None:
        """Edit the dynamics, the limits and the place of a joint."""
        name = element.get("name") or ""
        old, new = self._given, self._patched
        try:
            a, b = old.joint(name), new.joint(name)
        except KeyError:
            return  # it is fixed
        dof, new_dof = old.jnt_dofadr[a.id], new.jnt_dofadr[b.id]
        dynamics = {
            attribute: format_number(getattr(new, field)[new_dof])
            for attribute, field in _DYNAMICS.items()
            if differs(getattr(old, field)[dof], getattr(new, field)[new_dof])
        }
        self._set_child(element, "dynamics", dynamics)
        limits: dict[str, str] = {}
        if differs(a.range, b.range) and element.get("type") != "continuous":
            limits = {"lower": format_number(b.range[0])}
            limits["upper"] = format_number(b.range[1])
        efforts = [e[name].get("effort_limit", 0.0) for e in self._joint_values]
        if differs(*efforts) and efforts[1]:
            limits["effort"] = format_number(efforts[1])
        self._set_child(element, "limit", limits)
        self._move_child(element, int(old.jnt_bodyid[a.id]), int(new.jnt_bodyid[b.id]))

    def _move_child(self, element: Element, old_body: int, new_body: int) -> None:
        """Edit where a joint's child is attached, if its parent link is a body."""
        old, new = self._given, self._patched
        parents = [e.get("link") for e in element.elements() if e.tag == "parent"]
        above = old.body(int(old.body_parentid[old_body])).name
        shift = new.body_pos[new_body] - old.body_pos[old_body]
        if parents == [above] and differs(shift, np.zeros(3)):
            origin = _find_child(element, "origin")
            at = _read_numbers(origin, "xyz")
            self._set_child(element, "origin", {"xyz": format_number(at + shift)})

    def _edit_link(self, element: Element) -> None:
        """Edit the inertia of a link by what its body's has changed.

        Links at fixed joints are one body with it.
        """
        name = element.get("name") or ""
        inertial = _find_child(element, "inertial")
        try:
            bodies = self._given.body(name).id, self._patched.body(name).id
        except KeyError:
            return
        models = (self._given, self._patched)
        old, new = (_sum_moments(m, b) for m, b in zip(models, bodies, strict=True))
        if inertial is None or not differs(old, new):
            return
        own = _read_moments(inertial)
        turn = _rotate(_read_numbers(_find_child(inertial, "origin"), "rpy"))
        changed = own + new - old
        mass, first, second = changed[0], changed[1:4], changed[4:].reshape(3, 3)
        com = first / mass
        inertia = turn.T @ (second - point_inertia(mass, com)) @ turn
        inertia = np.where(np.abs(inertia) > 1e-9 * np.abs(inertia).max(), inertia, 0.0)
        numbers = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        self._set_child(inertial, "mass", {"value": format_number(mass)})
        if differs(com, own[1:4] / own[0]):
            self._set_child(inertial, "origin", {"xyz": format_number(com)})
        moments = dict(zip(_MOMENTS, map(format_number, numbers), strict=True))
        self._set_child(inertial, "inertia", moments)

    def _set_child(self, element: Element, tag: str, values: dict[str, str]) -> None:
        """Set attributes of an element's child, which is made where it is missing.

        Args:
            values: of its attributes; without any nothing is made.
        """
        if not values:
            return
        child = _find_child(element, tag)
        if child is None:
            child = self._document.insert(element, f"<{tag}/>", first=False)
        child.set(values)


def _find_child(element: Element, tag: str) -> Element | None:
    """The first child with a tag."""
    return next((e for e in element.elements() if e.tag == tag), None)


def _read_numbers(element: Element | None, name: str) -> Floats:
    """Three numbers (3) of an attribute; zeros without it [m or rad]."""
    text = element.get(name) if element else None
    return np.array([float(x) for x in text.split()]) if text else np.zeros(3)


def _rotate(rpy: Floats) -> Floats:
    """The matrix (3, 3) of roll, pitch and yaw (3) [rad] about fixed axes."""
    import mujoco

    quat = np.empty(4)
    mujoco.mju_euler2Quat(quat, rpy, "XYZ")
    return rotation_matrix(quat)


def _read_moments(element: Element) -> Floats:
    """Moments (13) of a link about its origin, as `_sum_moments`, from its text."""
    mass_of, moments = (_find_child(element, tag) for tag in ("mass", "inertia"))
    origin = _find_child(element, "origin")
    mass = float((mass_of and mass_of.get("value")) or 0)
    com, turn = _read_numbers(origin, "xyz"), _rotate(_read_numbers(origin, "rpy"))
    numbers = [float((moments and moments.get(name)) or 0) for name in _MOMENTS]
    tensor = np.array(numbers)[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    about = turn @ tensor @ turn.T + point_inertia(mass, com)
    return np.concatenate([[mass], mass * com, about.ravel()])


def _sum_moments(model: "mujoco.MjModel", body: int) -> Floats:
    """Moments (13) of a body about its origin: mass [kg], first [kg m], inertia."""
    mass, com = float(model.body_mass[body]), model.body_ipos[body]
    about = spatial_inertia(model, body) + point_inertia(mass, com)
    return np.concatenate([[mass], mass * com, about.ravel()])


def _compile_urdf(path: str | os.PathLike[str], text: str) -> "mujoco.MjModel":
    """What MuJoCo makes of a URDF's changed text, beside the given one."""
    beside = os.path.join(os.path.dirname(os.path.abspath(path)), f"{uuid4().hex}.urdf")
    try:
        return read_spec_file(beside, include={beside: encode_text(text)}).compile()
    except ValueError as error:
        raise ModelError(f"MuJoCo refuses the patched URDF: {error}") from error


def _list_differences(
    urdf: "mujoco.MjModel", patched: "mujoco.MjModel"
) -> Iterator[str]:
    """What a URDF says otherwise than the patched model, in words."""
    models = urdf, patched
    joints = _pair_ids(urdf, patched, "joint", urdf.njnt)
    limits = [describe_joints(model) for model in models]
    efforts = {n: [x[n].get("effort_limit", 0.0) for x in limits] for n in limits[0]}
    if weaker := [n for n, pair in efforts.items() if _is_far(*pair)]:
        yield f"effort limit of {', '.join(weaker)}"
    dofs = {
        name: (int(urdf.jnt_dofadr[a]), int(patched.jnt_dofadr[b]))
        for name, (a, b) in joints.items()
    }
    bodies = _pair_ids(urdf, patched, "body", urdf.nbody)
    for field, said in (_JOINT_FIELDS | _BODY_FIELDS).items():
        pairs = {"dof": dofs, "jnt": joints, "body": bodies}[field.partition("_")[0]]
        old, new = (getattr(model, field) for model in models)
        if far := [n for n, (a, b) in pairs.items() if _is_far(old[a], new[b])]:
            yield f"{said} of {', '.join(far)}"
    if turned := [
        name
        for name, (a, b) in bodies.items()
        if _is_far(spatial_inertia(urdf, a), spatial_inertia(patched, b))
    ]:
        yield f"inertia of {', '.join(turned)}"
    names = [patched.joint(j).name for j in range(patched.njnt)]
    if added := [name for name in names if name not in joints]:
        yield f"joints {', '.join(added)}"
    if urdf.ngeom == patched.ngeom and any(
        _is_far(getattr(urdf, f"geom_{f}"), getattr(patched, f"geom_{f}"))
        for f in _GEOM_FIELDS
    ):
        yield "shapes that touch"
    for field in _WORLD_FIELDS:
        if _is_far(getattr(urdf.opt, field), getattr(patched.opt, field)):
            yield field


def _pair_ids(
    urdf: "mujoco.MjModel", patched: "mujoco.MjModel", kind: str, count: int
) -> dict[str, tuple[int, int]]:
    """Ids in both models of what has a name in the first one, by these.

    Args:
        kind: "joint" or "body".
        count: of them in the first model.
    """
    find, other = getattr(urdf, kind), getattr(patched, kind)
    return {n: (i, other(n).id) for i in range(count) if (n := find(i).name)}


def _is_far(one: "ArrayLike", other: "ArrayLike") -> bool:
    """Whether arrays of one shape differ by more than the digits of their texts."""
    a, b = np.asarray(one, float), np.asarray(other, float)
    size = max(np.abs(a).max(initial=0.0), np.abs(b).max(initial=0.0))
    return bool((np.abs(a - b) > _RELATIVE * size).any())
