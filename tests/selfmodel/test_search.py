"""The search for rival bodies: every change is tried once, the truth is found."""

from collections.abc import Iterator

import numpy as np
import pytest

from selfheal.body.body import compute_edge_f1
from selfheal.body.genome import Genomes, build_bodies, concatenate_genomes
from selfheal.selfmodel.evaluate import Evidence
from selfheal.selfmodel.rivals import RivalSet
from selfheal.selfmodel.search import RivalSearch, _Climber
from selfheal.selfmodel.space import (
    draw_space_genomes,
    find_space,
    keep_others,
    list_changes,
    list_neighbors,
    make_genome_key,
)
from tests.support.stick_robot import anatomy
from tests.support.stick_search import (
    TOY,
    draw_sticks,
    make_evaluator,
    make_search,
    measure_evidence,
    race_sticks,
)


def test_a_climber_tries_every_change_once_and_after_a_gain_all_of_the_new_body():
    space, rng = find_space("sides"), np.random.default_rng(0)
    first, second = (draw_space_genomes(anatomy(), space, 1, rng) for _ in range(2))
    climber = _Climber(first, 9.0, np.array([4.0, 5.0]))
    _rest(climber, 1)
    climber.move_to(second, 8.0, np.array([4.0, 4.0]))
    assert not climber.is_stuck
    seen = [
        make_genome_key(g, row) for g in _rest(climber, 1000) for row in range(len(g))
    ]
    around = list_neighbors(space, second)
    assert sorted(seen) == sorted(
        make_genome_key(around, k) for k in range(len(around))
    )


def _rest(climber: _Climber, calls: int) -> list[Genomes]:
    """The genomes that a climber tries in so many turns, or until it is stuck."""
    space, rng, tried = find_space("sides"), np.random.default_rng(1), []
    while not climber.is_stuck and len(tried) < calls:
        tried.append(climber.propose_changes(space, 5, rng))
    return tried


def test_after_a_gain_a_climber_goes_on_with_the_next_change():
    """A change that failed a moment ago is tried again last."""
    space, rng = find_space("sides"), np.random.default_rng(0)
    first, second = (draw_space_genomes(anatomy(), space, 1, rng) for _ in range(2))
    climber = _Climber(first, 9.0, np.array([4.0, 5.0]))
    climber.propose_changes(space, 7, rng)
    climber.move_to(second, 8.0, np.array([4.0, 4.0]))
    tried = climber.propose_changes(space, 5, rng)
    expected = keep_others(
        space, list_changes(space, second)[climber.order[7:12]], second
    )
    np.testing.assert_array_equal(tried.parent, expected.parent)
    np.testing.assert_array_equal(tried.placement, expected.placement)


def test_a_change_that_gains_nothing_where_there_is_room_is_given_up():
    """Two of the four actions are well explained and have nothing to give."""
    climber = _Climber(draw_sticks(1), 14.0, np.array([0.5, 8.0, 0.5, 5.0]))
    order, bound = climber.plan_race(4)
    assert order[:2].tolist() == [1, 3]
    mine = np.cumsum(climber.each[order])
    assert (bound[1:] < mine[1:]).all()  # as good as the climber is not enough
    assert mine[0] < bound[0] <= mine[0] + 1  # it may still gain in the second action


def test_a_crowd_keeps_the_best_of_each_structure():
    genomes, rng = draw_sticks(30), np.random.default_rng(0)
    genomes = concatenate_genomes(genomes, genomes, genomes)
    losses = rng.permutation(90).astype(float)
    crowd = RivalSet.empty(make_evaluator())
    for row in range(90):
        table = np.full((len(TOY.actions), 3), losses[row])
        crowd = crowd.add_rival(genomes[[row]], table, losses[row])
    crowd = crowd.keep_best(1000, np.zeros(len(crowd)))
    parent, side = crowd.genomes.parent, crowd.genomes.side
    names = [*map(bytes, np.hstack([parent, side]).astype(np.uint8))]
    assert len(set(names)) == len(names) <= 30
    assert crowd.losses[0] == 0 and (np.diff(crowd.losses) > 0).all()
    np.testing.assert_array_equal(crowd.tables[:, 0, 0], crowd.losses)
    crowd = crowd.keep_best(3, np.zeros(len(crowd)))
    assert len(crowd) == len(crowd.genomes) == 3


def _runs(search: RivalSearch, rng: np.random.Generator) -> Iterator[Evidence]:
    """Evidence that grows, searched for a while each time."""
    for count in (1, 2, 4, 6):
        evidence = measure_evidence(*range(count))
        search.search(evidence, search.evaluator.spent + 1500, rng)
        yield evidence


@pytest.mark.parametrize("seed", range(3))
def test_the_hidden_body_is_found_among_the_rivals(seed):
    evaluator = make_evaluator()
    search, rng = make_search(evaluator), np.random.default_rng(seed)
    for evidence in _runs(search, rng):
        crowd = search.rivals
        every = np.arange(len(evidence))
        again, _ = race_sticks(evaluator, crowd.genomes, evidence, every)
        np.testing.assert_allclose(crowd.losses, again, atol=1e-3)
        costs = crowd.losses + search.compute_prior(crowd.genomes)
        assert (np.diff(costs) >= 0).all() and len(crowd) <= search.size
    right = (
        compute_edge_f1(build_bodies(TOY.anatomy, search.rivals.genomes), TOY.truth)
        == 1
    )
    assert right.any()
    assert search.rivals.losses[0] < 2


def test_a_search_that_explains_every_reading_and_finds_no_other_tree_ends():
    evaluator = make_evaluator()
    search, rng = make_search(evaluator), np.random.default_rng(0)
    evidence = measure_evidence(*range(6))
    search.search(evidence, 10**6, rng)
    assert evaluator.spent < 10**6 and search.vain >= 60
    best = build_bodies(TOY.anatomy, search.rivals.genomes[:1])
    assert compute_edge_f1(best, TOY.truth)[0] == 1
    far = Evidence(evidence.tried, evidence.measured + 50.0)  # nothing explains it
    before = evaluator.spent
    search.search(far, before + 5000, rng)
    assert evaluator.spent >= before + 5000
