"""Effects by the kind of their target: an effect at each joint, actuator, body, signal.

A subclass gives the parameters at one element of the robot; the terms follow.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from ..data.robot_summary import RobotSummary
from .base import Effect, Term
from .declaration import Parameter
from .places import Place, actuator_place, joint_place


class TargetEffect(Effect):
    """An effect that is proposed once at each element of a robot that it fits.

    Attributes:
        initial_shares: of the parameters' scales, by which the default initial values
            lie beside the nominal ones; chosen: within one step of a search.
    """

    initial_shares: tuple[float, ...] = (0.3, 1.0)

    def list_elements(self, robot: RobotSummary) -> Iterable[Any]:
        """The robot's elements of the effect's first target kind."""
        raise NotImplementedError

    def make_place(self, robot: RobotSummary, element: Any) -> Place:
        """The place of an element in the given model."""
        raise NotImplementedError

    def applies_to(self, robot: RobotSummary, element: Any) -> bool:
        """Whether the effect could be at an element."""
        return True

    def make_parameters(
        self, robot: RobotSummary, element: Any
    ) -> tuple[Parameter, ...]:
        """The declared parameters, with their bounds at an element."""
        raise NotImplementedError

    def make_initial_values(
        self, robot: RobotSummary, element: Any
    ) -> tuple[tuple[float, ...], ...]:
        """Values (p) that a fit may begin at, at an element."""
        parameters = self.make_parameters(robot, element)
        return tuple(
            tuple(p.nominal + share * p.scale for p in parameters)
            for share in self.initial_shares
        )

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term at each element that the effect applies to."""
        return [
            Term(
                self,
                (f"{self.target_kinds[0]}:{element.name}",),
                (self.make_place(robot, element),),
                self.make_parameters(robot, element),
                self.make_initial_values(robot, element),
            )
            for element in self.list_elements(robot)
            if self.applies_to(robot, element)
        ]


class JointEffect(TargetEffect):
    """An effect at each hinge and slide (`robot_summary.Joint`)."""

    target_kinds = ("joint",)

    def list_elements(self, robot):
        return robot.joints

    def make_place(self, robot, joint):
        return joint_place(robot.model, joint.id)


class ActuatorEffect(TargetEffect):
    """An effect at each actuator (`robot_summary.Actuator`), or at all of them alike.

    Attributes:
        is_shared: whether one cause, such as a bus, a supply or one make of servos,
            may change all actuators by the same values.
    """

    group = "actuator"
    target_kinds = ("actuator",)
    is_shared = False

    def list_elements(self, robot):
        return robot.actuators

    def make_place(self, robot, actuator):
        return actuator_place(robot.model, actuator.id)

    def propose_terms(self, robot):
        """One term at each actuator and, of a shared effect, one at all of them."""
        found = super().propose_terms(robot)
        units = {tuple(p.unit for p in t.parameters) for t in found}
        if self.is_shared and len(found) > 1 and len(units) == 1:
            targets = tuple(t.targets[0] for t in found)
            places = tuple(t.places[0] for t in found)
            found.append(replace(found[0], targets=targets, places=places))
        return found


class BodyEffect(TargetEffect):
    """An effect at each body that moves (`robot_summary.MovingBody`)."""

    group = "body"
    target_kinds = ("body",)
    rarity = 2

    def list_elements(self, robot):
        return robot.bodies

    def make_place(self, robot, body):
        return {"body": body.id}


class SensorEffect(TargetEffect):
    """An effect at each signal that is compared (`robot_summary.Channel`)."""

    group = "measurement"
    target_kinds = ("sensor",)
    initial_shares = (0.3,)

    def list_elements(self, robot):
        return robot.channels

    def make_place(self, robot, signal):
        return {"signal": signal.name, "kind": signal.kind}

    def applies_to(self, robot, signal):
        return signal.width == 1

    def transform_reading(self, place, values):
        return {self.parameters[0].name: values[:, 0]}


class WorldEffect(Effect):
    """An effect on all of the robot's surroundings."""

    group = "world"
    target_kinds: tuple[str, ...] = ("world",)

    def make_term(
        self,
        parameters: tuple[Parameter, ...],
        initial_values: tuple[tuple[float, ...], ...],
        place: Place | None = None,
    ) -> Term:
        """The term at the world.

        Args:
            parameters: with their bounds.
            initial_values: that a fit may begin at, each (p).
            place: what the effect needs to act there; None: nothing.
        """
        return Term(self, ("world",), (place or {},), parameters, initial_values)
