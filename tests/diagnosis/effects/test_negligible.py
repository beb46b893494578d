"""Values of an effect that are too small or too odd to be named."""

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from tests.support.recorded_robots import bench


@pytest.mark.parametrize("name", ["arm", "box"])
def test_delays_of_a_step_are_negligible_only_in_contact(name, tmp_path):
    b = bench(name, tmp_path, episodes=1)
    step, touches = b.simulator.timestep, name == "box"
    (term, *_) = find_effect("sensor_delay").propose_terms(b.robot)
    assert b.robot.has_contact == touches
    assert term.is_negligible(np.array([step])) == touches
    assert not term.is_negligible(np.array([3 * step]))


def test_a_torque_of_less_than_a_period_is_negligible_cogging(arm):
    term = find_effect("cogging").propose_terms(arm.robot)[1]
    amplitude, least = term.scale[0], term.low[1]
    assert term.is_negligible(np.array([amplitude, least, 0.3]))
    assert not term.is_negligible(np.array([amplitude, 1.5 * least, 0.3]))
