"""A model to drive and to identify: takes a URDF or MJCF, gives an MJCF's text."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import ModelError
from ..files import atomic_path
from ..mjcf.asset_paths import relocate_paths
from ..mjcf.document import MjcfDocument, describe_refusal, is_urdf
from ..mjcf.xml_text import Element, encode_text, format_path, parse
from ..mujoco_files import delete_unused_meshes
from ..printable import join_names, quote_name
from ..recording import load_model, read_spec
from ..recording.names import refuse_dangerous_model
from .contacts import find_touching_pairs
from .drives import Drive, Gains, build_drives, list_followers, list_undriven
from .inertias import mend_inertias

if TYPE_CHECKING:
    import mujoco

SOURCE = "urdf"  # name of the <text> that says which URDF a model was made of


@dataclass(frozen=True)
class Preparation:
    """A prepared model."""

    text: str
    steps: tuple[str, ...]


def prepare_model(
    path: str | os.PathLike[str],
    folder: str | os.PathLike[str],
    gains: Gains,
    *,
    weld_base: bool,
    without_contacts: bool,
) -> Preparation:
    """The MJCF of a robot in which every joint that a drive could turn has one.

    Args:
        folder: where the text will lie; meshes are still found from there.
        weld_base: whether bodies with a free joint lose it.
        without_contacts: whether shapes that give no inertia are left out.

    Raises:
        ModelError: MuJoCo cannot read the model, or it holds macros of xacro.
        InputError: a joint has no gain, or a gain no joint.
    """
    name = os.fspath(path)
    refuse_dangerous_model(name)
    try:
        spec = read_spec(path)
        steps = [*_describe_meshes(name, spec), *mend_inertias(spec)]
        steps += _leave_out_shapes(spec) if without_contacts else ()
        steps += _weld(spec) if weld_base else ()
        drives = build_drives(_compile_bare(spec), gains)
        steps += _fit_keyframes(spec, bool(drives))
        steps += _exclude_contacts(spec)
        steps += _move_limits(spec, drives)
        _replace_motors(spec, drives)
        model = spec.compile()
    except ValueError as error:
        said = describe_refusal(name, error) + _explain_shapes(path)
        raise ModelError(said) from error
    document = MjcfDocument(path, spec.to_xml(), in_place=False)
    added = [drive for drive in drives if drive.motor is None]
    section = document.get_section("actuator", first=False) if added else None
    for drive in added:
        assert section
        new = document.insert(section, f"<{drive.tag}/>", first=False)
        new.set({"name": drive.joint, "joint": drive.joint, **drive.attributes})
    relocate_paths(document, os.path.realpath(folder))
    if is_urdf(path):
        custom = document.get_section("custom", first=False)
        source = document.insert(custom, "<text/>", first=False)
        place = os.path.relpath(os.path.realpath(path), os.path.realpath(folder))
        source.set({"name": SOURCE, "data": format_path(place)})
    steps += _describe_joints(model, drives, gains)
    return Preparation(document.file.to_text(), (*steps, *_describe_speeds(name)))


def write_model(prepared: Preparation, path: str | os.PathLike[str]) -> None:
    """Write a prepared model, if MuJoCo can load it where it is to lie.

    Raises:
        InputError: nothing can be written there, or MuJoCo refuses the model.
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(encode_text(prepared.text))
        load_model(temporary)


def _compile_bare(spec: "mujoco.MjSpec") -> "mujoco.MjModel":
    """The compiled model without keyframes, of which none can then be refused."""
    bare = spec.copy()
    for key in list(bare.keys):
        bare.delete(key)
    return bare.compile()


def _list_meshes(name: str) -> set[str]:
    """Names of the mesh files in a model's text."""
    root: Element = parse(Path(name).read_text(errors="replace"), "", name).root()
    if root.tag == "mujoco":
        root = MjcfDocument(name, in_place=False).root
    files = (e.get("file") or e.get("filename") for e in root.walk() if e.tag == "mesh")
    return {os.path.basename(file) for file in files if file}


def _describe_meshes(name: str, spec: "mujoco.MjSpec") -> Iterator[str]:
    """Which meshes of the text the spec does not have."""
    kept = {os.path.basename(mesh.file) for mesh in spec.meshes}
    if dropped := sorted(_list_meshes(name) - kept):
        yield f"left out meshes that are only seen: {join_names(dropped)}"


def _leave_out_shapes(spec: "mujoco.MjSpec") -> Iterator[str]:
    """Delete geoms that give no inertia, and their meshes; what was done."""
    always = int(spec.compiler.inertiafromgeom) == 1  # mjINERTIAFROMGEOM_TRUE
    bodies = [geom.parent for geom in spec.geoms]
    needless = [
        geom
        for geom, body in zip(spec.geoms, bodies, strict=True)
        if body is not None and (body.explicitinertial or body.name == "world")
    ]
    for geom in () if always else needless:
        spec.delete(geom)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    delete_unused_meshes(spec)
    yield "left out shapes that give no inertia: nothing touches anything"


