"""Segments of a fit begin after what no reading tells, if an episode can spare that."""

import numpy as np
import pytest

from selfheal.diagnosis.simulation.dataset import cut_readable_segments
from tests.support.recorded_robots import bench


@pytest.mark.parametrize("states", [False, True])
def test_segments_of_a_long_episode_begin_after_half_a_second(tmp_path, states):
    b = bench("arm", tmp_path, episodes=2, seconds=5.0, noise=1e-4, states=states)
    for seconds in (0.5, 2.0):
        segments = cut_readable_segments(b.simulator, seconds)
        begun = [segments.first_step[segments.episode == i].min() for i in (0, 1)]
        assert np.array(begun) * b.simulator.timestep == pytest.approx(0.5)


def test_segments_of_a_short_episode_are_all_of_it(tmp_path):
    b = bench("arm", tmp_path, episodes=1, seconds=2.0, noise=1e-4, states=False)
    segments = cut_readable_segments(b.simulator, 0.5)
    assert segments.first_step[0] == 0
    assert len(segments.readings) == len(b.simulator.episodes[0].sample_steps)
