"""The released rule of 2006: fifteen hill climbers and their choice of actions.

Every constant is from papers.md 1.4 and 1.5 (the program released with paper A).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace

import numpy as np

from ..body.body import Bodies, Floats, concatenate_bodies
from ..body.genome import Genomes, build_bodies, decode_unit_genes
from .evaluate import Evaluator, Evidence

CLIMBERS, GENERATIONS, VOTING_CLIMBERS = 15, 200, 5
CEILING = 408_000  # 15 x 200 x (1 + 2 + ... + 16) simulations


@dataclass(frozen=True)
class ReleasedQuirks:
    """What the released program does and its paper does not say.

    Attributes:
        idle_copies: half of the mutations copy a part into a column that is not read.
        pair: the second gene of a pair move starts from the first one's value.
    """

    idle_copies: bool = True
    pair: bool = True


def mutate_genes(
    genes: Floats, slips: ReleasedQuirks, rng: np.random.Generator
) -> Floats:
    """Genes after one mutation of the rule of 2006.

    Args:
        genes: (P) in [0, 1].

    Returns:
        (P) genes in [0, 1].
    """
    genes = genes.copy()
    if slips.idle_copies and rng.random() < 0.5:
        return genes
    k = int(rng.integers(len(genes)))
    step = np.exp(rng.uniform(-5, 0)) * rng.choice([-1.0, 1.0])
    if rng.random() < 0.33:
        genes[k] = (genes[k] * (1 + step)) % 1.0
    elif rng.random() < 0.67:
        other = (k + rng.integers(1, len(genes))) % len(genes)
        start = genes[k] if slips.pair else genes[other]
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
    def build_bodies(self, genes: Floats) -> Bodies:
        """(N) the bodies that genes (N, P) stand for."""

    @abstractmethod
    def draw_first(self, rng: np.random.Generator) -> Floats:
        """(15, P) genes to start from."""

    @abstractmethod
    def draw_child(self, genes: Floats, rng: np.random.Generator) -> Floats:
        """(P) genes near those of a parent (P)."""

    @abstractmethod
    def perturb_bodies(self, genes: Floats, rng: np.random.Generator) -> Bodies:
        """(N) the bodies with every placement multiplied by U(0.9, 1.1)."""

    def climb(
        self, evidence: Evidence, generations: int, rng: np.random.Generator
    ) -> None:
        """Climb for some generations, the newest action first."""
        if not len(self.genes):
            self.genes = self.draw_first(rng)
        order = np.arange(len(evidence))[::-1]
        never = np.full(len(self.genes), np.inf)
        self.losses, _ = self.evaluator.compute_body_losses(
            self.build_bodies(self.genes), evidence, bound=never, order=order
        )
        for _ in range(generations):
            children = np.array([self.draw_child(row, rng) for row in self.genes])
            losses, _ = self.evaluator.compute_body_losses(
                self.build_bodies(children), evidence, bound=self.losses, order=order
            )
            better = losses < self.losses
            self.genes = np.where(better[:, None], children, self.genes)
            self.losses = np.where(better, losses, self.losses)
            self._sort_climbers()

    def _sort_climbers(self) -> None:
        order = np.argsort(self.losses, kind="stable")
        self.genes, self.losses = self.genes[order], self.losses[order]

    def score_actions(
        self, weight: float, rng: np.random.Generator
    ) -> tuple[Floats, Floats]:
        """How worthwhile each action is: disagreement, less its unreliability.

        Args:
            weight: w of w S - (1 - w) V; 0.5 at first, divided by 1.5 a cycle.
            rng: for the copies whose placements are multiplied by U(0.9, 1.1).

        Returns:
            (A) (1 - w) V - w S, so that the highest is chosen, and the tables
            (5, A, 3) of the best models.
        """
        best = self.genes[:VOTING_CLIMBERS]
        both = concatenate_bodies(
            self.build_bodies(best), self.perturb_bodies(best, rng)
        )
        with self.evaluator.count_as_choice():
            table = self.evaluator.compute_body_table(both)
        tables, moved = (
            np.nan_to_num(table[:VOTING_CLIMBERS]),
            np.nan_to_num(table[VOTING_CLIMBERS:]),
        )
        scale = np.array([1, 1, 0.01])  # clearance in units of 10 cm, as in the loss
        sensitivity = (np.abs(tables - moved) * scale).sum(axis=(0, 2))
        disagreement = (tables.std(axis=0) * scale).sum(axis=1)
        return (1 - weight) * disagreement - weight * sensitivity, table[
            :VOTING_CLIMBERS
        ]


def perturb_placements(genomes: Genomes, rng: np.random.Generator) -> Genomes:
    """Genomes with every placement multiplied by U(0.9, 1.1)."""
    moved = genomes.placement * rng.uniform(0.9, 1.1, genomes.placement.shape)
    return replace(genomes, placement=moved % 1.0)


@dataclass
class PaperSearch(Climbers):
    """Before damage: genes in [0, 1] are an attachment tree.

    Attributes:
        quirks: of the released program.
    """

    quirks: ReleasedQuirks = field(default_factory=ReleasedQuirks)

    @property
    def genomes(self) -> Genomes:
        """(15) the models."""
        return decode_unit_genes(self.evaluator.anatomy, self.genes)

    def build_bodies(self, genes: Floats) -> Bodies:
        """Trees of genes (N, P)."""
        anatomy = self.evaluator.anatomy
        return build_bodies(anatomy, decode_unit_genes(anatomy, genes))

    def draw_first(self, rng: np.random.Generator) -> Floats:
        """Random trees: genes (CLIMBERS, P)."""
        return rng.random((CLIMBERS, self.evaluator.anatomy.size))

    def draw_child(self, genes: Floats, rng: np.random.Generator) -> Floats:
        """Genes (P) after one to four mutations."""
        for _ in range(rng.integers(1, 5)):
            genes = mutate_genes(genes, self.quirks, rng)
        return genes

    def perturb_bodies(self, genes: Floats, rng: np.random.Generator) -> Bodies:
        """Trees of genes (N, P), with other placements."""
        anatomy = self.evaluator.anatomy
        return build_bodies(
            anatomy, perturb_placements(decode_unit_genes(anatomy, genes), rng)
        )
