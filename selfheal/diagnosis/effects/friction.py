"""Friction in a joint, beyond what the model states.

A parameter that MJCF has too (damping, frictionloss) is the joint's new total. It takes
the place of what the model states, also of that value refitted.
"""

from dataclasses import replace

import numpy as np

from ..data.robot_summary import RobotSummary
from .base import Effect, Parameter, Term, extend_places

BOTH = "both"  # sides of a gear
ALIKE = 0.05  # of a friction, by which its two directions may differ; chosen


class JointEffect(Effect):
    """What all of them share: a joint that moves."""

    group = "friction"

    def make_parameters(self, robot: RobotSummary, joint) -> tuple[Parameter, ...]:
        """Its numbers at a joint; `joint` is a `scene.Joint`."""
        raise NotImplementedError

    def make_initial_values(
        self, robot: RobotSummary, joint
    ) -> tuple[tuple[float, ...], ...]:
        """Values to begin a search at."""
        return tuple(
            tuple(
                p.nominal + share * p.scale for p in self.make_parameters(robot, joint)
            )
            for share in (0.3, 1.0)
        )

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """At every hinge and slide."""
        return [
            Term(
                self,
                (f"joint:{joint.name}",),
                ({"joint": joint.id, "dof": joint.dof},),
                self.make_parameters(robot, joint),
                self.make_initial_values(robot, joint),
            )
            for joint in robot.joints
        ]


def torque_scale(robot: RobotSummary, joint) -> float:
    """What bounds of torques go by [N m or N].

    The joint's typical torque does not count what motors give, so a third of what they
    were asked for at most does.
    """
    asked = [a.max_force / 3 for a in robot.actuators if a.dof == joint.dof]
    return max([joint.torque, *asked])


class ViscousFriction(JointEffect):
    name = "viscous_friction"
    is_common = True
    overrides = ("damping",)
    description = "A torque against the motion, proportional to speed."
    equation = "tau = -damping v"
    source = "MuJoCo joint/damping"
    separate_by = "let the joint swing with the motor off"
    regime = "fast"

    def make_parameters(self, robot, joint):
        unit = f"{joint.force} s/{joint.unit}"
        scale = 0.2 * joint.torque / joint.speed
        now = float(robot.model.dof_damping[joint.dof])
        high = 10 * torque_scale(robot, joint) / joint.speed + 10 * now
        return (Parameter("damping", unit, now, 0.0, high, scale),)

    def make_initial_values(self, robot, joint):
        (p,) = self.make_parameters(robot, joint)
        return (
            (p.nominal + 0.3 * p.scale,),
            (p.nominal + 2 * p.scale,),
            (p.nominal / 2,),
        )

    def edit_model(self, model, place, values):
        model.dof_damping[place["dof"]] = values[0]


class QuadraticDamping(JointEffect):
    name = "quadratic_damping"
    description = "A torque against the motion that grows with the square of speed."
    equation = "tau = -damping2 v |v|"
    source = "MuJoCo joint/damping, second coefficient (3.7)"
    separate_by = "swing the joint once slowly and once at full speed"
    regime = "fast"

    def make_parameters(self, robot, joint):
        unit = f"{joint.force} s^2/{joint.unit}^2"
        scale = 0.2 * joint.torque / joint.speed**2
        now = float(robot.model.dof_dampingpoly[joint.dof, 0])
        high = 10 * torque_scale(robot, joint) / joint.speed**2 + 10 * now
        return (Parameter("damping2", unit, now, 0.0, high, scale),)

    def edit_model(self, model, place, values):
        model.dof_dampingpoly[place["dof"], 0] = values[0]


class CoulombFriction(JointEffect):
    name = "coulomb_friction"
    is_common = True
    overrides = ("frictionloss",)
    description = "A constant torque against the motion; at rest it holds."
    equation = "tau = -frictionloss sign(v)"
    source = "MuJoCo joint/frictionloss"
    separate_by = "move the joint back and forth at two constant speeds"
    regime = "reversal"

    def make_parameters(self, robot, joint):
        now, scale, high = _dry_friction_bounds(robot, joint)
        return (Parameter("frictionloss", joint.force, now, 0.0, high, scale),)

    def make_initial_values(self, robot, joint):
        (p,) = self.make_parameters(robot, joint)
        return ((p.nominal + 0.3 * p.scale,), (p.nominal + 1.5 * p.scale,))

    def edit_model(self, model, place, values):
        model.dof_frictionloss[place["dof"]] = values[0]


def _dry_friction_bounds(robot: RobotSummary, joint) -> tuple[float, float, float]:
    """Dry friction of a joint [N m or N]: as stated, a search's step, the largest."""
    now = float(robot.model.dof_frictionloss[joint.dof])
    return now, 0.1 * joint.torque, 3 * torque_scale(robot, joint) + 10 * now


