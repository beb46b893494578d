"""Twins: a table that is derived is the table that would be simulated."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.body import Ints
from selfheal.body.genome import Genomes, concatenate_genomes, decode_matrix
from selfheal.body.genome import draw_genomes as draw
from selfheal.engine.statics import Statics
from selfheal.selfmodel.evaluate import Evaluator, Evidence
from selfheal.selfmodel.space import find_space, is_same, is_valid
from selfheal.selfmodel.symmetry import SymmetryGroup
from tests.support.stick_robot import PARTS, anatomy, truth_genome
from tests.support.stick_search import TOY, draw_sticks, make_evaluator

TWINS = SymmetryGroup.from_actions(TOY.anatomy, TOY.actions, hinges_known=True)
MEMBERS = [(g, t) for g in range(len(TWINS.turns)) for t in range(len(TWINS.trade))]


def _draw_twins(twins: SymmetryGroup, genomes: Genomes) -> tuple[Ints, Ints, Ints]:
    """Rows of bodies, and of each the turn and the trade that make a valid twin."""
    rng, rows = np.random.default_rng(0), np.arange(len(genomes))
    turn, trade = np.array(MEMBERS)[rng.integers(len(MEMBERS), size=len(rows))].T
    valid = [twins.find_valid_trades(genomes.parent[k])[trade[k]] for k in rows]
    return rows[valid], turn[valid], trade[valid]


@pytest.mark.parametrize("hinges", [False, True], ids=["lifting", "any hinge"])
def test_the_derived_table_of_a_symmetric_body_is_its_simulation(hinges):
    genomes, evaluator = draw_sticks(40), make_evaluator()
    if hinges:  # lengths are genes too, and trade places with their parts
        matrix = np.random.default_rng(5).random((40, PARTS, 4))
        genomes = decode_matrix(anatomy(), matrix)
        assert np.ptp(genomes.length) > 0
    rows, turn, trade = _draw_twins(TWINS, genomes)
    assert len(rows) > 20
    derived = TWINS.map_tables(evaluator.compute_table(genomes)[rows], turn, trade)
    twins = TWINS.map_genomes(genomes[rows], turn, trade)
    assert is_valid(find_space("free"), twins).all()
    known = ~np.isnan(derived).any(axis=2)
    gap = np.abs(derived - evaluator.compute_table(twins))[known].max(axis=1)
    # a body that balances on an edge may fall to either side of it
    assert np.quantile(gap, 0.95) < 0.01


@pytest.mark.parametrize("ordered", [True, False])
def test_the_derived_table_of_any_sensors_is_its_simulation(ordered):
    kinds = "touch", "gravity", "position"
    own = tuple(f"{kind}:{part}" for part in anatomy().parts for kind in kinds)
    sensors = ("clearance", "tilt", *own)
    sensed = replace(anatomy(), ordered=ordered, sensors=sensors)
    twins = SymmetryGroup.from_actions(sensed, TOY.actions, hinges_known=True)
    assert twins.channel.shape == (8, 31, 31)
    evaluator = Evaluator(sensed, Statics(), actions=TOY.actions)
    genomes = draw(sensed, 30, np.random.default_rng(4), False)
    rows, turn, trade = _draw_twins(twins, genomes)
    tables = evaluator.compute_table(genomes)[rows]
    derived = twins.map_tables(tables, turn, trade)
    simulated = evaluator.compute_table(twins.map_genomes(genomes[rows], turn, trade))
    for k, (table, parent) in enumerate(zip(tables, genomes.parent[rows], strict=True)):
        evidence = Evidence((0, 1, 2), derived[k, :3])
        losses = twins.compute_losses(parent, table, evidence, evaluator.loss)
        assert losses[turn[k], trade[k]] == pytest.approx(0, abs=1e-6)
    gaps = np.abs(derived - simulated).max(axis=2)
    gaps = gaps[np.isfinite(gaps)]
    # a body that balances on an edge may fall to either side of it
    assert len(gaps) > 50 and np.quantile(gaps, 0.9) < 0.02


def test_hinges_that_are_known_forbid_mirrors_that_turn_them():
    left = replace(anatomy(), hinges=(0, 2, 0, 2))
    known, free = (
        SymmetryGroup.from_actions(left, TOY.actions, hinges_known=hinges_known)
        for hinges_known in (True, False)
    )
    assert not known.turns[:, 1].any() and free.turns[:, 1].any()


def test_the_identity_is_a_symmetry_of_every_body():
    genomes, none = draw_sticks(10), np.zeros(10, int)
    tables = make_evaluator().compute_table(genomes)
    same = TWINS.map_genomes(genomes, none, none)
    assert all(is_same(same[[k]], genomes[[k]]) for k in range(10))
    np.testing.assert_allclose(TWINS.map_tables(tables, none, none), tables)


def test_all_parts_that_are_alike_trade_labels_and_no_others():
    toy = anatomy()
    alike = np.column_stack([toy.length, toy.radius, toy.mass, toy.block_mass])
    assert len(np.unique(TWINS.trade, axis=0)) == len(TWINS.trade)
    for trade in TWINS.trade:
        np.testing.assert_array_equal(np.sort(trade), np.arange(PARTS))
        np.testing.assert_array_equal(alike[trade], alike)
    for i in range(PARTS):
        for j in range(i):
            order = np.arange(PARTS)
            order[[i, j]] = j, i
            trades = (order == TWINS.trade).all(axis=1).any()
            assert trades == (alike[i] == alike[j]).all()


def test_a_trade_moves_the_joints_of_an_action_along():
    for trade, action in zip(TWINS.trade, TWINS.action, strict=True):
        for twin, original in enumerate(action):
            np.testing.assert_allclose(
                TOY.actions[original], TOY.actions[twin][trade], atol=1e-9
            )


def test_an_oblong_torso_turns_only_by_halves():
    oblong = replace(anatomy(), rim=np.array([0.06, 0.07, 0]))
    twins = SymmetryGroup.from_actions(oblong, TOY.actions, hinges_known=True)
    assert set(twins.turns[:, 0]) == {0, 2}
    assert set(TWINS.turns[:, 0]) == {0, 1, 2, 3}


@pytest.mark.parametrize("turn, trade", MEMBERS[:: max(1, len(MEMBERS) // 8)])
def test_losses_find_the_relabeling_that_is_the_truth(turn, trade):
    genome, evaluator = truth_genome(), make_evaluator()
    assert TWINS.find_valid_trades(genome.parent[0])[trade]
    disguised = TWINS.map_genomes(genome, np.array([turn]), np.array([trade]))
    both = concatenate_genomes(genome, disguised)
    felt, table = evaluator.compute_table(both)
    evidence, parent = Evidence(tuple(range(len(felt))), felt), disguised.parent[0]
    losses = TWINS.compute_losses(parent, table, evidence, evaluator.loss)
    assert losses.min() < 0.01
    best = np.array(np.unravel_index(int(np.argmin(losses)), losses.shape))[:, None]
    found = evaluator.compute_table(TWINS.map_genomes(disguised, *best))[0]
    np.testing.assert_allclose(found, felt, atol=0.01)


def test_an_action_that_is_not_offered_leaves_a_gap():
    some = TOY.actions[:2]
    twins = SymmetryGroup.from_actions(TOY.anatomy, some, hinges_known=True)
    assert (twins.action[0] == [0, 1]).all()
    trade = np.arange(len(twins.trade))
    tables = twins.map_tables(np.ones((len(trade), 2, 3)), 0 * trade, trade)
    np.testing.assert_array_equal(np.isnan(tables).all(axis=2), twins.action < 0)
