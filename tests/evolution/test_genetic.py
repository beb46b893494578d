"""The genetic search of 2004: its counts, its children, its seeds."""

import numpy as np

from selfheal.evolution.genetic import (
    Breeding,
    breed_children,
    draw_values,
    evolve_population,
    start_population,
)

AS_DESCRIBED = Breeding()


def _square(genomes):
    return -(genomes**2).sum(axis=1)


def test_the_search_of_2004_is_as_described():
    rng, asked = np.random.default_rng(1), []

    def score(genomes):
        asked.append(len(genomes))
        return _square(genomes)

    pool = start_population(np.empty((0, 68)), score, rng, AS_DESCRIBED)
    assert len(pool.genomes) == 100 == asked[0]
    steps = evolve_population(pool, score, rng, AS_DESCRIBED, 29)
    for pool in steps:
        assert (np.diff(pool.best) >= 0).all()
    assert pool.evaluations == 1550 and sum(asked) < 1550  # copies are not run again
    assert len(pool.best) == 30
    np.testing.assert_array_equal(pool.genomes, np.round(pool.genomes, 2))
    assert np.abs(pool.genomes).max() <= 1
    assert (np.diff(pool.scores) <= 0).all()


def test_earlier_results_seed_the_next_search():
    seeds = np.zeros((2, 5))
    pool = start_population(seeds, _square, np.random.default_rng(0), AS_DESCRIBED)
    assert (pool.genomes[:2] == 0).all() and pool.scores[0] == 0


def test_children_are_copies_with_point_mutations_and_crossovers():
    rng = np.random.default_rng(0)
    kept = draw_values(50, 200, rng)
    new = breed_children(kept, rng, AS_DESCRIBED)
    same = (new[:, None] == kept).mean(axis=2).max(axis=1)
    assert new.shape == (50, 200)
    assert 0.97 < np.median(same) < 1
    assert (same < 0.97).sum() <= 24  # those that were crossed
