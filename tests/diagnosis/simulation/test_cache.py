"""A cache keeps what segments have, within its limit, and no number depends on it."""

import gc
from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import Segments
from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.simulation.cache import SimulationCache, SimulationCounter
from selfheal.diagnosis.simulation.dataset import cut_readable_segments
from tests.support.recorded_robots import bench


def _segments() -> Segments:
    one = np.zeros(1, int)
    return Segments(one, one, one + 5, one, np.zeros(1), np.zeros((1, 2)))


class Computed:
    """Gives an array, and counts how often."""

    def __init__(self, size: int = 10) -> None:
        self.array, self.times = np.arange(float(size)), 0

    def __call__(self) -> np.ndarray:
        self.times += 1
        return self.array


def test_a_value_is_computed_once_for_each_key_and_segments():
    cache, segments, compute = SimulationCache(), _segments(), Computed()
    for key in ("a", "a", "b"):
        assert cache.load_or_compute(segments, key, compute) is compute.array
    cache.load_or_compute(other := _segments(), "a", compute)
    assert compute.times == 3
    assert len(cache) == 30 and other


def test_values_go_with_their_segments():
    cache, segments = SimulationCache(), _segments()
    cache.load_or_compute(segments, "a", Computed())
    del segments
    gc.collect()
    assert len(cache) == 0


def test_beyond_the_limit_the_oldest_go():
    cache, kept = SimulationCache(limit=25), [_segments() for _ in range(3)]
    computed = [Computed() for _ in kept]
    for i in (0, 1, 0, 2, 0, 1):  # 2 drops 1, the one used the longest time ago
        cache.load_or_compute(kept[i], "a", computed[i])
        assert len(cache) <= 25
    assert [c.times for c in computed] == [1, 2, 1]
    large = Computed(100)
    for _ in range(2):  # what is larger than the limit is kept alone
        cache.load_or_compute(kept[2], "b", large)
    assert large.times == 1 and len(cache) == 100


@pytest.mark.parametrize("name", ["coulomb_friction", "backlash", "command_delay"])
def test_no_number_depends_on_what_is_cached(tmp_path, name):
    pendulum = bench("pendulum", tmp_path, episodes=2, seconds=0.8)
    simulator = pendulum.simulator
    (term, *_) = load_catalogue()[name].propose_terms(pendulum.robot)
    values = np.array([term.initial_values[0]] * 2)
    segments = cut_readable_segments(simulator, 0.3)
    chosen = np.arange(len(segments) // 2)

    def simulate(limit: int) -> np.ndarray:
        own = replace(simulator, cache=SimulationCache(limit))
        for _ in range(2):
            part = own.select_segments(segments, chosen)
            readings = [
                simulator.simulate([term], values, s)
                for s in (segments, part)
                for simulator in (own.leapfrog, own)
            ]
        return np.concatenate([r.ravel() for r in readings])

    np.testing.assert_array_equal(simulate(0), simulate(10**9))


def test_simulators_made_of_another_share_its_counter(tmp_path):
    pendulum = bench("pendulum", tmp_path, episodes=2, seconds=0.6)
    simulator = replace(pendulum.simulator, counter=SimulationCounter())
    segments = cut_readable_segments(simulator, 0.2)
    simulator.simulate([], np.zeros((3, 0)), segments)
    assert simulator.counter.count == 3 * len(segments)
    finer = simulator.with_half_step
    finer.simulate([], np.zeros((1, 0)), segments.with_finer_steps(2))
    simulator.with_late_commands.simulate([], np.zeros((1, 0)), segments)
    assert simulator.counter.count == 5 * len(segments)
    assert finer.cache is not simulator.cache
