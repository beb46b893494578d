"""Searches: to give up early changes no winner, failures never win, truth is found."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.body import compute_edge_f1, count_centers_in_torso
from selfheal.body.genome import (
    HINGE_NAMES,
    Genomes,
    build_bodies,
    concatenate_genomes,
    draw_genomes,
)
from selfheal.engine.statics import Statics
from selfheal.selfmodel.evaluate import (
    CAPPED_LOSS,
    PAPER_LOSS,
    Evaluator,
    Evidence,
    Loss,
)
from selfheal.selfmodel.paper import CLIMBERS, PaperSearch, ReleasedQuirks, mutate_genes
from selfheal.selfmodel.search import RivalSearch, RivalSet, _Climber
from selfheal.selfmodel.space import (
    SPACES,
    cross_genomes,
    draw_nudges,
    draw_space_genomes,
    find_space,
    is_same,
    is_valid,
    keep_others,
    list_changes,
    list_neighbors,
    make_genome_key,
    perturb_genome,
)
from selfheal.selfmodel.symmetry import SymmetryGroup
from tests.support.stick_robot import PARTS, Toy, anatomy, truth_genome

TOY = Toy()
FREE = find_space("free")
NO_LIMIT = np.inf


class Slow:
    """Statics without its race; it may fail on all bodies shaped like the truth."""

    name = "slow"

    def __init__(self, batch: int, *, fails: bool = False) -> None:
        self.batch, self.fails = batch, fails

    def simulate(self, bodies, targets):
        rest = Statics().simulate(bodies, targets)
        failed = self.fails & _true_shape(bodies)
        for values in (rest.tilt, rest.clearance, rest.touch):
            values[failed] = np.nan
        return replace(rest, failed=failed)


def _true_shape(bodies) -> np.ndarray:
    """(N) whether two parts hang on the torso and the others on one of them each."""
    return (np.sort(bodies.parent, axis=1) == [0, 0, 1, 2]).all(axis=1) & (
        bodies.parent[:, :2] == 0
    ).all(axis=1)


def _evaluator(engine=None, loss: Loss = CAPPED_LOSS) -> Evaluator:
    return Evaluator(TOY.anatomy, engine or Statics(), actions=TOY.actions, loss=loss)


def _evidence(*tried: int) -> Evidence:
    """What the toy felt under some actions."""
    felt = _evaluator().compute_table(truth_genome())[0]
    return Evidence(tried, felt[list(tried)])


def _genomes(count: int) -> Genomes:
    return draw_genomes(anatomy(), count, np.random.default_rng(2), False)


def _search(evaluator: Evaluator, space=FREE) -> RivalSearch:
    return RivalSearch(
        space, evaluator, SymmetryGroup.from_actions(TOY.anatomy, TOY.actions)
    )


ENGINES = [Statics(), Slow(1), Slow(64)]
engines = pytest.mark.parametrize("engine", ENGINES, ids=["race", "one", "waves"])


@engines
def test_giving_up_early_changes_nobody_below_the_bound(engine):
    genomes, evidence = _genomes(60), _evidence(0, 3, 5, 8)
    evaluator, order = _evaluator(engine), np.arange(4)
    never = np.full(60, NO_LIMIT)
    full, every = evaluator.compute_losses(genomes, evidence, bound=never, order=order)
    whole = evaluator.spent
    limit = float(np.quantile(full[np.isfinite(full)], 0.2))
    for order in (np.arange(4), np.array([2, 0, 3, 1])):
        before = evaluator.spent
        bound = np.full(60, limit)
        total, each = evaluator.compute_losses(
            genomes, evidence, bound=bound, order=order
        )
        below = full < limit
        np.testing.assert_allclose(total[below], full[below])
        assert (total[~below] == np.inf).all()
        assert np.argmin(total) == np.argmin(full)
        known = ~np.isnan(each)
        np.testing.assert_allclose(each[known], every[known])
        assert evaluator.spent - before < whole


@engines
def test_a_simulation_is_one_candidate_under_one_action(engine):
    evaluator, evidence = _evaluator(engine), _evidence(1, 4)
    seen = []
    evaluator.progress = seen.append
    genomes = _genomes(30)
    bound = np.full(30, NO_LIMIT)
    _, each = evaluator.compute_losses(
        genomes, evidence, bound=bound, order=np.arange(2)
    )
    assert evaluator.spent == (~np.isnan(each)).sum() == seen[-1]
    evaluator.compute_table(genomes)
    assert (
        evaluator.spent == seen[-1] == (~np.isnan(each)).sum() + 30 * len(TOY.actions)
    )


def test_bodies_with_parts_inside_the_torso_are_not_simulated():
    """Papers.md 1.1; they are worse than any other."""
    genomes, evaluator = _genomes(200), _evaluator()
    inside = count_centers_in_torso(build_bodies(TOY.anatomy, genomes)) > 0
    assert 0 < inside.sum() < 200
    total, each = evaluator.compute_losses(
        genomes, _evidence(0), bound=np.full(200, NO_LIMIT), order=np.arange(1)
    )
    np.testing.assert_array_equal(np.isinf(total), inside)
    np.testing.assert_array_equal(np.isnan(each[:, 0]), inside)
    assert evaluator.spent == (~inside).sum()


def test_hardest_first_tries_every_action_once():
    evaluator, evidence = _evaluator(), _evidence(2, 7, 4, 0)
    assert sorted(evaluator.order_by_hardness(evidence)) == [0, 1, 2, 3]
    bound = np.full(40, NO_LIMIT)
    evaluator.compute_losses(_genomes(40), evidence, bound=bound, order=np.arange(4))
    order = evaluator.order_by_hardness(evidence)
    assert sorted(order) == [0, 1, 2, 3]
    hardness = evaluator.hardness[list(np.array(evidence.tried)[order])]
    assert (np.diff(hardness) <= 0).all()
    fresh = evidence.add(9, np.zeros(3))
    assert evaluator.order_by_hardness(fresh)[0] == 4  # what was never tried leads


def test_a_channel_that_was_not_felt_costs_nothing():
    loss = Loss(np.array([1.0, 2.0, 3.0]), np.array([np.inf, 1.0, np.inf]))
    measured = np.array([1.0, 0, np.nan])
    assert loss(np.array([3.0, 9, 7]), measured) == 2 + 2 * 1


@pytest.mark.parametrize("batch", [1, 64])
def test_a_failed_candidate_can_never_become_the_best(batch):
    """The hidden body itself fails, and is not believed in however well it fits."""
    assert _true_shape(TOY.truth).all()
    evaluator = _evaluator(Slow(batch, fails=True))
    search, evidence = _search(evaluator), _evidence(0, 3, 5)
    search.search(evidence, 2000, np.random.default_rng(0))
    assert evaluator.failed > 0 and len(search.rivals)
    assert np.isfinite(search.rivals.losses).all()
    assert not _true_shape(search.rivals.genomes).any()
    released = PaperSearch(_evaluator(Slow(batch, fails=True), PAPER_LOSS))
    released.climb(evidence, 5, np.random.default_rng(0))
    finite = np.isfinite(released.losses)
    assert finite[0] and (np.diff(released.losses[finite]) >= 0).all()
    assert not (finite & _true_shape(released.genomes)).any()


@pytest.mark.parametrize("name", SPACES)
def test_neighbors_are_other_bodies_of_the_space(name):
    space, rng = find_space(name), np.random.default_rng(0)
    for row in range(5):
        genome = draw_space_genomes(anatomy(), space, 5, rng)[[row]]
        fine = keep_others(draw_nudges(space, genome, rng), genome)
        for around in (list_neighbors(space, genome), fine):
            assert is_valid(around).all()
            assert not is_same(around, genome).any()
            assert ((around.placement >= 0) & (around.placement < 1)).all()
            if not space.hinges:
                assert (around.hinge == genome.hinge).all()
            if not space.lengths:
                assert (around.length == genome.length).all()
            if space.sides:
                np.testing.assert_allclose(around.placement % 0.25, 0.125)
        coarse = list_neighbors(space, genome)
        assert (coarse.length == genome.length).all()
        assert (coarse.parent != genome.parent).any(axis=1).any()


def test_one_change_brings_a_part_to_any_place_with_any_hinge():
    """Two changes through a body that fits worse are not climbed."""
    space, rng = find_space("full"), np.random.default_rng(0)
    genome = draw_space_genomes(anatomy(), space, 1, rng)
    around = concatenate_genomes(genome, list_neighbors(space, genome))
    for part in range(genome.parent.shape[1]):
        spots = np.column_stack(
            [around.parent[:, part], around.side[:, part], around.hinge[:, part]]
        )
        rest = np.delete(np.arange(genome.parent.shape[1]), part)
        still = np.ones(len(around), bool)
        for gene in ("parent", "placement", "hinge"):
            values = getattr(around, gene)[:, rest]
            still &= (values == getattr(genome, gene)[:, rest]).all(axis=1)
        assert len(np.unique(spots[still], axis=0)) == 4 * (part + 1) * len(HINGE_NAMES)


def test_the_same_row_is_the_same_change_of_every_body():
    space, rng = find_space("full"), np.random.default_rng(0)
    pair = [
        list_changes(space, draw_space_genomes(anatomy(), space, 1, rng))
        for _ in range(2)
    ]
    assert len(pair[0]) == len(pair[1])
    row = 0
    for part in range(PARTS):
        spots = 4 * (part + 1) * len(HINGE_NAMES)
        for gene in ("parent", "placement", "hinge"):
            one, other = (getattr(g, gene)[row : row + spots, part] for g in pair)
            np.testing.assert_array_equal(one, other)
        row += spots


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
    """What a climber tries in so many turns, or until it is stuck."""
    space, rng, tried = find_space("sides"), np.random.default_rng(1), []
    while not climber.is_stuck and len(tried) < calls:
        tried.append(climber.propose_changes(space, 5, rng))
    return tried


def test_after_a_gain_a_climber_goes_on_with_the_next_change():
    """What failed a moment ago is tried again last."""
    space, rng = find_space("sides"), np.random.default_rng(0)
    first, second = (draw_space_genomes(anatomy(), space, 1, rng) for _ in range(2))
    climber = _Climber(first, 9.0, np.array([4.0, 5.0]))
    climber.propose_changes(space, 7, rng)
    climber.move_to(second, 8.0, np.array([4.0, 4.0]))
    tried = climber.propose_changes(space, 5, rng)
    expected = keep_others(list_changes(space, second)[climber.order[7:12]], second)
    np.testing.assert_array_equal(tried.parent, expected.parent)
    np.testing.assert_array_equal(tried.placement, expected.placement)


def test_a_change_that_gains_nothing_where_there_is_room_is_given_up():
    """Of four actions two are well explained: they have nothing to give."""
    climber = _Climber(_genomes(1), 14.0, np.array([0.5, 8.0, 0.5, 5.0]))
    order, bound = climber.plan_race(4)
    assert order[:2].tolist() == [1, 3]
    mine = np.cumsum(climber.each[order])
    assert (bound[1:] < mine[1:]).all()  # as good as the climber is not enough
    assert mine[0] < bound[0] <= mine[0] + 1  # it may still gain in the second action


def test_a_neighbor_of_a_neighbor_can_be_the_body_itself():
    rng = np.random.default_rng(0)
    genome = draw_space_genomes(anatomy(), find_space("sides"), 1, rng)
    around = list_neighbors(find_space("sides"), genome)
    assert any(
        is_same(list_neighbors(find_space("sides"), around[[k]]), genome).any()
        for k in range(5)
    )


@pytest.mark.parametrize("name", SPACES)
def test_kicks_and_crosses_stay_in_the_space(name):
    space, rng = find_space(name), np.random.default_rng(1)
    parents = draw_space_genomes(anatomy(), space, 40, rng)
    for row in range(0, 40, 2):
        kick = perturb_genome(space, parents[[row]], rng)
        child = cross_genomes(parents[[row]], parents[[row + 1]], rng)
        for genome in (kick, child):
            assert len(genome) == 1 and is_valid(genome).all()
            if space.sides:
                np.testing.assert_allclose(genome.placement % 0.25, 0.125)
        either = (child.parent == parents.parent[row]) | (
            child.parent == parents.parent[row + 1]
        )
        assert either.all()


def test_equal_bodies_have_equal_keys():
    genomes = concatenate_genomes(_genomes(20), _genomes(20))
    keys = [make_genome_key(genomes, row) for row in range(40)]
    assert keys[:20] == keys[20:] and len(set(keys)) == 20


def test_a_crowd_keeps_the_best_of_each_structure():
    genomes, rng = _genomes(30), np.random.default_rng(0)
    genomes = concatenate_genomes(genomes, genomes, genomes)
    losses = rng.permutation(90).astype(float)
    crowd = RivalSet.empty(PARTS, len(TOY.actions))
    for row in range(90):
        table = np.full((len(TOY.actions), 3), losses[row])
        crowd.add_rival(genomes[[row]], table, losses[row])
    crowd.keep_best(1000)
    parent, side = crowd.genomes.parent, crowd.genomes.side
    names = [*map(bytes, np.hstack([parent, side]).astype(np.uint8))]
    assert len(set(names)) == len(names) <= 30
    assert crowd.losses[0] == 0 and (np.diff(crowd.losses) > 0).all()
    np.testing.assert_array_equal(crowd.tables[:, 0, 0], crowd.losses)
    crowd.keep_best(3)
    assert len(crowd) == len(crowd.genomes) == 3


def _runs(search: RivalSearch, rng: np.random.Generator) -> Iterator[Evidence]:
    """Evidence that grows, searched for a while each time."""
    for count in (1, 2, 4, 6):
        evidence = _evidence(*range(count))
        search.search(evidence, search.evaluator.spent + 1500, rng)
        yield evidence


@pytest.mark.parametrize("seed", range(3))
def test_the_hidden_body_is_found_among_the_rivals(seed):
    evaluator = _evaluator()
    search, rng = _search(evaluator), np.random.default_rng(seed)
    for evidence in _runs(search, rng):
        crowd = search.rivals
        again, _ = evaluator.compute_losses(
            crowd.genomes,
            evidence,
            bound=np.full(len(crowd), NO_LIMIT),
            order=np.arange(len(evidence)),
        )
        np.testing.assert_allclose(crowd.losses, again, atol=1e-3)
        assert (np.diff(crowd.losses) >= 0).all() and len(crowd) <= search.size
    right = (
        compute_edge_f1(build_bodies(TOY.anatomy, search.rivals.genomes), TOY.truth)
        == 1
    )
    assert right.any()
    assert search.rivals.losses[0] < 2


def test_the_same_seed_searches_the_same_way():
    crowds = []
    for _ in range(2):
        search = _search(_evaluator())
        list(_runs(search, np.random.default_rng(4)))
        crowds.append(search.rivals)
    np.testing.assert_array_equal(crowds[0].losses, crowds[1].losses)
    np.testing.assert_array_equal(
        crowds[0].genomes.placement, crowds[1].genomes.placement
    )


def test_the_losses_of_the_2006_climbers_never_rise():
    search = PaperSearch(_evaluator(loss=PAPER_LOSS))
    rng, evidence = np.random.default_rng(0), _evidence(0, 4)
    search.climb(evidence, 1, rng)
    for _ in range(20):
        before = search.losses
        search.climb(evidence, 1, rng)
        assert (search.losses <= before + 1e-9).all()
        assert (np.diff(search.losses) >= 0).all()
    assert search.genes.shape == (CLIMBERS, PARTS)


def test_the_2006_climbers_spend_no_more_than_their_ceiling():
    evaluator = _evaluator(loss=PAPER_LOSS)
    search = PaperSearch(evaluator)
    search.climb(_evidence(0, 4, 6), 10, np.random.default_rng(0))
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


@pytest.mark.parametrize("pair", [False, True])
def test_a_pair_move_keeps_a_sum(pair):
    """The rule moves two genes apart; the released one starts from one value twice."""
    genes, rng = np.array([0.45, 0.5, 0.53, 0.6]), np.random.default_rng(0)
    checked = 0
    for _ in range(500):
        moved = mutate_genes(genes, ReleasedQuirks(idle_copies=False, pair=pair), rng)
        changed = np.flatnonzero(moved != genes)
        if len(changed) != 2 or np.abs(moved - genes)[changed].max() > 0.3:
            continue  # one gene, or one that went round or was cut off
        total, (i, j) = moved[changed].sum(), changed
        sums = [2 * genes[i], 2 * genes[j]] if pair else [genes[i] + genes[j]]
        assert np.isclose(sums, total).any()
        checked += 1
    assert checked > 50


def test_the_2006_score_prefers_actions_that_the_best_models_disagree_on():
    search = PaperSearch(_evaluator(loss=PAPER_LOSS))
    rng = np.random.default_rng(0)
    search.climb(_evidence(0), 5, rng)
    score, tables = search.score_actions(0.0, rng)
    assert tables.shape == (5, len(TOY.actions), 3)
    spread = tables.std(axis=0) * np.array([1, 1, 0.01])
    np.testing.assert_allclose(score, spread.sum(axis=1))
    cautious, _ = search.score_actions(1.0, rng)
    assert (cautious <= 0).all()
