"""Friction in a joint, beyond what the model states.

A parameter that MJCF has too (damping, frictionloss) is the joint's new total. It takes
the place of what the model states, also of that value when it is fitted again.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import Joint, RobotSummary
from .base import Term
from .by_target import JointEffect
from .declaration import (
    UNUSUAL,
    USUAL,
    FindingField,
    Parameter,
    ParameterSpec,
    Proposal,
    start_beside,
)
from .places import JointPlace
from .protocols import JointForce, ModelEdit, StepState

if TYPE_CHECKING:
    from mujoco import MjModel

BOTH = "both"  # sides of a gear
# share of a friction by which its two directions have to differ; chosen: less is
# Coulomb friction
MIN_ASYMMETRY = 0.05


def torque_scale(robot: RobotSummary, joint: Joint) -> float:
    """Torque [N m or N] in which bounds of a joint's torques are given.

    The joint's typical torque does not count what motors give, so a third of what they
    were commanded at most does.
    """
    commanded = [a.max_force / 3 for a in robot.actuators if a.dof == joint.dof]
    return max([joint.torque, *commanded])


class FrictionEffect(JointEffect):
    """An effect at each hinge and slide, of its friction."""

    group = "friction"


class ViscousFriction(FrictionEffect, ModelEdit[JointPlace]):
    name = "viscous_friction"
    description = "A torque against the motion, proportional to speed."
    equation = "tau = -damping v"
    source = "MuJoCo joint/damping"
    separate_by = "let the joint swing with the motor off"
    phrase = "{at} has viscous friction of {damping} {lacks}"
    parameters = (
        ParameterSpec("damping", "N m s/rad", nonnegative=True, is_in_model=True),
    )
    log_odds = USUAL
    overrides = ("damping",)

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        scale = 0.2 * joint.torque / joint.speed
        now = float(robot.model.dof_damping[joint.dof])
        high = 10 * torque_scale(robot, joint) / joint.speed + 10 * now
        p = self.bound("damping", (0.0, high), scale=scale, at=joint, nominal=now)
        none = ((0.0,),) if now else ()
        return Proposal((p,), (*start_beside((p,), 0.3, 2), (now / 2,), *none))

    def edit_model(self, model: "MjModel", place: JointPlace, values: Floats) -> None:
        model.dof_damping[place.dof] = values[0]


class QuadraticDamping(FrictionEffect, ModelEdit[JointPlace]):
    name = "quadratic_damping"
    description = "A torque against the motion that grows with the square of speed."
    equation = "tau = -damping2 v |v|"
    source = "MuJoCo joint/damping, second coefficient (3.7)"
    separate_by = "swing the joint once slowly and once at full speed"
    phrase = "{at} has drag of {damping2} {lacks}"
    parameters = (
        ParameterSpec("damping2", "N m s^2/rad^2", nonnegative=True, is_in_model=True),
    )

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        scale = 0.2 * joint.torque / joint.speed**2
        now = float(robot.model.dof_dampingpoly[joint.dof, 0])
        high = 10 * torque_scale(robot, joint) / joint.speed**2 + 10 * now
        p = self.bound("damping2", (0.0, high), scale=scale, at=joint, nominal=now)
        return Proposal((p,), start_beside((p,), 0.3, 1))

    def edit_model(self, model: "MjModel", place: JointPlace, values: Floats) -> None:
        model.dof_dampingpoly[place.dof, 0] = values[0]


class DryFriction(FrictionEffect, ModelEdit[JointPlace]):
    """Dry friction of a joint, whose first value takes the place of the model's."""

    overrides = ("frictionloss",)

    def bound_torque(
        self, name: str, robot: RobotSummary, joint: Joint, share: float = 1
    ) -> Parameter:
        """A torque of dry friction, with the model's as its nominal value.

        Args:
            share: of the usual bound, that is its largest value [1].
        """
        now = float(robot.model.dof_frictionloss[joint.dof])
        high = share * (3 * torque_scale(robot, joint) + 10 * now)
        scale = 0.1 * joint.torque
        return self.bound(name, (0.0, high), scale=scale, at=joint, nominal=now)

    def edit_model(self, model: "MjModel", place: JointPlace, values: Floats) -> None:
        model.dof_frictionloss[place.dof] = values[0]


class CoulombFriction(DryFriction):
    name = "coulomb_friction"
    description = "A constant torque against the motion; at rest it holds."
    equation = "tau = -frictionloss sign(v)"
    source = "MuJoCo joint/frictionloss"
    separate_by = "move the joint back and forth at two constant speeds"
    phrase = "{at} has dry friction of {frictionloss} {lacks}"
    parameters = (
        ParameterSpec("frictionloss", "N m", nonnegative=True, is_in_model=True),
    )
    log_odds = USUAL

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        p = self.bound_torque("frictionloss", robot, joint)
        none = ((0.0,),) if p.nominal else ()
        return Proposal((p,), (*start_beside((p,), 0.3, 1.5), *none))


