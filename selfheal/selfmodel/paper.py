"""The released rule of 2006: fifteen hill climbers and their choice of actions.

Every constant is from papers.md 1.4 and 1.5 (the program released with paper A).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.random import Generator

from ..body.body import Bodies, Floats, concatenate_bodies
from ..body.genome import Genomes, build_bodies, decode_unit_genes
from ..engine.arrays import plan_race
from .evaluate import Evaluator, Evidence

CLIMBERS, GENERATIONS, VOTING_CLIMBERS = 15, 200, 5
CEILING = 408_000  # 15 x 200 x (1 + 2 + ... + 16) simulations


def mutate_genes(genes: Floats, rng: Generator) -> Floats:
    """Genes after one mutation of the program of 2006, (P) in [0, 1] as before it.

    As its paper does not say, half of the mutations copy a part into a column that is
    not read. The second gene of a pair move starts from the first one's value.
    """
    genes = genes.copy()
    if rng.random() < 0.5:
        return genes
    k = int(rng.integers(len(genes)))
    step = np.exp(rng.uniform(-5, 0)) * rng.choice([-1.0, 1.0])
    if rng.random() < 0.33:
        genes[k] = (genes[k] * (1 + step)) % 1.0
    elif rng.random() < 0.67:
        other = (k + rng.integers(1, len(genes))) % len(genes)
        start = genes[k]
        genes[k] = (genes[k] + step) % 1.0
        genes[other] = np.clip(start - step, 0.0, 1.0)
    else:
        genes[k] = rng.random()
    return genes


@dataclass
class Climbers(ABC):
    """Fifteen independent (1 + 1) climbers, best first; see the module.

    Attributes:
        evaluator: simulates and counts; its loss must be the paper's.
        genes: (15, P) of the models.
        losses: (15).
    """

    evaluator: Evaluator
    genes: Floats = field(init=False)
    losses: Floats = field(init=False)

    def __post_init__(self) -> None:
        """No climbers before the first evidence."""
        self.genes = np.zeros((0, self.evaluator.anatomy.size))
        self.losses = np.zeros(0)

    @abstractmethod
    def decode_genes(self, genes: Floats) -> Genomes:
        """(N) the trees that genes (N, P) stand for."""

    @abstractmethod
    def draw_first(self, rng: Generator) -> Floats:
        """(15, P) genes to start from."""

    @abstractmethod
    def draw_child(self, genes: Floats, rng: Generator) -> Floats:
        """(P) genes near those of a parent (P)."""

    def build_bodies(self, genomes: Genomes, genes: Floats) -> Bodies:
        """(N) bodies of trees, of which genes (N, P) may say more."""
        return build_bodies(self.evaluator.anatomy, genomes)

    def _compute_losses(
        self, genes: Floats, evidence: Evidence, most: Floats
    ) -> Floats:
        """Losses of genes (N, P), infinite from a bound (N) on; newest action first."""
        bodies = self.build_bodies(self.decode_genes(genes), genes)
        order = np.arange(len(evidence))[::-1]
        race = plan_race(len(genes), order, most[:, None])
        return self.evaluator.compute_losses(bodies, evidence, race)[0]

    def climb(self, evidence: Evidence, generations: int, rng: Generator) -> None:
        """Climb for some generations, the newest action first."""
        if not len(self.genes):
            self.genes = self.draw_first(rng)
        never = np.full(len(self.genes), np.inf)
        self.losses = self._compute_losses(self.genes, evidence, never)
        for _ in range(generations):
            children = np.array([self.draw_child(row, rng) for row in self.genes])
            losses = self._compute_losses(children, evidence, self.losses)
            better = losses < self.losses
            self.genes = np.where(better[:, None], children, self.genes)
            self.losses = np.where(better, losses, self.losses)
            order = np.argsort(self.losses, kind="stable")
            self.genes, self.losses = self.genes[order], self.losses[order]

    def score_actions(self, weight: float, rng: Generator) -> tuple[Floats, Floats]:
        """How worthwhile each action is: disagreement, less its unreliability.

        Args:
            weight: w of w S - (1 - w) V; 0.5 at first, divided by 1.5 a cycle.
            rng: for the copies whose placements are multiplied by U(0.9, 1.1).

        Returns:
            (A) (1 - w) V - w S, so that the highest is chosen, and the tables
            (5, A, 3) of the best models.
        """
        genes = self.genes[:VOTING_CLIMBERS]
        best = self.decode_genes(genes)
        both = [
            self.build_bodies(g, genes) for g in (best, perturb_placements(best, rng))
        ]
        with self.evaluator.count_as_choice():
            table = self.evaluator.compute_body_table(concatenate_bodies(*both))
        tables, moved = np.split(np.nan_to_num(table), 2)
        scale = np.array([1, 1, 0.01])  # clearance in units of 10 cm, as in the loss
        sensitivity = (np.abs(tables - moved) * scale).sum(axis=(0, 2))
        disagreement = (tables.std(axis=0) * scale).sum(axis=1)
        score = (1 - weight) * disagreement - weight * sensitivity
        return score, table[: len(genes)]


def perturb_placements(genomes: Genomes, rng: Generator) -> Genomes:
    """Genomes with every placement multiplied by U(0.9, 1.1)."""
    moved = genomes.placement * rng.uniform(0.9, 1.1, genomes.placement.shape)
    return replace(genomes, placement=moved % 1.0)


class PaperSearch(Climbers):
    """Before damage: genes in [0, 1] are an attachment tree."""

    @property
    def genomes(self) -> Genomes:
        """(15) the models."""
        return self.decode_genes(self.genes)

    def decode_genes(self, genes: Floats) -> Genomes:
        """Trees of genes (N, P)."""
        return decode_unit_genes(self.evaluator.anatomy, genes)

    def draw_first(self, rng: Generator) -> Floats:
        """Random trees: genes (CLIMBERS, P)."""
        return rng.random((CLIMBERS, self.evaluator.anatomy.size))

    def draw_child(self, genes: Floats, rng: Generator) -> Floats:
        """Genes (P) after one to four mutations."""
        for _ in range(rng.integers(1, 5)):
            genes = mutate_genes(genes, rng)
        return genes
