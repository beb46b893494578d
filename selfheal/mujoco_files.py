"""MuJoCo's readers of model files, and its own messages kept from a user's screen.

A mesh that is only seen is no reason to refuse a model: where MuJoCo cannot read one,
the model is read without any of them.
"""

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from .errors import ModelError

if TYPE_CHECKING:
    import mujoco

_READABLE_MESHES = (".stl", ".obj", ".msh")  # MuJoCo's documentation, asset/mesh
_PACKAGE = "package://"  # ROS: followed by the package's name and the path in it


def silence_mujoco() -> None:
    """Keep MuJoCo from writing MUJOCO_LOG.TXT here; what diverged shows as NaN."""
    import mujoco

    mujoco.set_mju_user_warning(lambda message: None)


def refuse_xacro(path: str | os.PathLike[str]) -> None:
    """Refuse a URDF whose macros have not been expanded.

    Raises:
        ModelError: it is one; the message says how to expand it.
    """
    name = os.fspath(path)
    try:
        text = Path(name).read_bytes()
    except OSError:
        return  # who reads it says so
    markup = re.sub(rb"<!--.*?-->", b"", text, flags=re.DOTALL)
    if name.endswith(".xacro") or re.search(rb"<xacro:\w", markup):
        made = re.sub(r"(\.urdf)?(\.xacro|\.urdf|\.xml)$", "", os.path.basename(name))
        made += ".urdf" if made + ".urdf" != os.path.basename(name) else "_plain.urdf"
        raise ModelError(
            f"{name} holds macros of xacro, which no simulator reads; run xacro first: "
            f"xacro {name} > {made}"
        )


def explain_mesh(reason: str) -> str:
    """How to correct a mesh for which MuJoCo refuses a model; "" of other reasons."""
    if "package:/" in reason:
        return (
            ", which contact or inertia needs; would fit: the package's folder "
            'beside or above the model, or <mujoco><compiler strippath="true" '
            'meshdir="..."/></mujoco> in the URDF, with the folder of its meshes'
        )
    if re.search(r" file '[^']*\.(stl|obj|msh|dae)'", reason, re.IGNORECASE):
        return (
            ", which contact or inertia needs; would fit: that mesh as .stl, .obj or "
            '.msh, or an <inertial> in its body and a geom of contype="0" '
            'conaffinity="0"'
        )
    return ""


def read_spec_file(
    path: str | os.PathLike[str], include: Mapping[str, bytes] | None = None
) -> "mujoco.MjSpec":
    """MuJoCo's mujoco.MjSpec of an MJCF or URDF file.

    Without meshes that are only seen, where MuJoCo cannot read one of them.

    Args:
        path: ends in .xml or .urdf.
        include: contents of files that are not on disk, by their paths.

    Raises:
        ValueError: MuJoCo's, of what it cannot read; or a value is NaN.
    """
    with _listen():
        return _read(path, include)


def compile_file(path: str | os.PathLike[str]) -> "mujoco.MjModel":
    """The compiled model of an MJCF or URDF file; errors as of `read_spec_file`."""
    with _listen():
        return _read(path, None).compile()


def list_visual_meshes(spec: "mujoco.MjSpec") -> list[int]:
    """Places in `spec.geoms` of those with a mesh that is only seen.

    It touches nothing and gives no inertia.
    """
    import mujoco

    geom = mujoco.mjtObj.mjOBJ_GEOM
    always = int(spec.compiler.inertiafromgeom) == 1  # mjINERTIAFROMGEOM_TRUE
    referred = {name for p in spec.pairs for name in (p.geomname1, p.geomname2)}
    referred |= {s.objname for s in spec.sensors if s.objtype == geom}
    referred |= {s.refname for s in spec.sensors if s.reftype == geom}
    return [
        i
        for i, g in enumerate(spec.geoms)
        if g.meshname
        and not (g.contype or g.conaffinity or g.fluid_ellipsoid)
        and (not g.name or g.name not in referred)
        and (
            g.mass == 0 or g.density == 0 or (g.parent.explicitinertial and not always)
        )
    ]


def _read(
    path: str | os.PathLike[str], include: Mapping[str, bytes] | None
) -> "mujoco.MjSpec":
    """What `read_spec_file` gives."""
    spec = _parse(path, include)
    if not _has_doubtful_mesh(spec):
        return spec
    try:
        spec.compile()
    except ValueError:
        spec = _parse(path, include)  # as it was
        _delete_visual_meshes(spec)
    return spec


def _parse(
    path: str | os.PathLike[str], include: Mapping[str, bytes] | None
) -> "mujoco.MjSpec":
    """The spec of a file, in which meshes of ROS packages lead to files."""
    import mujoco

    files = {os.fsencode(name): text for name, text in (include or {}).items()}
    spec = mujoco.MjSpec.from_file(os.fsencode(path), include=files or None)
    home = Path(os.path.abspath(os.fspath(path))).parent
    for mesh in spec.meshes:
        if mesh.file.startswith(_PACKAGE) and not spec.strippath:
            found = _find_in_package(mesh.file.removeprefix(_PACKAGE), home)
            if found:
                mesh.file = os.path.relpath(found, home / spec.meshdir)
    return spec


def _find_in_package(name: str, home: Path) -> Path | None:
    """File "PACKAGE/PATH" of a ROS package that holds the model or lies near it."""
    _, _, inner = name.partition("/")
    for folder in (home, *home.parents):
        for place in (folder / name, folder / inner):
            if place.is_file():
                return place
    return None


def _has_doubtful_mesh(spec: "mujoco.MjSpec") -> bool:
    """Whether MuJoCo may be unable to read a mesh that is only seen."""
    geoms = spec.geoms
    needless = {geoms[i].meshname for i in list_visual_meshes(spec)}
    for mesh in spec.meshes:
        file = os.path.basename(mesh.file) if spec.strippath else mesh.file
        path = os.path.join(spec.modelfiledir, spec.meshdir, file)
        is_plain = path.lower().endswith(_READABLE_MESHES) and os.path.isfile(path)
        if mesh.name in needless and file and not is_plain:
            return True
    return False


def _delete_visual_meshes(spec: "mujoco.MjSpec") -> None:
    """Delete geoms whose mesh is only seen, and meshes that no geom has."""
    geoms = spec.geoms
    for geom in [geoms[i] for i in list_visual_meshes(spec)]:
        spec.delete(geom)
    delete_unused_meshes(spec)


def delete_unused_meshes(spec: "mujoco.MjSpec") -> None:
    """Delete meshes that no geom has."""
    used = {geom.meshname for geom in spec.geoms}
    for mesh in [mesh for mesh in spec.meshes if mesh.name not in used]:
        spec.delete(mesh)


@contextmanager
def _listen() -> Iterator[None]:
    """Hear what MuJoCo warns of while it reads a file; it is silent from then on.

    Paths are given to it as bytes: it takes any, while a text has to be UTF-8.
    """
    import mujoco

    heard: list[str] = []
    mujoco.set_mju_user_warning(heard.append)
    try:
        yield
    except UnicodeDecodeError as error:  # MuJoCo's words, about a path that is no UTF-8
        raise ValueError(error.object.decode(errors="replace")) from error
    finally:
        silence_mujoco()
    if any("'NaN'" in message for message in heard):
        # it counts as not given, or makes the simulation NaN
        raise ValueError("a value in it is NaN; would fit: a number")
