"""Formulas of a robot's changes: the identity at nothing, and what they conserve."""

import numpy as np
import pytest

from selfheal.body.changes import (
    compute_direction,
    follow_with_play,
    limit_rate,
    list_subtree,
    tilt_gravity,
)

RNG = np.random.default_rng(0)
GOALS = np.cumsum(RNG.normal(0, 0.1, (200, 2, 3)), axis=0)


def _downhill(azimuth):
    return np.array([*compute_direction(azimuth), 0.0])


def test_a_subtree_is_a_node_and_all_that_hang_on_it():
    parents = [0, 0, 1, 1, 3, 0, 4]
    assert list_subtree(parents, 3) == [3, 4, 6]
    assert list_subtree(parents, 5) == [5]
    assert list_subtree(parents, 0) == list(range(7))


@pytest.mark.parametrize("azimuth", [0.0, 1.0, -2.5])
def test_a_slope_turns_gravity_downhill_by_its_tilt(azimuth):
    level = np.array([0.0, 0.0, -9.81])
    assert tilt_gravity(level, 0.0, _downhill(azimuth)) == pytest.approx(level)
    turned = tilt_gravity(level, 0.2, _downhill(azimuth))
    assert np.linalg.norm(turned) == pytest.approx(9.81)
    assert turned @ level / 9.81**2 == pytest.approx(np.cos(0.2))
    assert turned @ _downhill(azimuth) == pytest.approx(9.81 * np.sin(0.2))


def test_gravity_may_point_anywhere():
    level = np.array([3.0, 0.0, -4.0])
    turned = tilt_gravity(level, 0.3, np.array([0.0, 1.0, 0.0]))
    assert turned == pytest.approx([3 * np.cos(0.3), 5 * np.sin(0.3), -4 * np.cos(0.3)])


def test_no_step_is_larger_than_the_rate():
    start, most = np.zeros((2, 3)), np.full((2, 3), 0.05)
    reached = limit_rate(GOALS, most, start)
    steps = np.diff(reached, axis=0, prepend=start[None])
    assert np.abs(steps).max() <= 0.05 + 1e-12
    assert np.abs(reached - GOALS).max() > 0.05


def test_a_rate_that_is_never_reached_and_no_play_change_nothing():
    reached = limit_rate(GOALS, np.full((2, 3), 1e3), GOALS[0])
    np.testing.assert_allclose(reached, GOALS, atol=1e-13)
    dragged = follow_with_play(GOALS, np.zeros((2, 1)), np.zeros((2, 3)))
    np.testing.assert_array_equal(dragged, GOALS)


def test_a_rate_may_differ_from_row_to_row():
    goals, most = GOALS[:, 0, :1], np.array([0.01, 0.05])
    both = limit_rate(goals, most, np.zeros(2))
    for row in range(2):
        alone = limit_rate(goals[:, 0], most[row], np.zeros(()))
        np.testing.assert_array_equal(both[:, row], alone)


def test_play_lags_by_its_half_and_bears_what_is_within():
    play = np.full((2, 1), 0.3)
    dragged = follow_with_play(GOALS, play, GOALS[0])
    assert np.abs(dragged - GOALS).max() == pytest.approx(0.15)
    still = follow_with_play(0.1 * np.sin(GOALS), play, np.zeros((2, 3)))
    np.testing.assert_array_equal(still, 0)
