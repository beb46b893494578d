"""Effects by the kind of their target: an effect at each joint, actuator, body, signal.

A subclass gives the parameters and the initial values at one element of the robot; the
terms follow.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Generic, Protocol, TypeVar

from ...recording.data import Floats
from ..data.robot_summary import Actuator, Channel, Joint, MovingBody, RobotSummary
from .base import Effect, Term
from .declaration import RARE, UNUSUAL, Proposal
from .places import BodyPlace, Place, SignalPlace, actuator_place, joint_place
from .protocols import SensorMap


class Element(Protocol):
    """What has a name in a model or a recording."""

    @property
    def name(self) -> str:
        """The name."""


E = TypeVar("E", bound=Element)


class TargetEffect(Effect, Generic[E]):
    """An effect that is proposed once at each element of a robot that it fits."""

    @abstractmethod
    def list_places(self, robot: RobotSummary) -> Sequence[tuple[E, Place]]:
        """The robot's elements of the effect's first target kind, and their places."""

    @abstractmethod
    def propose_at(self, robot: RobotSummary, element: E) -> Proposal | None:
        """Parameters and initial values at an element; None: it cannot be there."""

    def propose_terms(self, robot: RobotSummary) -> list[Term]:
        """One term at each place where the effect could be."""
        return [
            self.make_term(
                f"{self.target_kinds[0]}:{element.name}",
                self.complete_place(place, {}),
                proposal,
            )
            for element, place in self.list_places(robot)
            if (proposal := self.propose_at(robot, element)) is not None
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

    def list_places(self, robot: RobotSummary) -> Sequence[tuple[Joint, Place]]:
        return [(e, joint_place(robot.model, e.id)) for e in robot.joints]


class ActuatorEffect(TargetEffect[Actuator]):
    """An effect at each actuator, or at all of them alike.

    Attributes:
        is_shared: whether one cause, such as a bus, a supply or one make of servos,
            may change all actuators by the same values.
    """

    group = "actuator"
    target_kinds = ("actuator",)
    is_shared = False

    def list_places(self, robot: RobotSummary) -> Sequence[tuple[Actuator, Place]]:
        return [(e, actuator_place(robot.model, e.id)) for e in robot.actuators]

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

    def list_places(self, robot: RobotSummary) -> Sequence[tuple[MovingBody, Place]]:
        return [(e, BodyPlace(body=e.id)) for e in robot.bodies]


class SensorEffect(TargetEffect[Channel], SensorMap[SignalPlace]):
    """An effect at each signal that is compared."""

    group = "measurement"
    target_kinds = ("sensor",)

    def list_places(self, robot: RobotSummary) -> Sequence[tuple[Channel, Place]]:
        return [(c, SignalPlace(signal=c.name, kind=c.kind)) for c in robot.channels]

    def transform_reading(
        self, place: SignalPlace, values: Floats
    ) -> Mapping[str, Floats]:
        return {self.parameters[0].name: values[:, 0]}


class WorldEffect(Effect):
    """An effect on all of the robot, or on its surroundings."""

    group = "world"
    target_kinds: tuple[str, ...] = ("world",)