def _explain_shapes(path: str | os.PathLike[str]) -> str:
    """Words that help where MuJoCo reads a model without its shapes; else empty."""
    try:
        spec = read_spec(path)
        for _ in (*mend_inertias(spec), *_leave_out_shapes(spec)):
            pass  # only the changes count
        _compile_bare(spec)
    except ValueError:
        return ""
    return "; or --no-contacts if the robot touches nothing"


def _weld(spec: "mujoco.MjSpec") -> Iterator[str]:
    """Delete the free joints of a spec; what was done."""
    import mujoco

    free = [j for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE]
    for joint in free:
        body = joint.parent.name
        spec.delete(joint)
        yield f"body {quote_name(body)} is fixed where it stands: no free joint"
    if not free:
        yield "the base is fixed to the world already"


def _fit_keyframes(spec: "mujoco.MjSpec", is_driven: bool) -> Iterator[str]:
    """Delete keyframes that do not fit the model; what was done."""
    model = _compile_bare(spec)
    sizes = {"qpos": model.nq, "qvel": model.nv, "act": model.na, "ctrl": model.nu}
    sizes |= {"mpos": 3 * model.nmocap, "mquat": 4 * model.nmocap}
    for key in list(spec.keys):
        label = f"keyframe {quote_name(key.name)}"
        for field, size in sizes.items():
            if (count := len(getattr(key, field))) not in (0, size):
                fits = f"{count} numbers, not {size}"
                yield f"dropped {label}: its {field} has {fits}"
                spec.delete(key)
                break
        else:
            if is_driven and len(key.ctrl):
                key.ctrl = []
                yield f"{label} keeps its pose, and loses its ctrl of other drives"


def _exclude_contacts(spec: "mujoco.MjSpec") -> Iterator[str]:
    """Exclude contacts of bodies that touch in every pose; what was done."""
    model = spec.compile()
    for pair in find_touching_pairs(model):
        names = [model.body(body).name for body in pair]
        said = " and ".join(
            quote_name(n) if n else "a body without a name" for n in names
        )
        if all(names):
            spec.add_exclude(bodyname1=names[0], bodyname2=names[1])
            yield f"excluded contacts of {said}: they touch in every pose"
        else:
            yield f"{said} touch in every pose; name both to exclude their contacts"


def _move_limits(spec: "mujoco.MjSpec", drives: Sequence[Drive]) -> Iterator[str]:
    """Leave efforts limited by the drives alone, and make these stable to simulate."""
    import mujoco

    for drive in drives:
        joint = spec.joint(drive.joint)
        joint.actfrcrange = [0, 0]
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_AUTO
    kinds = mujoco.mjtIntegrator
    is_servo = any(drive.tag == "position" for drive in drives)
    if is_servo and spec.option.integrator == kinds.mjINT_EULER:
        spec.option.integrator = kinds.mjINT_IMPLICITFAST
        yield "integrator implicitfast, in which the damping of servos is stable"


def _replace_motors(spec: "mujoco.MjSpec", drives: Sequence[Drive]) -> None:
    """Make servos of the motors in whose place drives are; their names stay."""
    import mujoco

    for drive in drives:
        if drive.motor is None:
            continue
        actuator = list(spec.actuators)[drive.motor]
        actuator.set_to_position(*(float(drive.attributes[k]) for k in ("kp", "kv")))
        actuator.gear = [1, 0, 0, 0, 0, 0]
        actuator.ctrlrange, no = [0, 0], mujoco.mjtLimited.mjLIMITED_FALSE
        actuator.ctrllimited = actuator.forcelimited = no
        if limits := drive.attributes.get("forcerange"):
            actuator.forcerange = [float(end) for end in limits.split()]
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE


def _describe_joints(
    model: "mujoco.MjModel", drives: Sequence[Drive], gains: Gains
) -> Iterator[str]:
    """What each joint got, and why others got nothing."""
    for drive in drives:
        yield f"joint {quote_name(drive.joint)}: {drive.says}"
    for joint, e in list_followers(model).items():
        led, own = int(model.eq_obj2id[e]), quote_name(model.joint(joint).name)
        follows = (
            f"follows {quote_name(model.joint(led).name)}" if led >= 0 else "is held"
        )
        yield f"joint {own}: no drive, it {follows} (an equality constraint)"
    undriven = {model.joint(j).name for j in list_undriven(model)}
    for name in gains.passive:
        what = "no drive" if name in undriven else "it keeps its motor"
        yield f"joint {quote_name(name)}: {what}, as told"
    if not drives:
        unused = ", so the gains that were given change nothing" * bool(gains.kp)
        yield f"no joint needed a drive{unused}"


def _describe_speeds(name: str) -> Iterator[str]:
    """The limits of speed that a URDF states and MJCF has no place for."""
    root = parse(Path(name).read_text(errors="replace"), "", name).root()
    speeds = []
    for joint in root.elements() if root.tag == "robot" else ():
        unit = "m/s" if joint.get("type") == "prismatic" else "rad/s"
        for limit in joint.elements() if joint.tag == "joint" else ():
            if limit.tag == "limit" and (speed := limit.get("velocity")):
                speeds.append(f"{quote_name(joint.get('name') or '')} {speed} {unit}")
    if speeds:
        yield f"limits of speed, for which MJCF has no place: {', '.join(speeds)}"
