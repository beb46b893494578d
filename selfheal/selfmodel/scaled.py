"""The released rule of 2006 after damage: a known tree in, the scale of each part out.

Constants are from papers.md 1.3 and 1.4 (the program released with paper A).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ..body.body import Bodies, Floats, scale_parts
from ..body.genome import Genomes, build
from ..engine import make_engine
from ..robot.base import Robot
from .evaluate import PAPER_LOSS, Evaluator, Evidence
from .loop import felt
from .paper import CLIMBERS, Climbers, shaken
from .strategy import Rule

SCALES = (0.1, 2.0)


@dataclass
class ScaleSearch(Climbers):
    """Genes are factors on the parts of a known body (`body.scale_parts`).

    Attributes:
        known: (1) the body before the damage.
    """

    known: Genomes = field(kw_only=True)

    def bodies(self, genes: Floats) -> Bodies:
        """The known body with other parts."""
        return self._scaled(self._copies(len(genes)), genes)

    def first(self, rng: np.random.Generator) -> Floats:
        """The known body, fifteen times."""
        return np.ones((CLIMBERS, self.evaluator.anatomy.size))

    def child(self, genes: Floats, rng: np.random.Generator) -> Floats:
        """One factor is multiplied by 1 +- e^b, b uniform in (-5, 0), or drawn anew."""
        genes = genes.copy()
        k = int(rng.integers(len(genes)))
        if rng.random() < 0.5:
            genes[k] *= 1 + np.exp(rng.uniform(-5, 0)) * rng.choice([-1.0, 1.0])
        else:
            genes[k] = rng.uniform(*SCALES)
        return np.clip(genes, *SCALES)

    def shaken(self, genes: Floats, rng: np.random.Generator) -> Bodies:
        """The known body with other parts at other places."""
        return self._scaled(shaken(self._copies(len(genes)), rng), genes)

    def _copies(self, count: int) -> Genomes:
        return self.known[np.zeros(count, np.int64)]

    def _scaled(self, genomes: Genomes, genes: Floats) -> Bodies:
        return scale_parts(build(self.evaluator.anatomy, genomes), genes)


@dataclass(frozen=True)
class Scaled:
    """What is believed after an action.

    Attributes:
        action: index into the robot's actions.
        scale: (P) factors of the best model.
        spent: simulations for the search since the start.
        chosen: simulations for choosing since the start.
    """

    action: int
    scale: Floats
    spent: int
    chosen: int


def rescale(
    robot: Robot, known: Genomes, *, method: str, cycles: int, seed: int
) -> Iterator[Scaled]:
    """Find out how long a damaged robot's parts are, a yield an action.

    Args:
        robot: acts.
        known: (1) the body before the damage; its tree and placements stay.
        method: "paper", "disagreement", "random-batch" or "random-alternate".
        cycles: actions to try.
        seed: of everything random.
    """
    engine = make_engine("statics")
    evaluator = Evaluator(robot.anatomy, engine, actions=robot.actions, loss=PAPER_LOSS)
    finder = ScaleSearch(evaluator, known=known)
    rule, evidence = Rule(finder, method, cycles), Evidence()
    rng = np.random.default_rng([seed, 11])
    while len(evidence) < cycles:
        action, _ = rule.choose(evidence, rng)
        evidence = evidence.add(action, felt(robot.act(action)))
        rule.search(evidence, rng)
        best = finder.genes[int(np.argmin(finder.losses))]
        yield Scaled(action, best.copy(), evaluator.spent, evaluator.chosen)
