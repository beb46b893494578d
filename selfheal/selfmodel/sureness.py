"""Sureness: the stated probability that each attachment of the best body is right."""

import numpy as np

from ..body.body import Floats
from ..body.genome import Genomes

# Fitted to 68 simulated runs, no real reading among them (docs/results/sureness.md):
# loss that makes a body e times less likely, and how often an attachment of a body
# that is not the right one is right all the same.
_TEMPERATURE, _RIGHT_ANYWAY = 4.0, 0.8


def sureness(
    genomes: Genomes, losses: Floats, best: Genomes, *, survived: int
) -> Floats:
    """(P) probability that each part hangs on the parent it has in the best body.

    Args:
        genomes: (M) bodies that might be it.
        losses: (M) over the evidence.
        best: (1) the body believed in.
        survived: actions that this tree has stood as the best. The chance that the
            right body was not found is taken as 0.5 / (survived + 1).
    """
    weight = np.exp(-(losses - losses.min()) / _TEMPERATURE)
    agree = genomes.parent == best.parent
    seen = weight @ agree / weight.sum()
    missed = 0.5 / (survived + 1)
    sure = seen * (1 - missed * (1 - _RIGHT_ANYWAY))
    sure[0] = 1.0  # part 1 has nothing but the torso to hang on
    return sure