class StribeckFriction(DryFriction, JointForce[JointPlace]):
    """A total, like `coulomb_friction`: nominal, both torques are the model's."""

    name = "stribeck_friction"
    description = (
        "Dry friction that is larger at rest and falls as the joint starts to move."
    )
    equation = "tau = -(coulomb + (static - coulomb) exp(-(v/v_s)^2)) sign(v)"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30"
    separate_by = "ramp the joint slower than the Stribeck velocity for 20 s"
    phrase = "{at} has dry friction {lacks}: {static} at rest, {coulomb} in motion"
    parameters = (
        ParameterSpec("coulomb", "N m", nonnegative=True),
        ParameterSpec("static", "N m", nonnegative=True),
        ParameterSpec("stribeck_velocity", "rad/s", nonnegative=True),
    )

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        v = joint.speed
        coulomb = self.bound_torque("coulomb", robot, joint)
        static = self.bound_torque("static", robot, joint, share=2)
        speed = self.bound(
            "stribeck_velocity", (1e-3 * v, v), scale=0.1 * v, at=joint, nominal=0.1 * v
        )
        now, t = coulomb.nominal, coulomb.scale
        starts = ((0.3, 1, 0.1), (1, 3, 0.1), (1, 3, 0.02))
        return Proposal(
            (coulomb, static, speed),
            tuple((now + a * t, now + b * t, c * v) for a, b, c in starts),
        )

    def is_consistent(self, parameters: Sequence[Parameter], values: Floats) -> bool:
        return bool(values[1] > values[0])

    def apply_forces(self, state: StepState, place: JointPlace, values: Floats) -> None:
        dof = place.dof
        coulomb, static, speed = values.T
        slow = np.exp(-((state.qvel[:, dof] / speed) ** 2))
        state.frictionloss[:, dof] += (static - coulomb) * slow


@dataclass(frozen=True, kw_only=True)
class GearPlace(JointPlace):
    """A joint behind a gear.

    Attributes:
        side: "both" where the load drives the gear as well; None: the motor alone.
    """

    side: str | None = None


class LoadDependentFriction(FrictionEffect, JointForce[GearPlace]):
    """Friction of what the motor gives, or of the mean of that and the load.

    The mean (BAM's gearbox torque, halved) is of a gear that the load drives as well.
    """

    name = "load_dependent_friction"
    description = (
        "Dry friction of a gear that grows with the torque it transmits: the motor's, "
        'or with `"side": "both"` the mean of the motor\'s and the load\'s.'
    )
    equation = "tau = -(frictionloss + load_coefficient |tau_transmitted|) sign(v)"
    source = "Rhoban BAM (Duclusaud 2024), load-dependent models"
    separate_by = "repeat the same motion with another payload"
    phrase = (
        "{at} has friction {lacks}: {load_coefficient} of the torque that it passes on"
    )
    parameters = (
        ParameterSpec("load_coefficient", "1", nominal=0.0, nonnegative=True),
    )
    finding_fields = (FindingField("side", (BOTH,), is_required=False),)
    place_type = GearPlace
    log_odds = USUAL
    needs = frozenset({"actuator_torque", "bias_torque"})

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal | None:
        if not any(a.dof == joint.dof for a in robot.actuators):
            return None
        p = self.bound("load_coefficient", (0.0, 1.5), scale=0.1)
        return Proposal((p,), start_beside((p,), 0.3, 1))

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term at each driven joint, and one of both sides of its gear.

        Of the motor's side alone where something touches the robot: contact forces
        load its joints then, and the second side stands for weight and motion only.
        """
        found = super().propose_terms(robot)
        if robot.has_contact:
            return found
        return [*found, *map(self._use_both_sides, found)]

    @staticmethod
    def _use_both_sides(term: Term) -> Term:
        """The term with the mean of both sides of the gear as its load."""
        (place,) = term.places
        assert isinstance(place, GearPlace)  # by `place_type`
        return replace(term, places=(replace(place, side=BOTH),), log_odds=UNUSUAL)

    def apply_forces(self, state: StepState, place: GearPlace, values: Floats) -> None:
        dof = place.dof
        load = state.actuator_torque[:, dof]
        if place.side == BOTH:
            load = (load + state.bias_torque[:, dof]) / 2
        state.frictionloss[:, dof] += values[:, 0] * np.abs(load)


class AsymmetricFriction(DryFriction, JointForce[JointPlace]):
    """A total, like `coulomb_friction`: nominal, both torques are the model's."""

    name = "asymmetric_friction"
    description = "Dry friction of different size in the two directions."
    equation = "tau = -positive where v > 0, +negative where v < 0"
    source = "Corke 1996, A Robotics Toolbox for MATLAB: Link.Tc"
    separate_by = "move at the same constant speed both ways, without gravity"
    phrase = "{at} has dry friction {lacks}: {positive} one way, {negative} the other"
    parameters = (
        ParameterSpec("positive", "N m", nonnegative=True),
        ParameterSpec("negative", "N m", nonnegative=True),
    )

    def propose_at(self, robot: RobotSummary, joint: Joint) -> Proposal:
        both = [self.bound_torque(s, robot, joint) for s in ("positive", "negative")]
        now, t = both[0].nominal, both[0].scale
        pairs = ((1, 0.3), (0.3, 1), (3, 1), (1, 3))
        starts = tuple((now + a * t, now + b * t) for a, b in pairs)
        return Proposal(tuple(both), starts)

    def is_consistent(self, parameters: Sequence[Parameter], values: Floats) -> bool:
        return bool(np.ptp(values) > MIN_ASYMMETRY * np.max(values))

    # a mean friction and a constant torque: the same, also where the joint sticks
    def edit_model(self, model: "MjModel", place: JointPlace, values: Floats) -> None:
        model.dof_frictionloss[place.dof] = values.mean()

    def apply_forces(self, state: StepState, place: JointPlace, values: Floats) -> None:
        state.applied_force[:, place.dof] -= (values[:, 0] - values[:, 1]) / 2
