"""The evolutionary algorithm of 2004: a score in, strings of numbers that reach it out.

A population of 100 lives for 30 generations, of each of which the best 50 are kept. The
50 new ones come of tournaments of three. Each value is replaced with a chance of 1 %,
then 12 pairs undergo one-point crossover. Values have two decimals and lie in [-1, 1]
(overview.txt 4.3). Both searches use it: one for controllers, one for hypotheses of
damage.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from ..body.body import Floats

POPULATION, GENERATIONS, KEPT = 100, 30, 50
MUTATION = 0.01  # chance of each value
_TOURNAMENT, _PAIRS = 3, 12

Score = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Population:
    """A population after a generation.

    Attributes:
        genomes: (N, D) best first.
        scores: (N) larger is better, -inf where it failed.
        best: (G) score of the best one after each generation so far.
        evaluations: evaluations that the algorithm has asked for, in all.
    """

    genomes: Floats
    scores: Floats
    best: Floats = field(default_factory=lambda: np.empty(0))
    evaluations: int = 0


def draw_values(count: int, size: int, rng: np.random.Generator) -> Floats:
    """Draw values of two decimals in [-1, 1].

    Args:
        size: of each, D.

    Returns:
        (N, D) values [1].
    """
    # + 0: of the two zeros only one, for genomes are compared byte by byte
    return np.round(rng.uniform(-1, 1, (count, size)), 2) + 0.0


def start_population(
    size: int, score: Score, rng: np.random.Generator, seeds: Floats | None = None
) -> Population:
    """A random population, and in it what earlier searches found.

    Args:
        score: of genomes (N, size), (N).
        seeds: (S, size) at most as many as the population.
    """
    genomes = draw_values(POPULATION, size, rng)
    if seeds is not None:
        genomes[: len(seeds)] = seeds
    return _merge_ranked(Population(genomes[:0], np.empty(0)), genomes, score(genomes))


def evolve_population(
    pool: Population,
    score: Score,
    rng: np.random.Generator,
    generations: int,
    mutation: float = MUTATION,
) -> Iterator[Population]:
    """The population after each of some more generations.

    A child that is the copy of one that has been scored is not scored again: the
    simulation has no chance in it.

    Args:
        score: of genomes (N, D), larger is better.
        mutation: chance that a value is drawn anew [1].

    Yields:
        The population after each generation.
    """
    known = {g.tobytes(): s for g, s in zip(pool.genomes, pool.scores, strict=True)}
    for _ in range(generations):
        kept = Population(
            pool.genomes[:KEPT], pool.scores[:KEPT], pool.best, pool.evaluations
        )
        new = breed_children(kept.genomes, rng, mutation)
        fresh = np.array([g for g in new if g.tobytes() not in known]).reshape(
            -1, new.shape[1]
        )
        fresh = np.unique(fresh, axis=0)
        if len(fresh):
            keys = (g.tobytes() for g in fresh)
            known |= dict(zip(keys, score(fresh), strict=True))
        pool = _merge_ranked(kept, new, np.array([known[g.tobytes()] for g in new]))
        yield pool


def breed_children(kept: Floats, rng: np.random.Generator, mutation: float) -> Floats:
    """Breed new genomes by tournaments, mutation and crossover.

    Args:
        kept: (KEPT, D) genomes that breed, best ones first.
        mutation: chance that a value is drawn anew [1].

    Returns:
        (POPULATION - KEPT, D) new genomes.
    """
    count = POPULATION - KEPT
    # best first: the winner of a tournament is its lowest row
    winners = rng.integers(0, len(kept), (count, _TOURNAMENT)).min(axis=1)
    new = kept[winners]
    struck = rng.random(new.shape) < mutation
    new = np.where(struck, draw_values(count, new.shape[1], rng), new)
    pairs = rng.permutation(count)[: 2 * _PAIRS].reshape(_PAIRS, 2)
    cuts = rng.integers(1, new.shape[1], _PAIRS)
    for (a, b), cut in zip(pairs, cuts, strict=True):
        new[[a, b], cut:] = new[[b, a], cut:]
    return new


def _merge_ranked(kept: Population, new: Floats, scores: Floats) -> Population:
    """Old and new ones in order; a failure never comes before what has a score."""
    genomes = np.concatenate([kept.genomes.reshape(-1, new.shape[1]), new])
    worth = np.nan_to_num(np.concatenate([kept.scores, scores]), nan=-np.inf)
    order = np.argsort(-worth, kind="stable")
    best = np.append(kept.best, worth[order[0]])
    return Population(genomes[order], worth[order], best, kept.evaluations + len(new))
