"""Physics of the transmission between motor and link: inertia, springs, stops, play."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import Joint, RobotSummary
from .base import Effect, Term
from .by_target import JointEffect
from .declaration import (
    SELDOM,
    USUAL,
    Finding,
    FindingField,
    Parameter,
    ParameterSpec,
    Proposal,
    start_beside,
)
from .friction import torque_scale
from .places import JointPlace, Place, joint_place, locate_target
from .protocols import JointForce, ModelEdit, StepState
from .second_joint import SecondJointEffect

if TYPE_CHECKING:
    from mujoco import MjModel

# fewest periods a turn of magnets or teeth, or in a slide's range; chosen: fewer are
# those of gravity, or of a spring
MIN_POLES, MIN_PERIODS_OF_SLIDE = 4.0, 1.5
MIN_HALF_GAP = 1e-7  # least half of a gap [rad or m]; chosen: MuJoCo asks for a range
# share of a joint's range to which a spring's reference is known; chosen
SPRINGREF_RESOLUTION = 0.3
STIFFER_START = 5.0  # times the stiffness that shows, another start; chosen
MAX_JOINTS_APART = 3  # along a chain, of those that a cable runs over; chosen


class TransmissionEffect(JointEffect):
    """An effect at each hinge and slide, of its transmission."""

    group = "transmission"


class Armature(TransmissionEffect, ModelEdit[JointPlace]):
    name = "armature"
    description = "Inertia of the rotor, seen through the gear."
    equation = "tau = -armature a"
    source = "MuJoCo joint/armature"
    separate_by = "repeat the motion with another payload"
    phrase = "{at} has a rotor inertia of {armature}, {other}"
    parameters = (
        ParameterSpec("armature", "kg m^2", nonnegative=True, is_in_model=True),
    )
    log_odds = USUAL
    overrides = ("armature",)

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        now = float(robot.model.dof_armature[joint.dof])
        # behind a gear of 200 a rotor weighs hundreds of times as much as a light link;
        # a wrist may have the drive of a shoulder
        alike = [j.inertia for j in robot.joints if j.unit == joint.unit]
        high, scale = now * 10 + 300 * max(alike), 0.3 * joint.inertia
        p = self.bound("armature", (0.0, high), scale=scale, at=joint, nominal=now)
        return Proposal((p,), (*start_beside((p,), 0.3, 2, 100), (now / 2,)))

    def edit_model(self, model: "MjModel", place: JointPlace, values: Floats) -> None:
        model.dof_armature[place.dof] = values[0]


class JointSpring(TransmissionEffect, ModelEdit[JointPlace]):
    """A spring whose stiffness and springref take the place of the model's."""

    name = "joint_spring"
    description = "A spring across the joint, a cable or a hose perhaps."
    equation = "tau = -stiffness (q - springref)"
    source = "MuJoCo joint/stiffness, springref"
    separate_by = "measure the torque at rest, or re-zero the encoder"
    phrase = "{at} has a spring of {stiffness} {lacks}"
    parameters = (
        ParameterSpec("stiffness", "N m/rad", nonnegative=True, is_in_model=True),
        ParameterSpec("springref", "rad"),
    )
    overrides = ("stiffness",)

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        range_, middle = joint.range, joint.range_center
        now = float(robot.model.jnt_stiffness[joint.id])
        ref = float(robot.model.qpos_spring[joint.qpos])
        scale = 0.2 * joint.torque / range_
        most = 10 * torque_scale(robot, joint) / range_ + 10 * now
        reach, known = 5 * range_ + 1, SPRINGREF_RESOLUTION * range_
        ends = (min(ref, middle) - reach, max(ref, middle) + reach)
        parameters = (
            self.bound("stiffness", (0.0, most), scale=scale, at=joint, nominal=now),
            self.bound("springref", ends, scale=known, at=joint, nominal=ref),
        )
        # a spring too stiff becomes softer in a few steps; one too soft puts its
        # reference so far off that it takes many to become stiffer
        soft, stiff = now + scale, now + STIFFER_START * scale
        references = (ref, middle + range_, middle - range_)
        starts = [*((soft, q) for q in references), (stiff, ref), (stiff, middle)]
        return Proposal(parameters, tuple(starts))

    def edit_model(self, model: "MjModel", place: JointPlace, values: Floats) -> None:
        model.jnt_stiffness[place.joint] = values[0]
        model.qpos_spring[model.jnt_qposadr[place.joint]] = values[1]


