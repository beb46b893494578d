"""Where an effect acts: takes a compiled model and a name, gives indices into it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypedDict

from ...errors import InputError
from ...recording import find_controls, find_output
from ...recording.actuator_laws import find_goal
from ...recording.data import Floats

if TYPE_CHECKING:
    import mujoco

HINGE, SLIDE = 3, 2  # mjtJoint
AT_JOINT = (0, 1)  # mjtTrn: joint, jointinparent


class Place(TypedDict, total=False):
    """Where an effect acts, and what it needs to know there; a key it lacks is absent.

    A mapping, so that an effect of another package can add keys of its own. Indices are
    those of the given model. `ModelVariant.map_place` renumbers `joint`, `dof`, `qpos`,
    `other_dof` and `other_qpos` for a model with added joints, and adds `extra_*`.

    Attributes:
        joint: id of a hinge or slide, or of the one that the effect acts on.
        dof: index of the joint's velocity in qvel; an actuator's is its joint's.
        qpos: index of the joint's position in qpos; an actuator's is its joint's.
        inertia: at the joint, as MuJoCo's dof_M0 [kg m^2 or kg].
        other_dof: `dof` of the joint that a spring couples to this one.
        other_qpos: `qpos` of that joint.
        suffix: what the added joint's name has after the joint's; its presence says
            that the effect adds a joint.
        extra_jnt: id of the added joint.
        extra_dof: index of its velocity in qvel.
        extra_qpos: index of its position in qpos.
        there: whether the model is a patched one, which has the effect's native part.
        actuator: id of an actuator.
        controls: indices into ctrl of its controls.
        goal: index into ctrl of the position that it is commanded to hold.
        gear: its first gear ratio [1, or m at a slide].
        output: index of its output, of which it may have several.
        begins: "settled" where an integral begins at what the first moments ask for.
        body: id of a body.
        bodies: ids of the bodies whose weight a controller carries.
        parts: how many bodies are lost with it, itself included.
        still: whether the readings of the joint are one position and noise.
        geom: id of a geom.
        geoms: ids of the geoms of the world that something which moves can touch.
        signal: name of a signal of the recordings.
        kind: of that signal, as the contract names it.
        field: name of the field of mjOption that the effect sets.
        side: -1 or 1, at the lower or the upper end, of a hard stop. "motor" or "link",
            where the encoder sits, of a joint with an added one. "both", of a gear.
            "base", of a joint below a base.
        measured: as the finding states it, "motor" or "link".
        axis: (3) unit vector in the body's frame, along which it is stretched.
        principal_axis: index of a principal axis of inertia.
        range_center: of the positions seen of a joint [rad or m].
        range: of the positions seen, from end to end [rad or m].
        speed: root mean square of the joint's velocity [rad/s or m/s].
    """

    joint: int
    dof: int
    qpos: int
    inertia: float
    other_dof: int
    other_qpos: int
    suffix: str
    extra_jnt: int
    extra_dof: int
    extra_qpos: int
    there: bool
    actuator: int
    controls: tuple[int, ...]
    goal: int
    gear: float
    output: int
    begins: str
    body: int
    bodies: tuple[int, ...]
    parts: int
    still: bool
    geom: int
    geoms: tuple[int, ...]
    signal: str
    kind: str
    field: str
    side: Any
    measured: str
    axis: Floats
    principal_axis: int
    range_center: float
    range: float
    speed: float


def joint_place(model: "mujoco.MjModel", joint: int) -> Place:
    """The place of a hinge or slide, by its id."""
    dof = int(model.jnt_dofadr[joint])
    return {
        "joint": joint,
        "dof": dof,
        "qpos": int(model.jnt_qposadr[joint]),
        "inertia": float(model.dof_M0[dof]),
    }


def actuator_place(model: "mujoco.MjModel", actuator: int) -> Place:
    """The place of an actuator, by its id, with the hinge or slide that it drives."""
    place: Place = {
        "actuator": actuator,
        "controls": find_controls(model, actuator),
        "gear": float(model.actuator_gear[find_output(model, actuator), 0]),
    }
    if (goal := find_goal(model, actuator)) >= 0:
        place["goal"] = goal
    joint = int(model.actuator_trnid[actuator, 0])
    at_joint = model.actuator_trntype[actuator] in AT_JOINT
    if at_joint and model.jnt_type[joint] in (HINGE, SLIDE):
        place["dof"] = int(model.jnt_dofadr[joint])
        place["qpos"] = int(model.jnt_qposadr[joint])
    return place


def locate_target(model: "mujoco.MjModel", target: str) -> Place:
    """The place that a target names ("joint:knee", "world"), in any model.

    Raises:
        InputError: the model has no such element.
    """
    kind, _, name = target.partition(":")
    if kind == "sensor":  # a signal's name, of which a model knows nothing
        return {"signal": name}
    if kind == "world":
        return {}
    try:
        element = int(getattr(model, kind)(name).id)
    except KeyError as error:
        raise InputError(
            f"the model has no {kind} {name!r}, which the diagnosis names"
        ) from error
    if kind == "joint":
        return joint_place(model, element)
    if kind == "actuator":
        return actuator_place(model, element)
    return {"body": element} if kind == "body" else {"geom": element}


def name_added_joint(model: "mujoco.MjModel", place: Mapping[str, Any]) -> str:
    """Name of the joint that an effect adds at a place: to a joint, or to a body."""
    at = model.joint(place["joint"]) if "joint" in place else model.body(place["body"])
    return f"{at.name}{place['suffix']}"


def add_keys(place: Mapping[str, Any], **more: Any) -> Place:
    """A place with more keys, which replace those of the same name."""
    out: dict[str, Any] = {**place, **more}
    return out  # type: ignore[return-value]
