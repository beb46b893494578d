"""Twins: a table that is derived is the table that would be simulated."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from selfheal.body.genome import Genomes, decode_matrix, draw_genomes
from selfheal.body.genome import concatenate_genomes as joined
from selfheal.engine.statics import Statics
from selfheal.selfmodel.evaluate import Evaluator, Evidence
from selfheal.selfmodel.space import find_space, is_same, is_valid
from selfheal.selfmodel.symmetry import SymmetryGroup
from tests.support.stick_robot import PARTS, Toy, anatomy, truth_genome

TOY = Toy()
TWINS = SymmetryGroup.from_actions(TOY.anatomy, TOY.actions)
MEMBERS = [(g, t) for g in range(len(TWINS.turns)) for t in range(len(TWINS.trade))]


def _evaluator() -> Evaluator:
    return Evaluator(TOY.anatomy, Statics(), actions=TOY.actions)


def _genomes(count: int, *, hinges: bool) -> Genomes:
    rng = np.random.default_rng(5)
    if hinges:
        return decode_matrix(anatomy(), rng.random((count, PARTS, 4)))
    return draw_genomes(anatomy(), count, rng, False)


@pytest.mark.parametrize("hinges", [False, True], ids=["lifting", "any hinge"])
def test_the_derived_table_of_a_symmetric_body_is_its_simulation(hinges):
    genomes, evaluator = _genomes(40, hinges=hinges), _evaluator()
    if hinges:  # lengths are genes too, and trade places with their parts
        assert np.ptp(genomes.length) > 0
    tables, rng = evaluator.compute_table(genomes), np.random.default_rng(0)
    derived, twins = [], []
    for row in range(len(genomes)):
        turn, trade = MEMBERS[rng.integers(len(MEMBERS))]
        if TWINS.find_valid_trades(genomes.parent[row])[trade]:
            derived.append(TWINS.map_table(tables[row], turn, trade))
            twins.append(TWINS.map_genome(genomes, row, turn, trade))
    assert len(twins) > 20
    assert is_valid(find_space("free"), joined(*twins)).all()
    simulated = evaluator.compute_table(joined(*twins))
    known = ~np.isnan(np.array(derived)).any(axis=2)
    gap = np.abs(np.array(derived) - simulated)[known].max(axis=1)
    # a body that balances on an edge may fall to either side of it
    assert np.quantile(gap, 0.95) < 0.01


@pytest.mark.parametrize("ordered", [True, False])
def test_the_derived_table_of_any_sensors_is_its_simulation(ordered):
    parts = anatomy().parts
    kinds = "touch", "gravity", "position"
    own = tuple(f"{kind}:{part}" for part in parts for kind in kinds)
    sensors = ("clearance", "tilt", *own)
    sensed = replace(anatomy(), ordered=ordered, sensors=sensors)
    twins = SymmetryGroup.from_actions(sensed, TOY.actions)
    assert twins.channel.shape == (8, 31, 31)
    evaluator = Evaluator(sensed, Statics(), actions=TOY.actions)
    rng = np.random.default_rng(4)
    genomes = draw_genomes(sensed, 30, rng, False)
    tables, gaps = evaluator.compute_table(genomes), []
    for row in range(30):
        turn, trade = MEMBERS[rng.integers(len(MEMBERS))]
        if twins.find_valid_trades(genomes.parent[row])[trade]:
            derived = twins.map_table(tables[row], turn, trade)
            twin = twins.map_genome(genomes, row, turn, trade)
            gap = np.abs(derived - evaluator.compute_table(twin)[0]).max(axis=1)
            gaps += gap[np.isfinite(gap)].tolist()
            evidence, parent = Evidence((0, 1, 2), derived[:3]), genomes.parent[row]
            losses = twins.compute_losses(parent, tables[row], evidence, evaluator.loss)
            assert losses[turn, trade] == pytest.approx(0, abs=1e-6)
    # a body that balances on an edge may fall to either side of it
    assert len(gaps) > 50 and np.quantile(gaps, 0.9) < 0.02


def test_hinges_that_are_known_forbid_mirrors_that_turn_them():
    left = replace(anatomy(), hinges=(0, 2, 0, 2))
    known = SymmetryGroup.from_actions(left, TOY.actions)
    free = SymmetryGroup.from_actions(left, TOY.actions, hinges_known=False)
    assert not known.turns[:, 1].any() and free.turns[:, 1].any()


def test_the_identity_is_a_symmetry_of_every_body():
    genomes = _genomes(10, hinges=False)
    table = _evaluator().compute_table(genomes)
    for row in range(10):
        assert is_same(TWINS.map_genome(genomes, row, 0, 0), genomes[[row]]).all()
        np.testing.assert_allclose(TWINS.map_table(table[row], 0, 0), table[row])


def test_only_parts_that_are_alike_trade_labels():
    toy = anatomy()
    assert len(np.unique(TWINS.trade, axis=0)) == len(TWINS.trade)
    for trade in TWINS.trade:
        np.testing.assert_array_equal(np.sort(trade), np.arange(PARTS))
        for name in ("length", "radius", "mass", "block_mass"):
            values = getattr(toy, name)
            np.testing.assert_array_equal(values[trade], values)


def test_a_trade_moves_the_joints_of_an_action_along():
    for trade, action in zip(TWINS.trade, TWINS.action, strict=True):
        for twin, original in enumerate(action):
            np.testing.assert_allclose(
                TOY.actions[original], TOY.actions[twin][trade], atol=1e-9
            )


def test_an_oblong_torso_turns_only_by_halves():
    oblong = replace(anatomy(), rim=np.array([0.06, 0.07, 0]))
    assert set(SymmetryGroup.from_actions(oblong, TOY.actions).turns[:, 0]) == {0, 2}
    assert set(TWINS.turns[:, 0]) == {0, 1, 2, 3}


@pytest.mark.parametrize("turn, trade", MEMBERS[:: max(1, len(MEMBERS) // 8)])
def test_losses_find_the_relabeling_that_is_the_truth(turn, trade):
    genome, evaluator = truth_genome(), _evaluator()
    assert TWINS.find_valid_trades(genome.parent[0])[trade]
    disguised = TWINS.map_genome(genome, 0, turn, trade)
    felt, table = evaluator.compute_table(joined(genome, disguised))
    evidence, parent = Evidence(tuple(range(len(felt))), felt), disguised.parent[0]
    losses = TWINS.compute_losses(parent, table, evidence, evaluator.loss)
    assert losses.min() < 0.01
    best = np.unravel_index(int(np.argmin(losses)), losses.shape)
    found = evaluator.compute_table(TWINS.map_genome(disguised, 0, *map(int, best)))[0]
    np.testing.assert_allclose(found, felt, atol=0.01)


def test_an_action_that_is_not_offered_leaves_a_gap():
    some = TOY.actions[:2]
    twins = SymmetryGroup.from_actions(TOY.anatomy, some)
    assert (twins.action[0] == [0, 1]).all()
    missing = twins.action < 0
    for trade in np.flatnonzero(missing.any(axis=1)):
        table = twins.map_table(np.ones((2, 3)), 0, int(trade))
        np.testing.assert_array_equal(np.isnan(table).all(axis=1), missing[trade])


def test_every_pair_of_like_parts_trades():
    pairs = [p for p in combinations(range(PARTS), 2) if _alike(*p)]
    for i, j in pairs:
        order = np.arange(PARTS)
        order[[i, j]] = j, i
        assert (order == TWINS.trade).all(axis=1).any()


def _alike(i: int, j: int) -> bool:
    toy = anatomy()
    return toy.length[i] == toy.length[j] and toy.block_mass[i] == toy.block_mass[j]
