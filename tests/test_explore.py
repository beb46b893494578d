"""Choosing actions and stating sureness: laws of probabilities."""

import numpy as np
import pytest
from toys import PARTS, Toy, anatomy

from selfheal.body.genome import Genomes, from_tree, random_genomes
from selfheal.engine.statics import Statics
from selfheal.selfmodel.evaluate import Evaluator, Evidence
from selfheal.selfmodel.explore import (
    choose,
    hypotheses,
    new_contrasts,
    plausibility,
    random_action,
    telling_apart,
)
from selfheal.selfmodel.search import RivalSearch
from selfheal.selfmodel.space import genome_key, space_of
from selfheal.selfmodel.strategy import Rivals
from selfheal.selfmodel.sureness import sureness
from selfheal.selfmodel.symmetry import Twins

ACTIONS = 10


def _tables(count: int) -> np.ndarray:
    """(count, ACTIONS, 3) channels, no two alike."""
    return np.random.default_rng(0).normal(0, 5, (count, ACTIONS, 3))


def _even(count: int) -> np.ndarray:
    return np.full(count, 1 / count)


def test_no_action_is_chosen_twice():
    score, tried = np.random.default_rng(0).normal(size=ACTIONS), ()
    for _ in range(ACTIONS):
        tried = (*tried, choose(score, tried))
    assert sorted(tried) == list(range(ACTIONS))
    np.testing.assert_array_equal(tried, np.argsort(-score))


def test_no_action_is_drawn_twice_and_all_are_drawn():
    rng, firsts = np.random.default_rng(0), set()
    for _ in range(100):
        tried = ()
        for _ in range(4):
            tried = (*tried, random_action(4, tried, rng))
        assert sorted(tried) == [0, 1, 2, 3]
        firsts.add(tried[0])
    assert firsts == {0, 1, 2, 3}


def test_an_action_on_which_all_agree_tells_nothing():
    tables = np.repeat(_tables(1), 6, axis=0)
    np.testing.assert_allclose(telling_apart(tables, _even(6)), 0, atol=1e-12)


def test_more_disagreement_tells_more():
    tables, last = _tables(5), np.zeros(ACTIONS)
    for scale in (0.01, 0.1, 1, 10):
        score = telling_apart(scale * tables, _even(5))
        assert (score > last).all()
        last = score
    # five equally likely bodies, each apart from the four others
    np.testing.assert_allclose(telling_apart(1e4 * tables, _even(5)), 0.8)


def test_the_order_and_the_splitting_of_bodies_are_irrelevant():
    tables, belief = _tables(5), np.array([0.5, 0.2, 0.1, 0.1, 0.1])
    score = telling_apart(tables, belief)
    order = np.array([3, 1, 4, 0, 2])
    np.testing.assert_allclose(telling_apart(tables[order], belief[order]), score)
    twice = np.concatenate([tables, tables])
    halves = np.concatenate([belief, belief]) / 2
    np.testing.assert_allclose(telling_apart(twice, halves), score)
    np.testing.assert_allclose(telling_apart(-tables, belief), score)


def test_an_action_tells_no_more_than_there_is_to_know():
    """At most the chance that two bodies drawn by belief are not the same one."""
    for belief in ([0.4, 0.3, 0.3], [0.9, 0.05, 0.05], [1.0, 0, 0]):
        score = telling_apart(_tables(3), np.array(belief))
        most = 1 - np.dot(belief, belief)
        assert ((score >= -1e-12) & (score <= most + 1e-12)).all()


def test_a_contrast_between_like_parts_is_new_once():
    toy = Toy()
    twins = Twins.of(toy.anatomy, toy.actions)
    # parts 1 and 2 are alike, and 3 and 4: two pairs
    apart = toy.actions[:, [0, 2]] != toy.actions[:, [1, 3]]
    first = new_contrasts(twins, toy.actions, ())
    np.testing.assert_allclose(first, apart.mean(axis=1))
    for action in range(len(toy.actions)):
        later = new_contrasts(twins, toy.actions, (action,))
        np.testing.assert_allclose(later, (apart & ~apart[action]).mean(axis=1))
    done = new_contrasts(twins, toy.actions, tuple(range(len(toy.actions))))
    np.testing.assert_array_equal(done, 0)


