"""Prior: before anything is felt, a body of few kinds of limbs is likelier."""

import numpy as np

from ..body.body import Anatomy, Floats, list_parents_first
from ..body.genome import Genomes
from .symmetry import classify_parts

# Chosen on simulated robots: each further kind of limb costs as much as half a degree
# of loss. Readings outweigh it soon, and it says nothing of which part hangs where
# among parts that are alike: it only breaks what would be ties.
_LIMB_COST = 0.5


def count_limbs(anatomy: Anatomy, genomes: Genomes) -> Floats:
    """Number of different limbs of each body.

    A limb is a part and all that hangs on it. Two are equal if their parts are alike
    and hang on each other at the same sides by the same hinges. The starfish has two:
    a lower leg, and an upper leg with a lower one.

    Args:
        anatomy: the robot's parts.
        genomes: N bodies.

    Returns:
        (N) numbers.
    """
    kind = classify_parts(anatomy)
    rows = zip(genomes.parent, genomes.side, genomes.hinge, strict=True)
    return np.array([_count_limbs_of_body(kind, *row) for row in rows], float)


def _count_limbs_of_body(kind, parent, side, hinge) -> int:  # type: ignore[no-untyped-def]
    """Number of different limbs of one body, each named by what hangs on it."""
    hanging: list[list] = [[] for _ in range(len(parent) + 1)]
    found = set()
    for part in reversed(list_parents_first(parent)):  # children before parents
        i = part - 1
        limb = (kind[i], tuple(sorted(hanging[i + 1])))
        found.add(limb)
        hanging[parent[i]].append((side[i], hinge[i], limb))
    return len(found)


def compute_prior_cost(anatomy: Anatomy, genomes: Genomes) -> Floats:
    """(N) what the prior adds to each body's loss."""
    return _LIMB_COST * count_limbs(anatomy, genomes)
