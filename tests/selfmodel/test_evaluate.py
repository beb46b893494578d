"""Losses of candidates: to give up early changes no winner, failures never win."""

import numpy as np
import pytest

from selfheal.body.body import count_centers_in_torso
from selfheal.body.genome import build_bodies
from selfheal.engine.channels import Loss
from selfheal.engine.statics import Statics
from selfheal.selfmodel.evaluate import PAPER_LOSS
from selfheal.selfmodel.paper import PaperSearch
from tests.support.stick_search import (
    TOY,
    WavesEngine,
    draw_sticks,
    has_true_shape,
    make_evaluator,
    make_search,
    measure_evidence,
    race_sticks,
)

ENGINES = [Statics(), WavesEngine(1), WavesEngine(64)]
engines = pytest.mark.parametrize("engine", ENGINES, ids=["race", "one", "waves"])


@engines
def test_giving_up_early_changes_nobody_below_the_bound(engine):
    genomes, evidence = draw_sticks(60), measure_evidence(0, 3, 5, 8)
    evaluator = make_evaluator(engine)
    full, every = race_sticks(evaluator, genomes, evidence, range(4))
    whole = evaluator.spent
    limit = float(np.quantile(full[np.isfinite(full)], 0.2))
    for order in ([0, 1, 2, 3], [2, 0, 3, 1]):
        before = evaluator.spent
        total, each = race_sticks(evaluator, genomes, evidence, order, limit)
        below = full < limit
        np.testing.assert_allclose(total[below], full[below])
        assert (total[~below] == np.inf).all()
        assert np.argmin(total) == np.argmin(full)
        known = ~np.isnan(each)
        np.testing.assert_allclose(each[known], every[known])
        assert evaluator.spent - before < whole


@engines
def test_a_simulation_is_one_candidate_under_one_action(engine):
    evaluator, evidence = make_evaluator(engine), measure_evidence(1, 4)
    seen = []
    evaluator.progress = seen.append
    genomes = draw_sticks(30)
    _, each = race_sticks(evaluator, genomes, evidence, range(2))
    raced = (~np.isnan(each)).sum()
    assert evaluator.spent == raced == seen[-1]
    evaluator.compute_table(genomes)
    assert evaluator.spent == seen[-1] == raced + 30 * len(TOY.actions)


def test_bodies_with_parts_inside_the_torso_are_not_simulated():
    """Papers.md 1.1; they are worse than any other."""
    genomes, evaluator = draw_sticks(200), make_evaluator()
    inside = count_centers_in_torso(build_bodies(TOY.anatomy, genomes)) > 0
    assert 0 < inside.sum() < 200
    total, each = race_sticks(evaluator, genomes, measure_evidence(0), [0])
    np.testing.assert_array_equal(np.isinf(total), inside)
    np.testing.assert_array_equal(np.isnan(each[:, 0]), inside)
    assert evaluator.spent == (~inside).sum()


def test_hardest_first_tries_every_action_once():
    evaluator, evidence = make_evaluator(), measure_evidence(2, 7, 4, 0)
    assert sorted(evaluator.order_by_hardness(evidence)) == [0, 1, 2, 3]
    race_sticks(evaluator, draw_sticks(40), evidence, range(4))
    order = evaluator.order_by_hardness(evidence)
    assert sorted(order) == [0, 1, 2, 3]
    hardness = evaluator.hardness[list(np.array(evidence.tried)[order])]
    assert (np.diff(hardness) <= 0).all()
    fresh = evidence.add(9, np.zeros(3))
    assert evaluator.order_by_hardness(fresh)[0] == 4  # what was never tried leads


def test_a_channel_that_was_not_measured_costs_nothing():
    loss = Loss(np.array([1.0, 2.0, 3.0]), np.array([np.inf, 1.0, np.inf]))
    measured = np.array([1.0, 0, np.nan])
    assert loss(np.array([3.0, 9, 7]), measured) == 2 + 2 * 1


@pytest.mark.parametrize("batch", [1, 64])
def test_a_failed_candidate_can_never_become_the_best(batch):
    """The hidden body itself fails, and is not believed in however well it fits."""
    assert has_true_shape(TOY.truth).all()
    evaluator = make_evaluator(WavesEngine(batch, fails=True))
    search, evidence = make_search(evaluator), measure_evidence(0, 3, 5)
    search.search(evidence, 2000, np.random.default_rng(0))
    assert evaluator.failed > 0 and len(search.rivals)
    assert np.isfinite(search.rivals.losses).all()
    assert not has_true_shape(search.rivals.genomes).any()
    released = PaperSearch(make_evaluator(WavesEngine(batch, fails=True), PAPER_LOSS))
    released.climb(evidence, 5, np.random.default_rng(0))
    finite = np.isfinite(released.losses)
    assert finite[0] and (np.diff(released.losses[finite]) >= 0).all()
    assert not (finite & has_true_shape(released.genomes)).any()
