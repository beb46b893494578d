"""Excitation: moves within what joints can hold, that tell all of them apart."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.engine.support import measure_support
from selfheal.engine.walk import PERIOD, SAMPLE
from selfheal.gait.excitation import plan_excitation
from tests.support.star_robot import ACTIONS, make_stars

LIMIT = np.radians(30.0)


@pytest.fixture(scope="module")
def star():
    """Four moves of the star."""
    return plan_excitation(make_stars(1), ACTIONS, 4, seed=3)


def test_joints_stay_among_the_actions_and_begin_at_rest(star):
    assert star.commands.shape[0::2] == (4, 8)
    assert np.abs(star.commands).max() <= LIMIT + 1e-9
    assert not star.commands[:, : round(0.2 / PERIOD)].any()


def test_a_recording_states_every_command(star):
    rows = star.commands.reshape(4, -1, round(SAMPLE / PERIOD), 8)
    assert (rows == rows[:, :, :1]).all()


def test_the_star_swings_its_legs_above_the_floor(star):
    assert star.is_held
    for commands in star.commands[:, ::5]:
        assert measure_support(make_stars(1), commands, SAMPLE)[0] == 0


def test_every_joint_moves_in_its_own_way(star):
    swing = star.commands[:, round(1.2 / PERIOD) :].reshape(-1, 8)
    swing = swing - swing.mean(axis=0)
    together = np.corrcoef(swing, rowvar=False) - np.eye(8)
    assert np.abs(together).max() < 0.5
    assert swing.std(axis=0).min() > np.radians(2.0)


def test_a_bolted_robot_swings_through_all_of_its_range():
    body = make_stars(1)
    bolted = replace(body, anatomy=replace(body.anatomy, fixed=True))
    plan = plan_excitation(bolted, ACTIONS, 1)
    assert plan.is_held
    assert plan.commands.min() < -0.5 * LIMIT and plan.commands.max() > 0.5 * LIMIT


def test_the_seed_alone_decides(star):
    actions, body = ACTIONS, make_stars(1)
    again = plan_excitation(body, actions, 4, seed=3)
    other = plan_excitation(body, actions, 4, seed=4)
    np.testing.assert_array_equal(again.commands, star.commands)
    assert (other.commands != star.commands).any()
