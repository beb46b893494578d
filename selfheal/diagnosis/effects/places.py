"""Where an effect acts: takes a compiled model and a name, gives indices into it."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self, TypeVar

import numpy as np

from ...errors import InputError
from ...recording import find_controls, find_output
from ...recording.actuator_laws import find_goal

if TYPE_CHECKING:
    from mujoco import MjModel

HINGE, SLIDE = 3, 2  # mjtJoint
AT_JOINT = (0, 1)  # mjtTrn: joint, jointinparent
MOTOR, LINK = "motor", "link"  # where a joint's encoder sits
P = TypeVar("P", bound="Place")


@dataclass(frozen=True, eq=False, kw_only=True)
class Numbering:
    """A model that may have more joints than the given one, whose joints it numbers.

    Attributes:
        model: compiled; a diverged state is not reset.
        dof: (nv of the given model) indices of its degrees of freedom in this model.
        qpos: (nq of the given model) indices of its positions in this model.
        joint: (njnt of the given model) ids of its joints in this model.
    """

    model: "MjModel"
    dof: np.ndarray
    qpos: np.ndarray
    joint: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where an effect acts, and what it needs to know there: the robot as a whole.

    Indices are those of the given model, until `renumber` gives those of another one.
    An effect of another package may add fields in a subclass of its own.

    Attributes:
        is_patched: whether the model is a patched one, which has what MuJoCo can do of
            the effect.
    """

    is_patched: bool = False

    def renumber(self, numbering: Numbering) -> Self:
        """Give the same place in a model with added joints.

        A field that is called, or ends with, `joint`, `dof` or `qpos` is an index; -1
        stands for none.
        """
        new: dict[str, Any] = {
            name: int(getattr(numbering, kind)[index])
            for name, index in vars(self).items()
            if (kind := name.rpartition("_")[2]) in ("joint", "dof", "qpos")
            and index >= 0
        }
        return replace(self, **new)

    def extend(self, kind: type[P], **more: Any) -> P:
        """Give the place as one of a subclass, with what that knows more."""
        return kind(**vars(self), **more)


@dataclass(frozen=True, kw_only=True)
class JointPlace(Place):
    """A joint.

    Attributes:
        joint: its id.
        dof: index of its velocity in qvel.
        qpos: index of its position in qpos.
        inertia: at the joint, as MuJoCo's dof_M0 [kg m^2 or kg].
    """

    joint: int
    dof: int
    qpos: int
    inertia: float


@dataclass(frozen=True, kw_only=True)
class AddedJointPlace(Place):
    """Where an effect adds a joint.

    Attributes:
        added_name: name of the added joint.
        added_joint: its id, once the place is renumbered for a model that has it.
        added_dof: index of its velocity in qvel.
        added_qpos: index of its position in qpos.
    """

    added_name: str
    added_joint: int = -1
    added_dof: int = -1
    added_qpos: int = -1

    def renumber(self, numbering: Numbering) -> Self:
        """Give the same place in a model with added joints."""
        added = numbering.model.joint(self.added_name)
        return replace(
            super().renumber(numbering),
            added_joint=added.id,
            added_dof=int(added.dofadr[0]),
            added_qpos=int(added.qposadr[0]),
        )

    @property
    def loaded_dof(self) -> int:
        """Index in qvel of the joint by whose load the added one deflects."""
        return self.added_dof


@dataclass(frozen=True, kw_only=True)
class SecondJointPlace(JointPlace, AddedJointPlace):
    """A motor's joint, and a link's behind it.

    Attributes:
        measured: where the joint's encoder sits, "motor" or "link".
    """

    measured: str

    @property
    def loaded_dof(self) -> int:
        """Index in qvel of the motor's joint."""
        return self.dof

    @property
    def is_read_behind(self) -> bool:
        """Whether the encoder reads the sum of both joints."""
        return self.measured == LINK


@dataclass(frozen=True, kw_only=True)
class ControlsPlace(Place):
    """Commands on their way.

    Attributes:
        controls: their indices into ctrl.
    """

    controls: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class ActuatorPlace(ControlsPlace):
    """An actuator, with the hinge or slide that it drives.

    Attributes:
        actuator: its id.
        goal: index into ctrl of the position that it is commanded to hold; -1: none.
        gear: its first gear ratio [1, or m at a slide].
        output: index of its output, of which it may have several.
        dof: index of its joint's velocity in qvel; -1: it drives no hinge or slide.
        qpos: index of its joint's position in qpos; -1: likewise.
    """

    actuator: int
    goal: int
    gear: float
    output: int
    dof: int = -1
    qpos: int = -1


@dataclass(frozen=True, kw_only=True)
class BodyPlace(Place):
    """A body.

    Attributes:
        body: its id.
    """

    body: int


@dataclass(frozen=True, kw_only=True)
class GeomsPlace(Place):
    """One geom or several.

    Attributes:
        geoms: their ids.
    """

    geoms: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class SignalPlace(Place):
    """A signal of the recordings, or all of a kind.

    Attributes:
        signal: its name; empty: all signals of the kind.
        kind: as the contract names it; empty where a finding alone is known.
    """

    signal: str = ""
    kind: str = ""


def joint_place(model: "MjModel", joint: int) -> JointPlace:
    """The place of a joint, by its id."""
    dof = int(model.jnt_dofadr[joint])
    return JointPlace(
        joint=joint,
        dof=dof,
        qpos=int(model.jnt_qposadr[joint]),
        inertia=float(model.dof_M0[dof]),
    )


def actuator_place(model: "MjModel", actuator: int) -> ActuatorPlace:
    """The place of an actuator, by its id."""
    output = find_output(model, actuator)
    joint = int(model.actuator_trnid[actuator, 0])
    at_joint = model.actuator_trntype[actuator] in AT_JOINT
    drives = at_joint and model.jnt_type[joint] in (HINGE, SLIDE)
    return ActuatorPlace(
        actuator=actuator,
        controls=find_controls(model, actuator),
        goal=find_goal(model, actuator),
        gear=float(model.actuator_gear[output, 0]),
        output=output,
        dof=int(model.jnt_dofadr[joint]) if drives else -1,
        qpos=int(model.jnt_qposadr[joint]) if drives else -1,
    )


def locate_target(model: "MjModel", target: str) -> Place:
    """The place that a target names ("joint:knee", "world"), in any model.

    Raises:
        InputError: the model has no such element.
    """
    kind, _, name = target.partition(":")
    if kind == "sensor":  # a signal's name, of which a model knows nothing
        return SignalPlace(signal=name)
    if kind == "world":
        return Place()
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
    return BodyPlace(body=element) if kind == "body" else GeomsPlace(geoms=(element,))
