"""A simulated legged robot: what broke, and how it differs from its model, hidden."""

from dataclasses import dataclass, replace

import numpy as np

from ..body.body import Floats
from ..body.legged import LeggedRobot
from ..damage.apply import build_damaged_plants
from ..damage.kinds import Damage
from ..engine.reflex import LeggedPlants, Rollouts, scale_physics, simulate_controllers


@dataclass(frozen=True)
class SimulatedLegs:
    """The "physical" robot of 2004, which was a simulation too.

    Attributes:
        legged: the body as it was built.
        seed: of what differs.
        gap: share by which friction, masses and motors may be off the model; 0 as in
            2004, where robot and model were one simulator.
        damage: what happened to it.
    """

    legged: LeggedRobot
    seed: int
    gap: float = 0.0
    damage: tuple[Damage, ...] = ()

    def run_trials(self, weights: Floats) -> Rollouts:
        """Run under controllers (N, synapses); see `base.DrivenRobot`."""
        return simulate_controllers(self._build_hidden_plants(len(weights)), weights)

    def struck(self, damage: tuple[Damage, ...]) -> "SimulatedLegs":
        """This robot after a damage."""
        return replace(self, damage=damage)

    def _build_hidden_plants(self, count: int) -> LeggedPlants:
        """The plant behind the robot, so many times."""
        plants = build_damaged_plants(self.legged, [self.damage] * count)
        rng = np.random.default_rng([self.seed, 41])
        off = rng.uniform(1 - self.gap, 1 + self.gap, 2 + len(self.legged.motors))
        return scale_physics(plants, off)
