"""What a legged robot is to whoever recovers it: controllers in, readings out."""

from typing import Protocol

from ..body.body import Floats
from ..body.legged import LeggedRobot
from ..damage.kinds import Damage
from ..engine.reflex import Rollouts


class DrivenRobot(Protocol):
    """A robot that runs under neural controllers."""

    @property
    def legged(self) -> LeggedRobot:
        """Its body as it was built."""
        ...

    def run_trials(self, weights: Floats) -> Rollouts:
        """Run from rest under controllers (N, synapses), one after the other.

        Returns:
            What it sensed and how far it came; the path is for reports, nobody who
            recovers the robot may look at it.
        """
        ...

    def struck(self, damage: tuple[Damage, ...]) -> "DrivenRobot":
        """This robot after a damage."""
        ...
