"""Choosing actions and stating sureness: laws of probabilities."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.genome import (
    Genomes,
    concatenate_genomes,
    draw_genomes,
    encode_tree,
)
from selfheal.selfmodel.attachment_probability import compute_attachment_probability
from selfheal.selfmodel.evaluate import Evidence
from selfheal.selfmodel.explore import (
    choose_action,
    choose_first_action,
    choose_random_action,
    compute_plausibility,
    count_contrasts,
    draw_voters,
    find_indistinguishable,
    measure_disagreement,
    predict_belief,
    score_actions,
)
from selfheal.selfmodel.neighborhood import Neighborhood
from selfheal.selfmodel.prior import (
    compute_prior_cost,
    count_rules,
    draw_alike_genomes,
)
from selfheal.selfmodel.space import (
    draw_space_genomes,
    find_space,
    is_valid,
    make_genome_key,
)
from selfheal.selfmodel.strategy import RivalStrategy
from selfheal.selfmodel.symmetry import SymmetryGroup
from tests.support.stick_robot import PARTS, Toy, anatomy
from tests.support.stick_search import make_evaluator, make_search, measure_evidence

ACTIONS = 10


def _tables(count: int) -> np.ndarray:
    """(count, ACTIONS, 3) channels, no two alike."""
    return np.random.default_rng(0).normal(0, 5, (count, ACTIONS, 3))


def _even(count: int) -> np.ndarray:
    return np.full(count, 1 / count)


def test_no_action_is_chosen_twice():
    score, tried = np.random.default_rng(0).normal(size=ACTIONS), ()
    for _ in range(ACTIONS):
        tried = (*tried, choose_action(score, tried))
    assert sorted(tried) == list(range(ACTIONS))
    np.testing.assert_array_equal(tried, np.argsort(-score))


def test_no_action_is_drawn_twice_and_all_are_drawn():
    rng, firsts = np.random.default_rng(0), set()
    for _ in range(100):
        tried = ()
        for _ in range(4):
            tried = (*tried, choose_random_action(4, tried, rng))
        assert sorted(tried) == [0, 1, 2, 3]
        firsts.add(tried[0])
    assert firsts == {0, 1, 2, 3}


WEIGHT = np.array([1.0, 1.0, 0.5])  # of degrees and millimeters


def belief_in_right(tables, parent, belief) -> np.ndarray:
    """(A) belief in the right tree that can be expected after each action."""
    return predict_belief(tables, parent, belief, WEIGHT)[0] @ belief


def _trees(count: int) -> np.ndarray:
    """(count, 1) trees, no two alike."""
    return np.arange(count)[:, None]


def test_more_disagreement_is_more_information_and_none_is_none():
    tables, last = _tables(5), belief_in_right(0 * _tables(5), _trees(5), _even(5))
    np.testing.assert_allclose(last, 1 / 5)
    for scale in (0.01, 0.1, 1, 10):
        score = belief_in_right(scale * tables, _trees(5), _even(5))
        assert (score > last).all()
        last = score
    np.testing.assert_allclose(belief_in_right(1e4 * tables, _trees(5), _even(5)), 1)


def test_the_order_and_the_splitting_of_bodies_are_irrelevant():
    tables, belief = _tables(5), np.array([0.5, 0.2, 0.1, 0.1, 0.1])
    tree = np.array([[0], [1], [0], [2], [3]])
    score = belief_in_right(tables, tree, belief)
    order = np.array([3, 1, 4, 0, 2])
    again = belief_in_right(tables[order], tree[order], belief[order])
    np.testing.assert_allclose(again, score)
    twice = [np.concatenate([x, x]) for x in (tables, tree)]
    halves = np.concatenate([belief, belief]) / 2
    np.testing.assert_allclose(belief_in_right(*twice, halves), score)
    np.testing.assert_allclose(belief_in_right(-tables, tree, belief), score)


def test_belief_in_the_right_tree_is_a_probability_and_no_reading_lowers_it():
    """At least the chance that two bodies drawn by belief are of the same tree."""
    tree = np.array([[0], [1], [1]])
    for belief in ([0.4, 0.3, 0.3], [0.9, 0.05, 0.05], [1.0, 0, 0]):
        score = belief_in_right(_tables(3), tree, np.array(belief))
        least = belief[0] ** 2 + (belief[1] + belief[2]) ** 2
        assert ((score >= least - 1e-12) & (score <= 1 + 1e-12)).all()


def test_what_an_action_says_of_bodies_of_one_tree_counts_for_nothing():
    tables = _tables(4)
    tree = np.zeros((4, PARTS), int)
    np.testing.assert_allclose(belief_in_right(tables, tree, _even(4)), 1)
    # one action tells sides apart, the other trees: bodies of trees 0, 0, 1, 1
    tilts = np.zeros((4, 2, 3))
    tilts[:, 0, 0], tilts[:, 1, 0] = [0, 99, 0, 99], [0, 0, 99, 99]
    pairs = np.array([[0], [0], [1], [1]])
    np.testing.assert_allclose(belief_in_right(tilts, pairs, _even(4)), [0.5, 1])


def test_an_even_question_is_worth_more_and_so_is_one_that_tells_bodies_of_a_tree():
    tilts, belief = np.zeros((4, 3, 3)), _even(4)
    tilts[:, 0, 0], tilts[:, 1, 0], tilts[:, 2, 0] = [0, 0, 0, 99], [0, 0, 99, 99], 0
    tree, body = predict_belief(tilts, _trees(4), belief, WEIGHT)
    np.testing.assert_allclose(tree, body)  # a tree each
    np.testing.assert_allclose(tree @ belief, [0.5, 0.5, 0.25])
    score = score_actions(tree, body, belief)
    assert score[1] > score[0] > score[2]
    same = predict_belief(tilts, np.zeros((4, PARTS)), belief, WEIGHT)
    np.testing.assert_allclose(same[0] @ belief, 1)
    score = score_actions(*same, belief)
    assert score[1] > score[0] > score[2]


def test_contrasts_count_the_like_parts_that_an_action_sends_apart():
    toy = Toy()
    twins = SymmetryGroup.from_actions(toy.anatomy, toy.actions, hinges_known=True)
    # parts 1 and 2 are alike, and 3 and 4: two pairs
    apart = toy.actions[:, [0, 2]] != toy.actions[:, [1, 3]]
    found = count_contrasts(twins, toy.actions)
    np.testing.assert_array_equal(found, apart.sum(axis=1))
    rng = np.random.default_rng(0)
    first = {choose_first_action(twins, toy.actions, rng) for _ in range(100)}
    assert first == set(np.flatnonzero(found == 2))


def test_plausibility_is_a_distribution_that_falls_with_the_loss():
    losses = np.array([0.0, 1, 1, 30, 900])
    belief = compute_plausibility(losses)
    assert belief.sum() == pytest.approx(1)
    assert belief[1] == belief[2] < belief[0] and (np.diff(belief) <= 0).all()
    np.testing.assert_allclose(compute_plausibility(losses + 100), belief)


def _random(count: int) -> Genomes:
    return draw_genomes(anatomy(), count, np.random.default_rng(0), False)


def test_the_prior_counts_rules_and_not_labels():
    like, sides = anatomy(), np.array([[0.125, 0.625, 0.375, 0.375]])
    star = encode_tree(like, np.array([[0, 0, 1, 2]]), sides)
    crossed = encode_tree(like, np.array([[0, 0, 2, 1]]), sides)
    chain = encode_tree(like, np.array([[0, 1, 2, 3]]), np.full((1, PARTS), 0.375))
    # 1 and 2 are alike, and 3 and 4; left and front are not opposite
    uneven = encode_tree(like, star.parent, np.array([[0.125, 0.375, 0.375, 0.375]]))
    bent = encode_tree(like, star.parent, np.array([[0.125, 0.625, 0.125, 0.125]]))
    every = concatenate_genomes(star, crossed, chain, uneven, bent)
    rules, sideways = count_rules(like, every)
    np.testing.assert_array_equal(rules, [3, 3, 5, 4, 3])
    np.testing.assert_array_equal(sideways, [0, 0, 0, 0, 1])
    free = find_space("free")
    costs = [compute_prior_cost(like, free, body) for body in (chain, star)]
    assert (costs[0] > costs[1]).all()
    twins = SymmetryGroup.from_actions(like, Toy().actions, hinges_known=True)
    genomes = _random(20)
    for turn in range(len(twins.turns)):
        for trade in range(len(twins.trade)):
            rows = np.array([twins.find_valid_trades(p)[trade] for p in genomes.parent])
            some = genomes[np.flatnonzero(rows)]
            same = np.full(len(some.parent), turn), np.full(len(some.parent), trade)
            np.testing.assert_allclose(
                compute_prior_cost(like, free, twins.map_genomes(some, *same)),
                compute_prior_cost(like, free, some),
            )


@pytest.mark.parametrize("name", ["free", "sides", "full"])
@pytest.mark.parametrize("ordered", [True, False])
def test_bodies_drawn_from_the_prior_are_valid_alike_and_the_likeliest_first(
    name, ordered
):
    like = replace(anatomy(), ordered=ordered)
    space = replace(find_space(name), ordered=ordered)
    drawn = draw_alike_genomes(like, space, 300, np.random.default_rng(0))
    assert is_valid(space, drawn).all()
    costs = compute_prior_cost(like, space, drawn)
    assert (np.diff(costs) >= 0).all()
    some = draw_space_genomes(like, space, 300, np.random.default_rng(0))
    assert costs.mean() < compute_prior_cost(like, space, some).mean()
    star = drawn.parent[:, 2:] == [1, 2]
    assert (star.all(axis=1) & (drawn.parent[:, :2] == 0).all(axis=1)).any() or (
        not ordered
    )


def state_sureness(parent, belief, survived: int) -> np.ndarray:
    """(P) sureness of the first of the trees."""
    return compute_attachment_probability(
        parent, belief, parent[0], survived=survived, ordered=True
    )


def test_sureness_is_a_probability_that_rises_while_a_body_stays_the_best():
    parent, belief = _random(30).parent, compute_plausibility(np.linspace(0, 5, 30))
    last = np.zeros(PARTS)
    for survived in (0, 1, 15):
        sure = state_sureness(parent, belief, survived)
        assert sure.shape == (PARTS,) and sure[0] == 1  # it hangs on the torso alone
        assert ((sure > last) & (sure <= 1 + 1e-12))[1:].all()
        last = sure
    old = state_sureness(parent, np.append(1, np.zeros(29)), 10_000)
    np.testing.assert_allclose(old, 1, atol=1e-3)


def test_bodies_that_explain_equally_well_share_the_sureness():
    parent = np.array([[0, 0, 1, 1], [0, 0, 1, 2], [0, 0, 0, 1], [0, 1, 1, 0]])
    sure = state_sureness(parent, _even(4), 10_000)
    np.testing.assert_allclose(sure, [1, 0.75, 0.75, 0.5], atol=1e-3)


@pytest.fixture(scope="module")
def searched():
    """A search of the toy after two actions: evaluator, its search, evidence."""
    evaluator, evidence = make_evaluator(), measure_evidence(0, 5)
    search = make_search(evaluator)
    search.search(evidence, 3000, np.random.default_rng(0))
    return evaluator, search, evidence


@pytest.fixture(scope="module")
def found(searched):
    """The neighborhood and its rivals after the search."""
    evaluator, search, evidence = searched
    kin = Neighborhood(search)
    before = evaluator.spent, evaluator.spent_choosing
    kin.update(search.rivals, evidence)
    assert evaluator.spent == before[0] and evaluator.spent_choosing > before[1]
    return kin, kin.list_hypotheses(evidence)


def test_hypotheses_are_different_bodies_with_their_tables_and_losses(searched, found):
    evaluator, search, evidence = searched
    some = found[1][np.arange(min(50, len(found[1])))]
    genomes = some.genomes
    assert len({make_genome_key(genomes, row) for row in range(len(some))}) == len(some)
    assert (np.diff(np.round(some.costs, 5)) >= 0).all()
    tried = list(evidence.tried)
    again = evaluator.loss(some.tables[:, tried], evidence.measured).sum(axis=1)
    np.testing.assert_allclose(again, some.losses, atol=1e-6)
    np.testing.assert_allclose(
        evaluator.compute_table(genomes[:3]), some.tables[:3], atol=1e-6
    )
    np.testing.assert_allclose(some.costs, some.losses + search.compute_prior(genomes))
    assert some.losses.min() <= search.rivals.losses[0] + 1e-6


def test_a_neighborhood_holds_no_two_symmetric_bodies(searched, found):
    _, search, _ = searched
    kin, _ = found
    count = len(kin.bodies)
    assert count > len(search.rivals) / 2
    parent, valid_of = kin.bodies.genomes.parent, search.twins.find_valid_trades
    valid = np.flatnonzero([valid_of(p).all() for p in parent])
    trade = np.full(len(valid), len(search.twins.trade) - 1)
    twins = search.twins.map_genomes(kin.bodies.genomes[valid], 0 * trade + 1, trade)
    kin.add_bodies(twins, kin.bodies.tables[valid])
    assert len(kin.bodies) == count


def test_voters_stand_for_all_belief(found):
    _, every = found
    rng = np.random.default_rng(0)
    some, belief = draw_voters(every, rng)
    assert belief.sum() == pytest.approx(1) and len(some) <= len(every)
    likeliest = compute_plausibility(every.costs)[0]
    assert abs(belief[0] - likeliest) < 0.01


def test_the_method_chooses_untried_actions_and_says_why(searched):
    evaluator, _, evidence = searched
    method = RivalStrategy(evaluator, find_space("free"), random_actions=False)
    rng = np.random.default_rng(0)
    first, why = method.choose_action(Evidence.empty(3), rng)
    assert 0 <= first < len(evaluator.actions) and "random" in why
    method.search_bodies(evidence, evaluator.spent + 500, rng)
    action, why = method.choose_action(evidence, rng)
    assert action not in evidence.tried and "belief" in why
    rivals = method.list_rivals()  # of those that fit equally, the plainer one first
    costs = rivals.losses + method.compute_prior(rivals.genomes)
    assert (np.diff(costs) >= -1e-12).all()


def test_bodies_alike_are_all_that_no_action_tells_from_the_best(searched):
    evaluator, search, evidence = searched
    method = RivalStrategy(evaluator, find_space("free"), random_actions=False)
    method.neighborhood.update(search.rivals, evidence)
    method.found = found = method.neighborhood.list_hypotheses(evidence)
    table = found.tables[0]
    gap = np.nan_to_num(np.abs(found.tables - table)).max(axis=1)
    expected = found.genomes[(gap <= [1.0, 1.0, 2.0]).all(axis=1)]
    assert 0 < len(expected) < len(found)
    np.testing.assert_array_equal(
        method.list_indistinguishable(table).parent, expected.parent
    )
    for channel, most in enumerate((1.0, 1.0, 2.0)):
        moved = table.copy()
        moved[3, channel] += 0.99 * most
        first = found[np.array([0])]
        assert len(find_indistinguishable(first, moved, WEIGHT)) == 1
        moved[3, channel] += 0.02 * most
        assert len(find_indistinguishable(first, moved, WEIGHT)) == 0


def test_disagreement_is_the_spread_of_the_posterior():
    rng = np.random.default_rng(0)
    tables, belief = rng.normal(size=(6, 5, 2)), rng.random(6)
    spread = measure_disagreement(tables, belief)
    assert spread > 0 and np.isclose(
        measure_disagreement(3 * tables + 7, belief), 3 * spread
    )
    assert np.isclose(measure_disagreement(tables, 9 * belief), spread)
    assert measure_disagreement(tables[[2, 2]], belief[:2]) < 1e-9
    sure = np.eye(6)[3]
    assert measure_disagreement(tables, sure) < 1e-9
    assert np.isclose(measure_disagreement(np.array([[[1.0]], [[5.0]]]), np.ones(2)), 2)
    # a failed simulation is as if the body were not there; no action left, no spread
    failed = tables.copy()
    failed[4] = np.nan
    rest = np.arange(6) != 4
    expected = measure_disagreement(tables[rest], belief[rest])
    assert np.isclose(measure_disagreement(failed, belief), expected)
    assert measure_disagreement(tables[:, :0], belief) == 0
