"""Gait patterns keep their shape."""

import numpy as np
import pytest

from selfheal.engine.walk import PERIOD
from selfheal.errors import UnknownNameError
from selfheal.gait.pattern import PATTERNS, SECONDS, SWING, find_pattern


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
