"""A mount that gives: the base of a robot rocks about an axis, on a spring."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...mjcf.edit import Edit, Insert, format_number
from ...recording.data import Floats
from ..data.robot_summary import RobotSummary
from .base import Effect, Term
from .declaration import SELDOM, Finding, FindingField, ParameterSpec, Proposal
from .places import AddedJointPlace, BodyPlace, Place
from .protocols import JointAddition, ModelEdit, TextForm

if TYPE_CHECKING:
    from mujoco import MjModel, MjSpec

AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}  # of the world
# [Hz] at which a robot on a mount that gives swings, where a fit begins; chosen: below
# and above those of drives
START_FREQUENCIES = (4.0, 10.0)
# damping ratio where a fit begins; chosen: that of a bench or a frame
START_DAMPING_RATIO = 0.1
MIN_MOTION_SHARE = 1e-6  # of all inertia, that which a base turns with; chosen


@dataclass(frozen=True, kw_only=True)
class BasePlace(BodyPlace, AddedJointPlace):
    """A base that rocks.

    Attributes:
        axis: of the world, "x" or "y".
        direction: the same as a unit vector (3) in the body's frame.
        inertia: of all that turns with the base [kg m^2].
    """

    axis: str
    direction: tuple[float, ...]
    inertia: float


class BaseCompliance(
    Effect, JointAddition[BasePlace], ModelEdit[BasePlace], TextForm[BasePlace]
):
    """One hinge and spring between the world and a base that is fixed to it.

    Isotropic mounts give about both horizontal axes; the one that gives most is named
    first.
    """

    name = "base_compliance"
    group = "body"
    target_kinds = ("body",)
    description = "The mount gives way: the base rocks about a horizontal axis."
    equation = "tau = -stiffness angle - damping d angle/dt, at the base's origin"
    source = "Lew, Moon 2001, ASME J. Dyn. Syst. 123: passively compliant base"
    separate_by = "tap the base with the motors off, or bolt it to the floor"
    phrase = "{at} gives way at its mount, with a stiffness of {stiffness} {lacks}"
    parameters = (
        ParameterSpec("stiffness", "N m/rad", nominal=np.inf, nonnegative=True),
        ParameterSpec("damping", "N m s/rad", nonnegative=True),
    )
    finding_fields = (
        FindingField("axis", tuple(AXES), note=": it rocks about the world's {value}."),
    )
    log_odds = SELDOM

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term for each horizontal axis of each fixed base that carries a robot."""
        model = robot.model
        found = []
        for body in range(1, model.nbody):
            if not is_base(model, body):
                continue
            for axis in AXES:
                place = make_base_place(model, body, axis)
                if place.inertia > MIN_MOTION_SHARE:
                    found.append(self._make_term(robot, place))
        return found

    def _make_term(self, robot: RobotSummary, place: BasePlace) -> Term:
        """The term of one base and axis."""
        inertia, most = place.inertia, place.inertia / robot.timestep**2
        turns = 2 * np.pi * np.array(START_FREQUENCIES)
        starts = [float(min(inertia * w**2, most / 5)) for w in turns]
        damping = [2 * START_DAMPING_RATIO * np.sqrt(k * inertia) for k in starts]
        k, d = starts[0], float(damping[0])
        parameters = (
            self.bound("stiffness", (0.02 * k, most), scale=k),
            self.bound("damping", (0.0, most * robot.timestep), scale=d, nominal=d),
        )
        target = f"body:{robot.model.body(place.body).name}"
        values = tuple((a, float(b)) for a, b in zip(starts, damping, strict=True))
        return self.make_term(target, place, Proposal(parameters, values))

    def find_place(self, model: "MjModel", finding: Finding) -> Place:
        place = super().find_place(model, finding)
        assert isinstance(place, BodyPlace)  # by `target_kinds`
        return make_base_place(model, place.body, finding["axis"])

    def edit_spec(self, spec: "MjSpec", place: BasePlace) -> None:
        """Add a hinge without a motor at the base's origin."""
        if place.is_patched:
            return  # a patched model's text has it already
        body = spec.bodies[place.body]
        body.add_joint(name=place.added_name, axis=place.direction)

    def edit_model(self, model: "MjModel", place: BasePlace, values: Floats) -> None:
        joint, dof = place.added_joint, place.added_dof
        model.jnt_stiffness[joint], model.dof_damping[dof] = values

    def compute_deflection(self, values: Floats, load: float) -> float:
        return float(load / values[0])

    def edit_text(
        self, model: "MjModel", place: BasePlace, values: Floats
    ) -> list[Edit]:
        name = model.body(place.body).name
        attributes = {
            "name": place.added_name,
            "type": "hinge",
            "axis": format_number(place.direction),
            "pos": "0 0 0",
            "limited": "false",
            "stiffness": format_number(values[0]),
            "damping": format_number(values[1]),
            **dict.fromkeys(("springref", "armature", "frictionloss", "ref"), "0"),
        }
        xml = " ".join(f'{k}="{v}"' for k, v in attributes.items())
        return [Insert("body", name, f"<joint {xml}/>")]


def is_base(model: "MjModel", body: int) -> bool:
    """Whether a body is fixed to the world, has a mass, and carries what moves."""
    carried = model.body_parentid == body
    return bool(
        model.body_parentid[body] == 0
        and model.body_jntnum[body] == 0
        and model.body_mocapid[body] < 0
        and model.body_mass[body] > 0
        and model.body(body).name
        and (model.body_weldid[carried] != 0).any()
    )


def make_base_place(model: "MjModel", body: int, axis: str) -> BasePlace:
    """The place of a base that rocks about one of the world's axes.

    Args:
        axis: "x" or "y".
    """
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    turn = np.array(AXES[axis])
    own = data.xmat[body].reshape(3, 3).T @ turn
    inertia = 0.0
    for b in range(model.nbody):
        if model.body_rootid[b] == body:
            apart = data.xipos[b] - data.xpos[body]
            lever = apart - (apart @ turn) * turn
            inertia += model.body_mass[b] * float(lever @ lever)
            inertia += float(model.body_inertia[b].mean())
    return BasePlace(
        body=body,
        added_name=f"{model.body(body).name}_rocks_{axis}",
        axis=axis,
        direction=tuple(own.tolist()),
        inertia=inertia,
    )
