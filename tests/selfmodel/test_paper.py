"""The searches of 2006: their losses, budgets, mutations and scores."""

import numpy as np
import pytest

from selfheal.selfmodel.evaluate import PAPER_LOSS
from selfheal.selfmodel.paper import CLIMBERS, PaperSearch, mutate_genes
from tests.support.stick_robot import PARTS
from tests.support.stick_search import TOY, make_evaluator, measure_evidence


def test_the_losses_of_the_2006_climbers_never_rise_nor_cost_more_than_the_ceiling():
    evaluator = make_evaluator(loss=PAPER_LOSS)
    search, rng = PaperSearch(evaluator), np.random.default_rng(0)
    evidence = measure_evidence(0, 4)
    search.climb(evidence, 1, rng)
    for _ in range(20):
        before, spent = search.losses, evaluator.spent
        search.climb(evidence, 1, rng)
        assert (search.losses <= before + 1e-9).all()
        assert (np.diff(search.losses) >= 0).all()
        assert CLIMBERS < evaluator.spent - spent <= CLIMBERS * 2 * (1 + 1)
    assert search.genes.shape == (CLIMBERS, PARTS)


def test_mutated_genes_stay_in_their_range_and_half_of_the_time_as_they_are():
    rng, genes, idle = np.random.default_rng(0), np.full(PARTS, 0.4), 0
    for _ in range(2000):
        moved = mutate_genes(genes, rng)
        assert ((moved >= 0) & (moved <= 1)).all()
        idle += np.array_equal(moved, genes)
        genes = moved
    assert idle / 2000 == pytest.approx(0.5, abs=0.05)  # 4 standard deviations


def test_a_pair_move_starts_from_one_value_twice():
    """The paper moves two genes apart; its program starts from the first one's."""
    genes, rng = np.array([0.45, 0.5, 0.53, 0.6]), np.random.default_rng(0)
    checked = 0
    for _ in range(1000):
        moved = mutate_genes(genes, rng)
        changed = np.flatnonzero(moved != genes)
        if len(changed) != 2 or np.abs(moved - genes)[changed].max() > 0.3:
            continue  # one gene, or one that went round or was cut off
        assert np.isclose(2 * genes[changed], moved[changed].sum()).any()
        checked += 1
    assert checked > 50


def test_the_2006_score_prefers_actions_that_the_best_models_disagree_on():
    search = PaperSearch(make_evaluator(loss=PAPER_LOSS))
    rng = np.random.default_rng(0)
    search.climb(measure_evidence(0), 5, rng)
    score, tables = search.score_actions(0.0, rng)
    assert tables.shape == (5, len(TOY.actions), 3)
    spread = tables.std(axis=0) * np.array([1, 1, 0.01])
    np.testing.assert_allclose(score, spread.sum(axis=1))
    cautious, _ = search.score_actions(1.0, rng)
    assert (cautious <= 0).all()
