"""Deterministic crowding (Mahfoud 1995): genes in [0, 1] and their errors in and out.

Paper C names the algorithm, its population and its generations; the rest is chosen.
"""

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from ..body.body import Floats

# Chosen, for paper C does not say: a pair crosses with this chance, gene by gene; a
# gene changes with a chance of one in their number, mostly by a step of this size,
# else to any value.
_CROSSOVER_PROBABILITY, _STEP, _REDRAW_PROBABILITY = 0.9, 0.1, 0.2

Errors = Callable[[Floats], Floats]


def breed_children(genes: Floats, rng: Generator) -> Floats:
    """(N, G) children of N parents (N, G), N even; rows k and k + N / 2 are a pair."""
    first, second = np.split(genes, 2)
    count = genes.shape[1]
    swap = (rng.random(first.shape) < 0.5) & (
        rng.random((len(first), 1)) < _CROSSOVER_PROBABILITY
    )
    made = np.concatenate(
        [np.where(swap, second, first), np.where(swap, first, second)]
    )
    changed = rng.random(made.shape) < 1 / count
    anew = rng.random(made.shape) < _REDRAW_PROBABILITY
    step = np.clip(made + rng.normal(0, _STEP, made.shape), 0, 1)
    drawn = np.where(anew, rng.random(made.shape), step)
    return np.where(changed, drawn, made)


def run_generation(
    genes: Floats, errors: Floats, score: Errors, rng: Generator
) -> tuple[Floats, Floats]:
    """The population after a generation: a child takes the place of the nearer parent.

    Args:
        genes: (N, G) in [0, 1], N even.
        errors: (N) of them.
        score: errors of genes (M, G); a failed one's is infinite.

    Returns:
        (N, G) genes and (N) errors.
    """
    order = rng.permutation(len(genes))
    genes, errors = genes[order], errors[order]
    made = breed_children(genes, rng)
    found = score(made)
    half = len(genes) // 2

    def apart(a: Floats, b: Floats) -> Floats:
        return np.linalg.norm(a - b, axis=1)

    straight = apart(made[:half], genes[:half]) + apart(made[half:], genes[half:])
    across = apart(made[:half], genes[half:]) + apart(made[half:], genes[:half])
    turned = np.tile(across < straight, 2)[:, None]
    other = np.roll(np.arange(len(genes)), half)
    made = np.where(turned, made[other], made)
    found = np.where(turned[:, 0], found[other], found)
    better = found < errors
    return np.where(better[:, None], made, genes), np.where(better, found, errors)
