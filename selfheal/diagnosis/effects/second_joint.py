"""A second joint between motor and link: takes a place, adds the joint to a model.

The given joint becomes the motor's. A joint of the same axis behind it lets the link
move against the motor (MuJoCo manual, Modeling: Backlash).
"""

from abc import abstractmethod
from typing import TYPE_CHECKING

from ...mjcf.edit import Edit, Insert, Set, format_number
from ...recording.data import Floats
from ..data.robot_summary import Joint, RobotSummary, min_stable_inertia
from .by_target import JointEffect
from .declaration import Finding, FindingField
from .places import LINK, MOTOR, SLIDE, JointPlace, Place, SecondJointPlace
from .protocols import JointAddition, ModelEdit, TextForm

if TYPE_CHECKING:
    from mujoco import MjModel, MjSpec

# field of mjModel of each attribute that the second joint may have
FIELDS = {
    "range": "jnt_range",
    "solreflimit": "jnt_solref",
    "solimplimit": "jnt_solimp",
    "stiffness": "jnt_stiffness",
    "damping": "dof_damping",
}
# attributes that the second joint must not inherit from a default class
ALONE: dict[str, float | tuple[float, ...]] = {
    "damping": (0.0, 0.0, 0.0),
    "stiffness": (0.0, 0.0, 0.0),
    "springref": 0.0,
    "armature": 0.0,
    "frictionloss": 0.0,
    "ref": 0.0,
    "margin": 0.0,
}


class SecondJointEffect(
    JointEffect,
    JointAddition[SecondJointPlace],
    ModelEdit[SecondJointPlace],
    TextForm[SecondJointPlace],
):
    """An effect that needs a second joint behind the motor's.

    The motor's side has the rotor's armature as its inertia. Where the model states
    less than the time step can carry, it gets the least that does.

    Attributes:
        suffix: what the second joint's name has after the joint's.
        min_inertia_share: least inertia of the motor's side, of the joint's; chosen.
    """

    group = "transmission"
    finding_fields = (
        FindingField(
            "measured",
            (MOTOR, LINK),
            note=": the joint's position is read at the {value}'s side.",
        ),
    )
    suffix = ""
    min_inertia_share = 0.01

    def list_places(self, robot: RobotSummary) -> list[tuple[Joint, Place]]:
        """Two places of each joint: the encoder may sit at the motor's or link's side.

        At the last joint of a body only, as MuJoCo puts a new joint behind the others
        and turns its axis with them. Not where the new joint's name is taken.
        """
        body, names = robot.model.jnt_bodyid, {j.name for j in robot.joints}
        return [
            (joint, self._extend(place, joint.name, side))
            for joint, place in super().list_places(robot)
            if body[joint.id] not in body[joint.id + 1 :]
            and joint.name + self.suffix not in names
            for side in ((MOTOR, LINK) if joint.measured else (MOTOR,))
        ]

    def find_place(self, model: "MjModel", finding: Finding) -> Place:
        name, side = finding["target"].partition(":")[2], finding["measured"]
        return self._extend(super().find_place(model, finding), name, side)

    def _extend(self, place: Place, name: str, side: str) -> SecondJointPlace:
        """The place of a joint of a name, with the encoder at a side."""
        added = name + self.suffix
        return place.extend(SecondJointPlace, added_name=added, measured=side)

    def is_whole_in_text(self, place: Place) -> bool:
        """Not where the joint is read behind the added one, which MJCF cannot say."""
        return not (isinstance(place, SecondJointPlace) and place.is_read_behind)

    def edit_spec(self, spec: "MjSpec", place: SecondJointPlace) -> None:
        """Add a joint of the same axis between the motor and the body it moves."""
        if place.is_patched:
            return  # a patched model's text has it already
        # joints are added from the last one on, so that this id still holds
        joint = spec.joints[place.joint]
        light = self.min_inertia_share * place.inertia
        # between two added joints MuJoCo needs some inertia
        third = joint.parent.joints[-1].name != joint.name
        extra = joint.parent.add_joint(
            name=place.added_name,
            type=joint.type,
            axis=joint.axis,
            pos=joint.pos,
            limited=0,
            **ALONE | {"armature": light if third else 0.0},
        )
        if joint.frame:
            extra.set_frame(joint.frame)
        joint.armature = max(joint.armature, light)

    def edit_model(
        self, model: "MjModel", place: SecondJointPlace, values: Floats
    ) -> None:
        if not place.is_patched:
            model.dof_armature[place.dof] = self.motor_inertia(model, place)
        numbers = self.joint_attributes(model, values)
        model.jnt_limited[place.added_joint] = "range" in numbers
        for name, value in numbers.items():
            field = getattr(model, FIELDS[name])
            is_joints = FIELDS[name].startswith("jnt")
            at = place.added_joint if is_joints else place.added_dof
            field[at] = value if field.ndim > 1 else value[0]

    def motor_inertia(self, model: "MjModel", place: JointPlace) -> float:
        """Inertia of the motor's side [kg m^2 or kg]: the model's, or the least stable.

        A limit's constraint ignores implicit damping. It is too soft beside a side so
        light that its servo's damping stops it in one step.
        """
        armature = float(model.dof_armature[place.dof])
        servo = min_stable_inertia(model, place.joint)
        return max(armature, servo, self.min_inertia_share * place.inertia)

    @abstractmethod
    def joint_attributes(
        self, model: "MjModel", values: Floats
    ) -> dict[str, tuple[float, ...]]:
        """MJCF attributes of the second joint; angles [rad], slides [m]."""

    @abstractmethod
    def compute_deflection(self, values: Floats, load: float) -> float:
        """Rest position [rad or m] of the second joint under a load [N m or N]."""

    def edit_text(
        self, model: "MjModel", place: SecondJointPlace, values: Floats
    ) -> list[Edit]:
        joint = model.joint(place.joint)
        slide = model.jnt_type[joint.id] == SLIDE
        own = ALONE | {"armature": model.dof_armature[place.added_dof]}
        predicted = {
            "name": place.added_name,
            "type": "slide" if slide else "hinge",
            "axis": format_number(joint.axis),
            "pos": format_number(joint.pos),
            **{
                k: format_number(v)
                for k, v in (own | self.joint_attributes(model, values)).items()
            },
        }
        predicted["limited"] = "true" if "range" in predicted else "false"
        xml = " ".join(f'{k}="{v}"' for k, v in predicted.items())
        body = model.body(model.jnt_bodyid[joint.id]).name
        return [
            Set("joint", joint.name, {"armature": format_number(joint.armature)}),
            Insert("body", body, f"<joint {xml}/>", angles=() if slide else ("range",)),
        ]
