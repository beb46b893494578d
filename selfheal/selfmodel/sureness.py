"""Sureness: the stated probability that each attachment of the best body is right."""

import numpy as np

from ..body.body import Floats
from ..body.genome import Genomes
from .explore import plausibility


def sureness(
    genomes: Genomes, losses: Floats, best: Genomes, *, unseen: float
) -> Floats:
    """(P) probability that each part hangs on the parent it has in the best body.

    Args:
        genomes: (M) bodies that might be it.
        losses: (M) over the evidence.
        best: (1) the body believed in.
        unseen: probability that a better body was not found. It leaves the parent of
            part i to chance, 1 in i.
    """
    agree = genomes.parent == best.parent
    seen = plausibility(losses) @ agree
    chance = 1 / np.arange(1, agree.shape[1] + 1)
    return (1 - unseen) * seen + unseen * chance
