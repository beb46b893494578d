"""A second joint between motor and link: takes a place, gives what it adds there."""

from dataclasses import replace
from typing import Any

from ...mjcf.edit import Insert, Set, format_number
from ..data.robot_summary import min_stable_inertia
from .base import extend_places
from .friction import JointEffect

FIELDS = {
    "range": "jnt_range",
    "solreflimit": "jnt_solref",
    "solimplimit": "jnt_solimp",
    "stiffness": "jnt_stiffness",
    "damping": "dof_damping",
}
# what a default class may say of joints and the second one must not inherit
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
    """Effects that need a second joint behind the motor's.

    The motor's side is the rotor's armature; where the model states less than the time
    step can carry, it gets that much.
    """

    group = "transmission"
    suffix = ""
    min_inertia_share = (
        0.01  # least inertia of the motor's side, of the joint's; chosen
    )

    def propose_terms(self, robot):
        """Once for each side, motor's and link's, that the encoder may read.

        At the last joint of a body only: MuJoCo would put the new one behind the others
        and turn its axis with them. And where its name is not taken.
        """
        found, body = [], robot.model.jnt_bodyid
        taken = {j.name for j in robot.joints}
        for term in super().propose_terms(robot):
            joint = robot.joint_by_id(term.places[0]["joint"])
            last = body[joint.id] not in body[joint.id + 1 :]
            if not last or joint.name + self.suffix in taken:
                continue
            for side in ("motor", "link") if joint.measured else ("motor",):
                more = {"suffix": self.suffix, "side": side, "qpos": joint.qpos}
                more |= {"inertia": joint.inertia}
                found.append(
                    replace(
                        extend_places(term, **more), finding_fields={"measured": side}
                    )
                )
        return found

    def edit_spec(self, spec, place):
        """Add a joint of the same axis between the motor and the body it moves."""
        if place.get("there"):
            return  # a patched model's text has it already
        joint = spec.joints[place["joint"]]  # those before it are as they were
        light = self.min_inertia_share * place["inertia"]
        # what lies between two added ones has some inertia, or none could be computed
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
        """Inertia of the motor's side [kg m^2 or kg]: as stated, or what computes.

        A stop knows nothing of an implicit damping: beside a side so light that its
        servo's damping stops it in one step, it is too soft.
        """
        nominal_terms = float(model.dof_armature[place["dof"]])
        servo = min_stable_inertia(model, place["joint"])
        return max(nominal_terms, servo, self.min_inertia_share * place["inertia"])

    def joint_attributes(self, model, values) -> dict[str, tuple[float, ...]]:
        """MJCF attributes of the second joint, angles in rad."""
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
