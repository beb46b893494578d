"""The released rule of 2006 after damage: a known tree in, the scale of each part out.

Constants are from papers.md 1.3 and 1.4 (the program released with paper A).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.random import Generator

from ..body.body import Bodies, Floats, scale_parts
from ..body.genome import Genomes
from ..engine import make_engine
from ..robot.base import Robot
from ..robot.rest_readings import read_rest_channels
from .evaluate import PAPER_LOSS, Evaluator, Evidence
from .paper import CEILING, CLIMBERS, Climbers
from .strategy import ReleasedRule

SCALES = (0.1, 2.0)


@dataclass
class ScaleSearch(Climbers):
    """Genes are factors on the parts of a known body (`body.scale_parts`).

    Attributes:
        known: (1) the body before the damage.
    """

    known: Genomes = field(kw_only=True)

    def decode_genes(self, genes: Floats) -> Genomes:
        """The known tree, as often as there are genes (N, P)."""
        return self.known[np.zeros(len(genes), np.int64)]

    def build_bodies(self, genomes: Genomes, genes: Floats) -> Bodies:
        """Bodies with their parts scaled by factors (N, P)."""
        return scale_parts(super().build_bodies(genomes, genes), genes)

    def draw_first(self, rng: Generator) -> Floats:
        """Factors (CLIMBERS, P) of one: the known body."""
        return np.ones((CLIMBERS, self.evaluator.anatomy.size))

    def draw_child(self, genes: Floats, rng: Generator) -> Floats:
        """Factors (P), of which one is multiplied by 1 +- e^b or drawn anew.

        The exponent b is uniform in (-5, 0).
        """
        genes = genes.copy()
        k = int(rng.integers(len(genes)))
        if rng.random() < 0.5:
            genes[k] *= 1 + np.exp(rng.uniform(-5, 0)) * rng.choice([-1.0, 1.0])
        else:
            genes[k] = rng.uniform(*SCALES)
        return np.clip(genes, *SCALES)


@dataclass(frozen=True)
class ScaleEstimate:
    """What is believed after an action.

    Attributes:
        action: index into the robot's actions.
        scale: (P) factors of the best model.
        spent: simulations for the search since the start.
        spent_choosing: simulations for choosing since the start.
    """

    action: int
    scale: Floats
    spent: int
    spent_choosing: int


def estimate_scales(
    robot: Robot, known: Genomes, *, method: str, cycles: int, seed: int
) -> Iterator[ScaleEstimate]:
    """Find out how long a damaged robot's parts are, a yield an action.

    Args:
        known: (1) the body before the damage; its tree and placements stay.
        method: "paper", "disagreement", "random-batch" or "random-alternate".
    """
    engine = make_engine("statics")
    evaluator = Evaluator(robot.anatomy, engine, actions=robot.actions, loss=PAPER_LOSS)
    finder = ScaleSearch(evaluator, known=known)
    rule, evidence = ReleasedRule(finder, method, cycles), Evidence.empty(3)
    rng = np.random.default_rng([seed, 11])
    while len(evidence) < cycles:
        action, _ = rule.choose_action(evidence, rng)
        measured = read_rest_channels(robot.act(action), robot.anatomy)
        evidence = evidence.add(action, measured)
        rule.search_bodies(evidence, CEILING, rng)
        best = finder.genes[int(np.argmin(finder.losses))]
        yield ScaleEstimate(
            action, best.copy(), evaluator.spent, evaluator.spent_choosing
        )
