"""States of actuators go on where a segment begins."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.simulation.dataset import cut_readable_segments
from tests.support.recorded_robots import ROBOTS, bench


@pytest.mark.parametrize("states", [True, False])
def test_an_integrators_state_goes_on_where_a_segment_begins(states, tmp_path):
    """The state begins at 0 where one is given, else where the joint is."""
    servo = '<position name="servo" joint="hinge" kp="3" kv="0.1"/>'
    speed = '<intvelocity name="servo" joint="hinge" kp="3" actrange="-0.4 0.4"/>'
    robot = replace(
        ROBOTS["pendulum"],
        xml=ROBOTS["pendulum"].xml.replace(servo, speed),
        begin=lambda rng: (np.zeros(1), np.zeros(1)),
    )
    how = {"episodes": 1, "seconds": 3.0, "noise": 1e-6, "finer": 1}
    b = bench(robot, tmp_path, states=states, **how)
    segments = cut_readable_segments(b.simulator, 0.5)
    predicted = b.simulator.simulate([], np.zeros((1, 0)), segments)[0]
    assert np.ptp(segments.readings) > 0.3
    np.testing.assert_allclose(predicted, segments.readings, atol=5e-3)