class Cogging(TransmissionEffect, JointForce[JointPlace]):
    name = "cogging"
    description = "A torque that repeats with the angle, of magnets or a gear's teeth."
    equation = "tau = amplitude sin(poles q + phase)"
    source = "MuJoCo actuator/dcmotor, cogging (3.7)"
    separate_by = "turn the joint slowly through its whole range"
    phrase = "{at} has a torque of {amplitude} {lacks}, rippling with its angle"
    parameters = (
        ParameterSpec("amplitude", "N m", nominal=0.0, nonnegative=True),
        ParameterSpec("poles", "1", nonnegative=True),
        ParameterSpec("phase", "rad", nominal=0.0),
    )
    log_odds = SELDOM

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        torque, most = joint.torque, 3 * torque_scale(robot, joint)
        # two waves of neighboring counts part by two radians within the joint's range
        apart = 2.0 / max(joint.range, 0.05)
        turns = joint.unit == "rad"
        least = MIN_POLES if turns else MIN_PERIODS_OF_SLIDE * np.pi * apart
        parameters = (
            self.bound("amplitude", (0.0, most), scale=0.1 * torque, at=joint),
            self.bound(
                "poles", (least, 50 * least), scale=0.5 * apart, nominal=2.5 * least
            ),
            # an angle of the wave, also at a slide
            self.bound("phase", (-10.0, 10.0), scale=0.5),
        )
        few, many = 5 * least, 12.5 * least
        step = max(1.0, apart) if turns else apart
        counts = [*np.arange(least, few, step), *np.arange(few, many, 2 * step)]
        a = 0.01 * torque  # small, so that the answer is linear
        starts = tuple((a, float(n), p) for n in counts for p in (0.0, np.pi / 2))
        return Proposal(parameters, starts)

    def is_consistent(self, parameters: Sequence[Parameter], values: Floats) -> bool:
        # at its lowest frequency it is a bend within the range, of another effect
        return not values[1] < 1.01 * parameters[1].low

    def apply_forces(self, state: StepState, place: JointPlace, values: Floats) -> None:
        amplitude, poles, phase = values.T
        angle = state.qpos[:, place.qpos]
        state.applied_force[:, place.dof] += amplitude * np.sin(poles * angle + phase)


@dataclass(frozen=True, kw_only=True)
class CoupledPlace(JointPlace):
    """A joint that a spring couples to another one.

    Attributes:
        other: the other one, as a finding names it.
        other_dof: index of its velocity in qvel.
        other_qpos: index of its position in qpos.
    """

    other: str
    other_dof: int
    other_qpos: int


