"""The set of rivals: bodies of different structure that explain the readings well."""

from dataclasses import dataclass

import numpy as np

from ..body.body import Floats, Ints
from ..body.genome import Genomes, concatenate_genomes
from ..engine.channels import list_channels
from .evaluate import Evaluator


@dataclass(frozen=True)
class RivalSet:
    """Rivals: peaks of different structure, best first.

    Attributes:
        genomes: (K).
        tables: (K, A, C) their channels under every action.
        losses: (K) over the evidence so far.
    """

    genomes: Genomes
    tables: Floats
    losses: Floats

    @classmethod
    def empty(cls, evaluator: Evaluator) -> "RivalSet":
        """No rivals yet."""
        actions, parts = evaluator.actions.shape
        whole = np.zeros((0, parts), np.int64)
        real = np.zeros((0, parts))
        nobody = Genomes(whole, real, whole, real)
        channels = len(list_channels(evaluator.anatomy))
        return cls(nobody, np.zeros((0, actions, channels)), np.zeros(0))

    def __len__(self) -> int:
        return len(self.losses)

    def __getitem__(self, rows: Ints) -> "RivalSet":
        """These rivals, in this order."""
        return RivalSet(self.genomes[rows], self.tables[rows], self.losses[rows])

    def append(self, genome: Genomes, table: Floats, loss: float) -> "RivalSet":
        """These and a body (1) more, with its table (A, C)."""
        return RivalSet(
            concatenate_genomes(self.genomes, genome),
            np.concatenate([self.tables, table[None]]),
            np.append(self.losses, loss),
        )

    def add_rival(self, genome: Genomes, table: Floats, loss: float) -> "RivalSet":
        """These and a peak; of two equal structures the better one stays.

        Args:
            genome: (1) of the peak.
            table: (A, C) its channels under every action.
        """
        twin = np.flatnonzero(_has_same_structure(self.genomes, genome))
        if len(twin) and self.losses[twin[0]] <= loss:
            return self
        kept = self[np.setdiff1d(np.arange(len(self)), twin)]
        return kept.append(genome, table, loss)

    def keep_best(self, size: int, prior: Floats) -> "RivalSet":
        """The best `size` by loss and prior (K), in this order."""
        return self[np.argsort(self.losses + prior, kind="stable")[:size]]


def _has_same_structure(genomes: Genomes, one: Genomes) -> np.ndarray:
    """(N) whether a genome has the tree, sides and hinges of another (1)."""
    equal = (genomes.parent == one.parent) & (genomes.side == one.side)
    return (equal & (genomes.hinge == one.hinge)).all(axis=1)
