"""The searches of 2006: their losses, budgets, mutations and scores."""

import numpy as np
import pytest

from selfheal.selfmodel.evaluate import PAPER_LOSS
from selfheal.selfmodel.paper import CLIMBERS, PaperSearch, ReleasedQuirks, mutate_genes
from tests.support.stick_robot import PARTS
from tests.support.stick_search import TOY, make_evaluator, measure_evidence


def test_the_losses_of_the_2006_climbers_never_rise():
    search = PaperSearch(make_evaluator(loss=PAPER_LOSS))
    rng, evidence = np.random.default_rng(0), measure_evidence(0, 4)
    search.climb(evidence, 1, rng)
    for _ in range(20):
        before = search.losses
        search.climb(evidence, 1, rng)
        assert (search.losses <= before + 1e-9).all()
        assert (np.diff(search.losses) >= 0).all()
    assert search.genes.shape == (CLIMBERS, PARTS)


def test_the_2006_climbers_spend_no_more_than_their_ceiling():
    evaluator = make_evaluator(loss=PAPER_LOSS)
    search = PaperSearch(evaluator)
    search.climb(measure_evidence(0, 4, 6), 10, np.random.default_rng(0))
    assert CLIMBERS < evaluator.spent <= CLIMBERS * 3 * (10 + 1)


@pytest.mark.parametrize(
    "slips", [ReleasedQuirks(), ReleasedQuirks(idle_copies=False, pair=False)]
)
def test_mutated_genes_stay_in_their_range(slips):
    rng = np.random.default_rng(0)
    genes = rng.random(PARTS)
    for _ in range(2000):
        genes = mutate_genes(genes, slips, rng)
        assert ((genes >= 0) & (genes <= 1)).all()


def test_half_of_the_released_mutations_change_nothing():
    genes, idle = np.full(PARTS, 0.4), {}
    for copies in (False, True):
        rng = np.random.default_rng(0)
        slips = ReleasedQuirks(idle_copies=copies)
        same = [
            np.array_equal(mutate_genes(genes, slips, rng), genes) for _ in range(2000)
        ]
        idle[copies] = sum(same) / 2000
    assert idle[False] == 0
    assert idle[True] == pytest.approx(0.5, abs=0.05)  # 4 standard deviations


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