class StribeckFriction(JointEffect):
    """A total, like `coulomb_friction`: absent, both torques are what is stated."""

    name = "stribeck_friction"
    overrides = ("frictionloss",)
    description = (
        "Dry friction that is larger at rest and falls as the joint starts to move."
    )
    equation = "tau = -(coulomb + (static - coulomb) exp(-(v/v_s)^2)) sign(v)"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit 1994, Automatica 30"
    separate_by = "ramp the joint slower than the Stribeck velocity for 20 s"
    regime = "slow"

    def make_parameters(self, robot, joint):
        now, scale, high = _dry_friction_bounds(robot, joint)
        speed = f"{joint.unit}/s"
        return (
            Parameter("coulomb", joint.force, now, 0.0, high, scale),
            Parameter("static", joint.force, now, 0.0, 2 * high, scale),
            Parameter(
                "stribeck_velocity", speed, 0.1 * joint.speed, 1e-3 * joint.speed,
                joint.speed, 0.1 * joint.speed,
            ),
        )  # fmt: skip

    def make_initial_values(self, robot, joint):
        (now, t, _), v = _dry_friction_bounds(robot, joint), joint.speed
        return (
            (now + 0.3 * t, now + t, 0.1 * v), (now + t, now + 3 * t, 0.1 * v),
            (now + t, now + 3 * t, 0.02 * v),
        )  # fmt: skip

    def is_consistent(self, values):
        return bool(values[1] > values[0])

    def edit_model(self, model, place, values):
        model.dof_frictionloss[place["dof"]] = values[0]

    def apply_forces(self, state, place, values):
        dof = place["dof"]
        coulomb, static, speed = values.T
        slow = np.exp(-((state.qvel[:, dof] / speed) ** 2))
        state.frictionloss[:, dof] += (static - coulomb) * slow


class LoadDependentFriction(JointEffect):
    """Of what the motor gives, or of that and what the load asks for in the mean.

    The mean (BAM's gearbox torque, halved) is of a gear that the load drives as well.
    """

    name = "load_dependent_friction"
    is_common = True
    description = (
        "Dry friction of a gear that grows with the torque it transmits: the motor's, "
        'or with `"side": "both"` the mean of the motor\'s and the load\'s.'
    )
    equation = "tau = -(frictionloss + load_coefficient |tau_transmitted|) sign(v)"
    source = "Rhoban BAM (Duclusaud 2024), load-dependent models"
    separate_by = "repeat the same motion with another payload"
    regime = "high_load"

    def make_parameters(self, robot, joint):
        return (Parameter("load_coefficient", "1", 0.0, 0.0, 1.5, 0.1),)

    def propose_terms(self, robot):
        """At each driven joint; of both sides where nothing but its weight loads it."""
        own = [term for term in super().propose_terms(robot) if _is_driven(robot, term)]
        return own if robot.has_contact else [*own, *map(_use_both_sides, own)]

    def is_usual(self, term):
        return super().is_usual(term) and not term.finding_fields

    def apply_forces(self, state, place, values):
        dof = place["dof"]
        load = state.actuator_torque[:, dof]
        if place.get("side") == BOTH:
            load = (load + state.bias_torque[:, dof]) / 2
        state.frictionloss[:, dof] += values[:, 0] * np.abs(load)


def _use_both_sides(term: Term) -> Term:
    return replace(extend_places(term, side=BOTH), finding_fields={"side": BOTH})


def _is_driven(robot: RobotSummary, term: Term) -> bool:
    return any(a.dof == term.places[0]["dof"] for a in robot.actuators)


class AsymmetricFriction(JointEffect):
    """A total, like `coulomb_friction`: absent, both torques are what is stated."""

    name = "asymmetric_friction"
    overrides = ("frictionloss",)
    description = "Dry friction of different size in the two directions."
    equation = "tau = -positive where v > 0, +negative where v < 0"
    source = "Corke 1996, A Robotics Toolbox for MATLAB: Link.Tc"
    separate_by = "move at the same constant speed both ways, without gravity"
    regime = "reversal"

    def make_parameters(self, robot, joint):
        now, scale, high = _dry_friction_bounds(robot, joint)
        return (
            Parameter("positive", joint.force, now, 0.0, high, scale),
            Parameter("negative", joint.force, now, 0.0, high, scale),
        )

    def is_consistent(self, values):
        return bool(np.ptp(values) > ALIKE * np.max(values))

    def make_initial_values(self, robot, joint):
        now, t, _ = _dry_friction_bounds(robot, joint)
        pairs = ((1, 0.3), (0.3, 1), (3, 1), (1, 3))
        return tuple((now + a * t, now + b * t) for a, b in pairs)

    # a mean friction and a constant torque: the same, also where the joint sticks
    def edit_model(self, model, place, values):
        model.dof_frictionloss[place["dof"]] = values.mean()

    def apply_forces(self, state, place, values):
        state.applied_force[:, place["dof"]] -= (values[:, 0] - values[:, 1]) / 2
