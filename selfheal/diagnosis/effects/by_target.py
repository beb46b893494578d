"""Effects by the kind of their target: an effect at each joint, actuator, body, signal.

A subclass gives the parameters at one element of the robot; the terms follow.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Generic, Protocol, TypeVar

from ...recording.data import Floats
from ..data.robot_summary import Actuator, Channel, Joint, MovingBody, RobotSummary
from .base import Effect, Term
from .declaration import RARE, UNUSUAL, Parameters, Starts
from .places import (
    ActuatorPlace,
    BodyPlace,
    JointPlace,
    Place,
    SignalPlace,
    actuator_place,
    joint_place,
)
from .protocols import SensorMap


class Element(Protocol):
    """What has a name in a model or a recording."""

    @property
    def name(self) -> str:
        """The name."""


E = TypeVar("E", bound=Element)


class TargetEffect(Effect, Generic[E]):
    """An effect that is proposed once at each element of a robot that it fits.

    Attributes:
        initial_shares: of the parameters' scales, by which the default initial values
            lie beside the nominal ones; chosen: within one step of a search.
    """

    initial_shares: tuple[float, ...] = (0.3, 1.0)

    @abstractmethod
    def list_elements(self, robot: RobotSummary) -> Sequence[E]:
        """The robot's elements of the effect's first target kind."""

    @abstractmethod
    def make_place(self, robot: RobotSummary, element: E) -> Place:
        """The place of an element in the given model."""

    @abstractmethod
    def make_parameters(self, robot: RobotSummary, element: E) -> Parameters:
        """The declared parameters, with their bounds at an element."""

    def applies_to(self, robot: RobotSummary, element: E) -> bool:
        """Whether the effect could be at an element."""
        return True

    def find_log_odds(self, robot: RobotSummary, element: E) -> float:
        """Log-odds at an element, beside what is usual [nats]."""
        return self.log_odds

    def make_initial_values(self, robot: RobotSummary, element: E) -> Starts:
        """Values (p) that a fit may begin at, at an element."""
        parameters = self.make_parameters(robot, element)
        return tuple(
            tuple(p.nominal + share * p.scale for p in parameters)
            for share in self.initial_shares
        )

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term at each element that the effect applies to."""
        return [
            self.make_term(
                f"{self.target_kinds[0]}:{element.name}",
                self.make_place(robot, element),
                self.make_parameters(robot, element),
                self.make_initial_values(robot, element),
                self.find_log_odds(robot, element),
            )
            for element in self.list_elements(robot)
            if self.applies_to(robot, element)
        ]


def join_terms(terms: Sequence[Term]) -> Term:
    """One term at the targets of several, with the parameters of the first."""
    return replace(
        terms[0],
        targets=tuple(t.targets[0] for t in terms),
        places=tuple(t.places[0] for t in terms),
        log_odds=min(terms[0].log_odds, UNUSUAL),
    )


class JointEffect(TargetEffect[Joint]):
    """An effect at each hinge and slide."""

    target_kinds = ("joint",)

    def list_elements(self, robot: RobotSummary) -> Sequence[Joint]:
        return robot.joints

    def make_place(self, robot: RobotSummary, element: Joint) -> JointPlace:
        return joint_place(robot.model, element.id)


class ActuatorEffect(TargetEffect[Actuator]):
    """An effect at each actuator, or at all of them alike.

    Attributes:
        is_shared: whether one cause, such as a bus, a supply or one make of servos,
            may change all actuators by the same values.
    """

    group = "actuator"
    target_kinds = ("actuator",)
    is_shared = False

    def list_elements(self, robot: RobotSummary) -> Sequence[Actuator]:
        return robot.actuators

    def make_place(self, robot: RobotSummary, element: Actuator) -> ActuatorPlace:
        return actuator_place(robot.model, element.id)

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term at each actuator and, of a shared effect, one at all of them."""
        found = super().propose_terms(robot)
        units = {tuple(p.unit for p in t.parameters) for t in found}
        if self.is_shared and len(found) > 1 and len(units) == 1:
            found.append(join_terms(found))
        return found


class BodyEffect(TargetEffect[MovingBody]):
    """An effect at each body that moves."""

    group = "body"
    target_kinds = ("body",)
    log_odds = RARE

    def list_elements(self, robot: RobotSummary) -> Sequence[MovingBody]:
        return robot.bodies

    def make_place(self, robot: RobotSummary, element: MovingBody) -> BodyPlace:
        return BodyPlace(body=element.id)


class SensorEffect(TargetEffect[Channel], SensorMap[SignalPlace]):
    """An effect at each signal that is compared."""

    group = "measurement"
    target_kinds = ("sensor",)
    initial_shares = (0.3,)

    def list_elements(self, robot: RobotSummary) -> Sequence[Channel]:
        return robot.channels

    def make_place(self, robot: RobotSummary, element: Channel) -> SignalPlace:
        return SignalPlace(signal=element.name, kind=element.kind)

    def applies_to(self, robot: RobotSummary, element: Channel) -> bool:
        return element.width == 1

    def transform_reading(
        self, place: SignalPlace, values: Floats
    ) -> Mapping[str, Floats]:
        return {self.parameters[0].name: values[:, 0]}


class WorldEffect(Effect):
    """An effect on all of the robot, or on its surroundings."""

    group = "world"
    target_kinds: tuple[str, ...] = ("world",)
