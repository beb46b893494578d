"""The genetic search of 2004: its counts, its children, its seeds."""

import numpy as np

from selfheal.gait import genetic
from selfheal.gait.genetic import (
    KEPT,
    POPULATION,
    draw_values,
    evolve_population,
    start_population,
)


def _square(genomes):
    return -(genomes**2).sum(axis=1)


def test_the_search_of_2004_is_as_described():
    rng, asked = np.random.default_rng(1), []

    def score(genomes):
        asked.append(len(genomes))
        return _square(genomes)

    pool = start_population(68, score, rng)
    assert len(pool.genomes) == POPULATION == asked[0]
    steps = evolve_population(pool, score, rng, 29)
    for pool in steps:
        assert (np.diff(pool.best) >= 0).all()
    assert pool.evaluations == 1550 and sum(asked) < 1550  # copies are not run again
    assert len(pool.best) == 30
    np.testing.assert_array_equal(pool.genomes, np.round(pool.genomes, 2))
    assert np.abs(pool.genomes).max() <= 1
    assert (np.diff(pool.scores) <= 0).all()


def test_earlier_results_seed_the_next_search():
    seeds = np.zeros((2, 5))
    pool = start_population(5, _square, np.random.default_rng(0), seeds)
    assert (pool.genomes[:2] == 0).all() and pool.scores[0] == 0


def test_children_are_copies_with_point_mutations_and_crossovers():
    rng = np.random.default_rng(0)
    kept = draw_values(KEPT, 200, rng)
    new = genetic.breed_children(kept, rng, 0.01)
    same = (new[:, None] == kept).mean(axis=2).max(axis=1)
    assert new.shape == (POPULATION - KEPT, 200)
    assert 0.97 < np.median(same) < 1
    assert (same < 0.97).sum() <= 24  # those that were crossed