class JointCoupling(Effect, JointForce[CoupledPlace]):
    name = "joint_coupling"
    group = "transmission"
    target_kinds = ("joint",)
    description = "A spring between two joints, a cable that runs over both perhaps."
    equation = "tau = -stiffness (q - ratio q_other), and ratio times its opposite"
    source = "MuJoCo tendon/fixed, stiffness"
    separate_by = "hold one joint and move the other"
    phrase = "{at} is coupled to another joint by {stiffness} {lacks}"
    parameters = (
        ParameterSpec("stiffness", "N m/rad", nominal=0.0, nonnegative=True),
        ParameterSpec("ratio", "1", nominal=1.0),
    )
    finding_fields = (FindingField("other", target_kind="joint"),)
    log_odds = SELDOM

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term for each pair that a cable may run over, at the first of them."""
        return [
            self._make_term(robot, a, b)
            for a in robot.joints
            for b in robot.joints
            if a.id < b.id and _are_near(robot.model.dof_parentid, a.dof, b.dof)
        ]

    def _make_term(self, robot: RobotSummary, a: Joint, b: Joint) -> Term:
        """The term of a spring between two joints."""
        # what both bear: the weaker joint's, or a start is far from all that could be
        scale = 0.2 * min(torque_scale(robot, j) / j.range for j in (a, b))
        high = 10 * torque_scale(robot, a) / a.range
        parameters = (
            self.bound("stiffness", (0.0, high), scale=scale, at=a),
            self.bound("ratio", (-5.0, 5.0), scale=0.3),
        )
        place = _couple(joint_place(robot.model, a.id), f"joint:{b.name}", b)
        sizes = (min(k * scale, high) for k in (0.2, 2.0, 15.0))
        starts = tuple((size, ratio) for size in sizes for ratio in (1.0, -1.0))
        return self.make_term(f"joint:{a.name}", place, Proposal(parameters, starts))

    def find_place(self, model: "MjModel", finding: Finding) -> Place:
        other = locate_target(model, finding["other"])
        assert isinstance(other, JointPlace)  # `FindingField.target_kind`
        return _couple(super().find_place(model, finding), finding["other"], other)

    def apply_forces(
        self, state: StepState, place: CoupledPlace, values: Floats
    ) -> None:
        stiffness, ratio = values.T
        q = state.qpos[:, place.qpos]
        pull = stiffness * (q - ratio * state.qpos[:, place.other_qpos])
        state.applied_force[:, place.dof] -= pull
        state.applied_force[:, place.other_dof] += ratio * pull


def _are_near(parents: np.ndarray, dof: int, later: int) -> bool:
    """Whether joints are few apart along a chain, or are side by side.

    Args:
        parents: (nv) `dof_parentid` of the model.
        later: degree of freedom of another joint, with a larger number.
    """
    if parents[dof] == parents[later]:
        return True
    for _ in range(MAX_JOINTS_APART):
        later = parents[later]
        if later <= dof:
            break
    return later == dof


def _couple(place: Place, name: str, other: Joint | JointPlace) -> CoupledPlace:
    """The place of a joint that is coupled to another one, of that name."""
    return place.extend(
        CoupledPlace, other=name, other_dof=other.dof, other_qpos=other.qpos
    )


class Backlash(SecondJointEffect):
    name = "backlash"
    description = (
        "Play in the gear: after a reversal the link waits until the gap is crossed."
    )
    equation = "|q_link - q_motor| <= gap / 2"
    source = "MuJoCo manual, Modeling: Backlash, as two hinges"
    separate_by = "rock the joint slowly about a pose without load"
    phrase = "{at} has play of {gap} {lacks}"
    parameters = (ParameterSpec("gap", "rad", nominal=0.0, nonnegative=True),)
    suffix = "_play"
    # compared between 0.001 and 0.01: changes least where the gap is shut
    min_inertia_share = 0.003

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        reach = joint.range
        p = self.bound("gap", (0.0, reach), scale=0.03 * reach, at=joint)
        # a gap twice as wide as the true one explains as little as none
        return Proposal((p,), tuple((s * reach,) for s in (0.003, 0.008, 0.02, 0.05)))

    def joint_attributes(
        self, model: "MjModel", values: Floats
    ) -> dict[str, tuple[float, ...]]:
        half = max(float(values[0]) / 2, MIN_HALF_GAP)
        # the shortest time constant that MuJoCo computes; the damping ratio was
        # compared between 0.7 and 2: this one changes least where the gap is shut
        hard = 2 * model.opt.timestep, 0.7
        soft = 0.9, 0.95, 0.001, 0.5, 2.0  # MuJoCo's default
        return {"range": (-half, half), "solreflimit": hard, "solimplimit": soft}

    def compute_deflection(self, values: Floats, load: float) -> float:
        return float(np.sign(load) * values[0] / 2)


class Compliance(SecondJointEffect):
    name = "compliance"
    description = "A drive that bends: the link lags behind the motor by its load."
    equation = "tau = stiffness (q_motor - q_link) + damping (v_motor - v_link)"
    source = "Spong 1987, elastic joints"
    separate_by = "load the held joint with two known weights"
    phrase = "{at} gives way, with a stiffness of {stiffness} {lacks}"
    parameters = (
        ParameterSpec("stiffness", "N m/rad", nominal=np.inf, nonnegative=True),
        ParameterSpec("damping", "N m s/rad", nonnegative=True),
    )
    suffix = "_flex"

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        most = self._max_stiffness(robot, joint)
        damped = most * robot.timestep  # stops all that the joint does in one step
        k = min(joint.torque / (0.03 * joint.range), most / 5)
        d = min(0.3 * np.sqrt(k * joint.inertia), damped / 5)
        parameters = (
            self.bound("stiffness", (0.02 * k, most), scale=k, at=joint),
            self.bound("damping", (0.0, damped), scale=d, at=joint, nominal=d),
        )
        return Proposal(parameters, ((k, d), (0.3 * k, d), (5 * k, d)))

    def _max_stiffness(self, robot: RobotSummary, joint: Joint) -> float:
        """Stiffness [N m/rad or N/m] at which the joint swings once in six steps.

        MuJoCo takes a spring's torque as constant over a step: at three it diverges.
        """
        motor = self.motor_inertia(robot.model, joint_place(robot.model, joint.id))
        link = joint.inertia - float(robot.model.dof_armature[joint.dof])
        link = max(link, self.min_inertia_share * joint.inertia)
        return motor * link / (motor + link) / robot.timestep**2

    def joint_attributes(
        self, model: "MjModel", values: Floats
    ) -> dict[str, tuple[float, ...]]:
        k, d = map(float, values)
        return {"stiffness": (k, 0.0, 0.0), "damping": (d, 0.0, 0.0)}

    def compute_deflection(self, values: Floats, load: float) -> float:
        return float(load / values[0])