def test_plausibility_is_a_distribution_that_falls_with_the_loss():
    losses = np.array([0.0, 1, 1, 30, 900])
    belief = plausibility(losses)
    assert belief.sum() == pytest.approx(1)
    assert belief[1] == belief[2] < belief[0] and (np.diff(belief) <= 0).all()
    np.testing.assert_allclose(plausibility(losses + 100), belief)


def _random(count: int) -> Genomes:
    return random_genomes(anatomy(), count, np.random.default_rng(0), False)


@pytest.mark.parametrize("survived", [0, 1, 15])
def test_sureness_is_a_probability(survived):
    genomes = _random(30)
    losses = np.linspace(0, 5, 30)
    sure = sureness(genomes, losses, genomes[:1], survived=survived)
    assert sure.shape == (PARTS,)
    assert ((sure >= 0) & (sure <= 1 + 1e-12)).all()
    assert sure[0] == 1  # the first part can only hang on the torso


def test_a_body_that_stands_longer_is_surer():
    genomes = _random(30)
    losses = np.append(0, np.full(29, 1e3))
    new, old = (
        sureness(genomes, losses, genomes[:1], survived=survived)
        for survived in (0, 10_000)
    )
    assert (new[1:] < old[1:]).all()
    np.testing.assert_allclose(old, 1, atol=1e-3)


def test_bodies_that_explain_equally_well_share_the_sureness():
    parent = np.array([[0, 0, 1, 1], [0, 0, 1, 2], [0, 0, 0, 1], [0, 1, 1, 0]])
    genomes = from_tree(anatomy(), parent, np.full((4, PARTS), 0.125))
    sure = sureness(genomes, np.zeros(4), genomes[:1], survived=10_000)
    np.testing.assert_allclose(sure, [1, 0.75, 0.75, 0.5], atol=1e-3)


@pytest.fixture(scope="module")
def searched():
    """A search of the toy after two actions: evaluator, its search, evidence."""
    toy = Toy()
    evaluator = Evaluator(toy.anatomy, Statics(), actions=toy.actions)
    rest = evaluator.simulate(toy.truth[np.zeros(2, int)], np.array([0, 5]))
    evidence = Evidence((0, 5), rest)
    twins = Twins.of(toy.anatomy, toy.actions)
    search = RivalSearch(space_of("free"), evaluator, twins)
    search.run(evidence, 3000, np.random.default_rng(0))
    return evaluator, search, evidence


def test_hypotheses_are_different_bodies_with_their_tables_and_losses(searched):
    evaluator, search, evidence = searched
    genomes, tables, losses = hypotheses(
        search.crowd, search.twins, evidence, evaluator
    )
    keys = {genome_key(genomes, row) for row in range(len(genomes))}
    assert len(keys) == len(genomes) == len(tables) == len(losses)
    assert (np.diff(np.round(losses, 5)) >= 0).all()
    tried = list(evidence.tried)
    again = evaluator.loss(tables[:, tried], evidence.felt).sum(axis=1)
    np.testing.assert_allclose(again, losses, atol=1e-6)
    assert losses[0] <= search.crowd.losses[0] + 1e-6


def test_the_method_chooses_untried_actions_and_says_why(searched):
    evaluator, search, evidence = searched
    method = Rivals(evaluator, space="free", known_lengths=False, random_actions=False)
    method.finder = search
    action, why = method.choose(evidence, np.random.default_rng(0))
    assert action not in evidence.tried and why
    first, why = method.choose(Evidence(), np.random.default_rng(0))
    assert 0 <= first < len(evaluator.actions) and "random" in why
