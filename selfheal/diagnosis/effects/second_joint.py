"""A second joint between motor and link: takes a place, adds the joint to a model.

The given joint becomes the motor's. A joint of the same axis behind it lets the link
move against the motor (MuJoCo manual, Modeling: Backlash).
"""

from dataclasses import replace
from typing import Any

from ...mjcf.edit import Insert, Set, format_number
from ..data.robot_summary import min_stable_inertia
from .by_target import JointEffect
from .declaration import FindingField
from .places import Place, add_keys
from .terms import extend_places

MOTOR, LINK = "motor", "link"  # where a joint's encoder sits
# field of mjModel of each attribute that the second joint may have
FIELDS = {
    "range": "jnt_range",
    "solreflimit": "jnt_solref",
    "solimplimit": "jnt_solimp",
    "stiffness": "jnt_stiffness",
    "damping": "dof_damping",
}
# attributes that the second joint must not inherit from a default class
ALONE: dict[str, Any] = {
    "damping": (0.0, 0.0, 0.0),
    "stiffness": (0.0, 0.0, 0.0),
    "springref": 0.0,
    "armature": 0.0,
    "frictionloss": 0.0,
    "ref": 0.0,
    "margin": 0.0,
}


class SecondJointEffect(JointEffect):
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

    def propose_terms(self, robot):
        """One term for each side, motor's and link's, where the encoder may sit.

        At the last joint of a body only, as MuJoCo puts a new joint behind the others
        and turns its axis with them. Not where the new joint's name is taken.
        """
        found, body = [], robot.model.jnt_bodyid
        taken = {j.name for j in robot.joints}
        for term in super().propose_terms(robot):
            joint = robot.joint_by_id(term.places[0]["joint"])
            last = body[joint.id] not in body[joint.id + 1 :]
            if not last or joint.name + self.suffix in taken:
                continue
            for side in (MOTOR, LINK) if joint.measured else (MOTOR,):
                term_of_side = extend_places(term, suffix=self.suffix, side=side)
                found.append(replace(term_of_side, finding_fields={"measured": side}))
        return found

    def find_place(self, model, finding) -> Place:
        place = super().find_place(model, finding)
        return add_keys(place, suffix=self.suffix, side=finding.get("measured"))

    def edit_spec(self, spec, place):
        """Add a joint of the same axis between the motor and the body it moves."""
        if place.get("there"):
            return  # a patched model's text has it already
        # joints are added from the last one on, so that this id still holds
        joint = spec.joints[place["joint"]]
        light = self.min_inertia_share * place["inertia"]
        # between two added joints MuJoCo needs some inertia
        third = joint.parent.joints[-1].name != joint.name
        extra = joint.parent.add_joint(
            name=joint.name + self.suffix,
            type=joint.type,
            axis=joint.axis,
            pos=joint.pos,
            limited=0,
            **ALONE | {"armature": light if third else 0.0},
        )
        if joint.frame:
            extra.set_frame(joint.frame)
        joint.armature = max(joint.armature, light)

    def edit_model(self, model, place, values):
        if not place.get("there"):
            model.dof_armature[place["dof"]] = self.motor_inertia(model, place)
        numbers = self.joint_attributes(model, values)
        model.jnt_limited[place["extra_jnt"]] = "range" in numbers
        for name, value in numbers.items():
            field = getattr(model, FIELDS[name])
            at = place["extra_" + FIELDS[name][:3]]
            field[at] = value if field.ndim > 1 else value[0]

    def motor_inertia(self, model, place) -> float:
        """Inertia of the motor's side [kg m^2 or kg]: the model's, or the least stable.

        A limit's constraint ignores implicit damping. It is too soft beside a side so
        light that its servo's damping stops it in one step.
        """
        armature = float(model.dof_armature[place["dof"]])
        servo = min_stable_inertia(model, place["joint"])
        return max(armature, servo, self.min_inertia_share * place["inertia"])

    def joint_attributes(self, model, values) -> dict[str, tuple[float, ...]]:
        """MJCF attributes of the second joint; angles [rad], slides [m]."""
        raise NotImplementedError

    def edit_text(self, model, place, values):
        joint = model.joint(place["joint"])
        slide = model.jnt_type[joint.id] == 2
        own = ALONE | {"armature": model.dof_armature[place["extra_dof"]]}
        predicted = {
            "name": joint.name + self.suffix,
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
