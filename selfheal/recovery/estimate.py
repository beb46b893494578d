"""The estimation search of 2004: trials in, the damage that explains their ways out.

A genome has four genes of four values: dormant or active, the kind of damage, where,
and a fourth that is not used (overview.txt 4.3). Only the forward displacement of each
trial counts.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.body import Floats
from ..body.legged import LeggedRobot
from ..damage.apply import build_damaged_plants, reduce_damages
from ..damage.kinds import KINDS, Damage
from ..engine.reflex import simulate_controllers
from ..evolution.genetic import Score

GENES, VALUES = 4, 4
ESTIMATED_KINDS = tuple(kind.name for kind in KINDS.values() if kind.is_estimated)

Hypothesis = tuple[Damage, ...]


@dataclass(frozen=True)
class Trial:
    """What a robot answered to a controller.

    Attributes:
        weights: (W) of the controller's synapses [1].
        displacement: forward displacement [m]; -inf where there was none to measure.
        sensors: (T, S) sensor values over time; see `engine.reflex.Rollouts`.
    """

    weights: Floats
    displacement: float
    sensors: Floats


def decode_hypotheses(genomes: Floats, robot: LeggedRobot) -> list[Hypothesis]:
    """The damage that each genome (N, GENES * VALUES) says."""
    genes = (genomes.reshape(-1, GENES, VALUES) + 1) / 2  # each value in [0, 1]
    return [
        reduce_damages(
            robot, [_decode_damage(g, robot) for g in row if round(g[0]) == 1]
        )
        for row in genes
    ]


def _decode_damage(gene: Floats, robot: LeggedRobot) -> Damage:
    """The damage of an active gene (VALUES), its values scaled to [0, 1]."""
    kind = KINDS[ESTIMATED_KINDS[round((len(ESTIMATED_KINDS) - 1) * gene[1])]]
    names = kind.list_estimated_places(robot)
    at = min(int(gene[2] * len(names)), len(names) - 1)
    return Damage(kind.name, kind.make_target(names[at]))


def make_damage_score(robot: LeggedRobot, trials: Sequence[Trial]) -> Score:
    """How well genomes explain the trials: minus the summed error of the ways [m].

    Genomes that say the same damage are simulated once.
    """
    known: dict[Hypothesis, float] = {}

    def score(genomes: Floats) -> Floats:
        said = decode_hypotheses(genomes, robot)
        new = [h for h in dict.fromkeys(said) if h not in known]
        if new:
            plants = build_damaged_plants(robot, new)
            error = np.zeros(len(new))
            for trial in trials:
                weights = np.tile(trial.weights, (len(new), 1))
                drives = simulate_controllers(plants, weights)
                error += np.abs(drives.displacement - trial.displacement)
            known.update(zip(new, -error, strict=True))
        return np.array([known[h] for h in said])

    return score
