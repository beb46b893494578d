"""The evolutionary algorithm of 2004: a score in, strings of numbers that reach it out.

Those that are not kept in a generation come of tournaments. Each value is replaced with
a small chance, then pairs undergo one-point crossover. Values have two decimals and lie
in [-1, 1] (overview.txt 4.3). Both searches of `recover` use it: one for controllers,
one for hypotheses of damage.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from ..recording.data import Floats
from .ranking import rank_best_first

GENERATIONS = 30  # of each search of 2004
_TOURNAMENT = 3

Score = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Breeding:
    """How a population goes on; the defaults are those of 2004.

    Attributes:
        population: genomes that live.
        kept: the best of them, which live on.
        mutation: chance that a value is drawn anew [1].
        pairs: of the new ones, that cross.
    """

    population: int = 100
    kept: int = 50
    mutation: float = 0.01
    pairs: int = 12


@dataclass(frozen=True)
class Population:
    """A population after a generation.

    Attributes:
        genomes: (N, D) best first.
        scores: (N) larger is better, -inf where it failed.
        best: (G) score of the best one after each generation so far.
        evaluations: requested by the algorithm so far.
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
    seeds: Floats, score: Score, rng: np.random.Generator, breeding: Breeding
) -> Population:
    """A random population, and in it what earlier searches found.

    Args:
        seeds: (S, D) these, at most as many as the population; S may be 0.
        score: of genomes (N, D), larger is better.
    """
    genomes = draw_values(breeding.population, seeds.shape[1], rng)
    genomes[: len(seeds)] = seeds
    return _merge_ranked(Population(genomes[:0], np.empty(0)), genomes, score(genomes))


def evolve_population(
    pool: Population,
    score: Score,
    rng: np.random.Generator,
    breeding: Breeding,
    generations: int,
) -> Iterator[Population]:
    """The population after each of some more generations.

    A child that is the copy of one that has been scored is not scored again: the
    simulation has no chance in it.

    Args:
        score: of genomes (N, D), larger is better.
    """
    known = {g.tobytes(): s for g, s in zip(pool.genomes, pool.scores, strict=True)}
    for _ in range(generations):
        best = slice(breeding.kept)
        kept = replace(pool, genomes=pool.genomes[best], scores=pool.scores[best])
        new = breed_children(kept.genomes, rng, breeding)
        unknown = [g.tobytes() not in known for g in new]
        fresh = np.unique(new[unknown], axis=0)
        if len(fresh):
            keys = (g.tobytes() for g in fresh)
            known |= dict(zip(keys, score(fresh), strict=True))
        pool = _merge_ranked(kept, new, np.array([known[g.tobytes()] for g in new]))
        yield pool


def breed_children(
    kept: Floats, rng: np.random.Generator, breeding: Breeding
) -> Floats:
    """(N, D) new genomes by tournaments, mutation and crossover.

    Args:
        kept: (K, D) genomes that breed, best ones first.
    """
    count = breeding.population - breeding.kept
    # best first: the winner of a tournament is its lowest row
    winners = rng.integers(0, len(kept), (count, _TOURNAMENT)).min(axis=1)
    new = kept[winners]
    struck = rng.random(new.shape) < breeding.mutation
    new = np.where(struck, draw_values(count, new.shape[1], rng), new)
    pairs = rng.permutation(count)[: 2 * breeding.pairs].reshape(-1, 2)
    cuts = rng.integers(1, new.shape[1], len(pairs))
    for (a, b), cut in zip(pairs, cuts, strict=True):
        new[[a, b], cut:] = new[[b, a], cut:]
    return new


def _merge_ranked(kept: Population, new: Floats, scores: Floats) -> Population:
    """Old and new ones in order; a failure never comes before what has a score."""
    genomes = np.concatenate([kept.genomes.reshape(-1, new.shape[1]), new])
    worth = np.nan_to_num(np.concatenate([kept.scores, scores]), nan=-np.inf)
    order = rank_best_first(worth)
    best = np.append(kept.best, worth[order[0]])
    return Population(genomes[order], worth[order], best, kept.evaluations + len(new))
