"""CMA-ES finds the top of a hill; failed evaluations never lead."""

import numpy as np
import pytest

from selfheal.evolution.cma_es import ask, start_search, tell


def test_evolution_finds_the_top_of_a_hill():
    rng, top = np.random.default_rng(2), np.arange(5.0)
    state = start_search(np.zeros(5), 1.0)
    for _ in range(120):
        points = ask(state, 12, rng)
        state = tell(state, points, -((points - top) ** 2 * [1, 9, 1, 30, 1]).sum(1))
    assert state.mean == pytest.approx(top, abs=1e-2)


def test_a_failed_evaluation_never_leads():
    rng, state = np.random.default_rng(3), start_search(np.zeros(2), 1.0)
    for _ in range(40):
        points = ask(state, 10, rng)
        scores = np.where(points[:, 0] > 0.5, np.nan, points[:, 0])
        state = tell(state, points, scores)
    assert state.mean[0] < 1.0
