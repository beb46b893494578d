"""Gaits: patterns keep their shape, searches get better, failures never win."""

import numpy as np
import pytest

from selfheal.engine.plant import build_rated_plant
from selfheal.engine.walk import PERIOD, simulate_walks
from selfheal.errors import UnknownNameError
from selfheal.gait import synthesis
from selfheal.gait.cma_es import ask, start_search, tell
from selfheal.gait.pattern import PATTERNS, SECONDS, SWING, find_pattern
from selfheal.gait.synthesis import (
    Gait,
    evaluate_gait,
    project_on_heading,
    synthesize_gait,
    walk_gait,
)
from selfheal.robot.actions import load_published_body

PLANT = build_rated_plant(load_published_body())


@pytest.mark.parametrize("name", PATTERNS)
def test_a_gait_starts_at_rest_keeps_within_its_swing_and_repeats(name):
    kind, rng = find_pattern(name), np.random.default_rng(1)
    genes = rng.normal(0, 0.5, kind.count_genes(8))
    commands = kind.compute_commands(genes[None], 8, 15.0)[0]
    assert commands.shape == (round(15.0 / PERIOD), 8)
    assert np.abs(commands).max() <= SWING + 1e-9
    assert np.abs(commands[0]).max() < 0.05
    lag = round(kind.compute_period(genes) / PERIOD)
    gap = commands[200 + lag : 400 + lag] - commands[200:400]
    # the paper's cycle is no whole number of periods
    assert np.abs(gap).max() < 0.02


def test_poses_reach_the_four_poses_in_turn_and_end_at_rest():
    kind = find_pattern("poses")
    genes = np.random.default_rng(0).uniform(-1, 1, (1, 32))
    commands = kind.compute_commands(genes, 8, SECONDS)[0]
    poses = SWING * genes.reshape(4, 8)
    for k in range(8):
        row = round((k + 1) * SECONDS / 9 / PERIOD) - 1
        assert commands[row] == pytest.approx(poses[k % 4], abs=0.03)
    assert commands[-1] == pytest.approx(np.zeros(8), abs=1e-9)


def test_a_gait_that_does_not_exist_is_refused():
    with pytest.raises(UnknownNameError, match="waves"):
        find_pattern("gallop")


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


def test_heading_turns_the_way():
    along, across = project_on_heading(np.array([[0.0, 2.0]]), np.pi / 2)
    assert along == pytest.approx(2.0)
    assert across == pytest.approx(0.0)


def test_a_walk_goes_on_from_where_it_stopped():
    rng = np.random.default_rng(4)
    commands = find_pattern("waves").compute_commands(
        0.4 * rng.normal(size=(2, 25)), 8, 2.0
    )
    whole = simulate_walks([PLANT] * 2, commands)
    first = simulate_walks([PLANT] * 2, commands[:, :100])
    rest = simulate_walks(
        [PLANT] * 2, commands[:, 100:], (first.state, first.set_point)
    )
    assert rest.position[:, -1] == pytest.approx(whole.position[:, -1], abs=1e-3)


def test_every_joint_goes_where_its_own_command_sends_it():
    targets = np.radians(np.arange(-20.0, 20.0, 5.0))
    walks = simulate_walks([PLANT], np.tile(targets, (1, 200, 1)))
    assert walks.angles[0, -1] == pytest.approx(targets, abs=0.06)
    # at rest motors do no work
    still = simulate_walks([PLANT], np.zeros((1, 200, 8)))
    assert 0 <= still.energy[0] < 0.02 < walks.energy[0] < 3


def test_nonsense_diverges_and_is_counted():
    from dataclasses import replace

    from selfheal.body.mjcf import Physics

    wild = replace(PLANT, physics=Physics(timestep=0.01, kp=1e7, kv=0.0, damping=0.0))
    wild = replace(wild, torque=wild.torque * 1e6)
    walks = simulate_walks([wild], np.full((1, 100, 8), 0.5))
    assert walks.failed[0]
    assert np.isnan(walks.position[0]).all()


@pytest.fixture
def short(monkeypatch):
    """A search that takes a second."""
    monkeypatch.setattr(synthesis, "_RUNGS", ((2, 3, 2.0), (1, 6, 2.0)))
    monkeypatch.setattr(synthesis, "_RANDOM", 12)


def test_synthesis_repeats_and_beats_standing_still(short):
    first, again = (synthesize_gait([PLANT], seed=5) for _ in range(2))
    assert np.array_equal(first.genes, again.genes)
    assert first.predicted == again.predicted
    assert first.low <= first.predicted <= first.high
    assert first.predicted > 0.02
    assert first.simulations == 12 + (2 * 3 + 6) * 14 + 16


def test_a_search_from_a_good_gait_keeps_it(short):
    good = max(
        (synthesize_gait([PLANT], seed=s) for s in (5, 6)), key=lambda g: g.predicted
    )
    again = synthesize_gait([PLANT], seed=9, start=good)
    assert again.predicted > 0.5 * good.predicted


def test_the_judge_knows_that_standing_still_goes_nowhere():
    still = Gait("waves", np.zeros(25), 0.0, 9.0, 9.0, 9.0, 0, 0)
    assert evaluate_gait([PLANT], still).predicted == pytest.approx(0.0, abs=0.03)
    assert walk_gait([PLANT], still, 2.0).energy[0] < 0.5
