"""Fits step as coarsely as the noise of the readings hides; replays as MuJoCo does."""

import re
from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.simulation.dataset import (
    COARSENINGS,
    MAX_COARSENING_ERROR,
    choose_coarsening,
    cut_readable_segments,
)
from selfheal.diagnosis.simulation.simulator import Simulator
from tests.support.recorded_robots import ROBOTS, Robot, bench


def _with_noise(simulator: Simulator, share: float) -> Simulator:
    """The simulator of readings with noise, a share of each channel's spread."""
    noises = [np.full_like(c.noise, share * c.spread) for c in simulator.channels]
    each = zip(simulator.channels, noises, strict=True)
    return simulator.with_channels(tuple(replace(c, noise=n) for c, n in each))


@pytest.fixture(scope="module")
def simulator(tmp_path_factory) -> Simulator:
    """Of a pendulum in steps of a millisecond, read twenty times a second."""
    folder = tmp_path_factory.mktemp("pendulum")
    return bench(_in_steps(0.001), folder, episodes=2, seconds=2.0, rate=20).simulator


def _in_steps(seconds: float) -> Robot:
    """The pendulum with another time step."""
    robot = ROBOTS["pendulum"]
    step = re.sub(r'timestep="[^"]*"', f'timestep="{seconds}"', robot.xml)
    assert step != robot.xml
    return replace(robot, xml=step)


def test_larger_steps_change_less_than_the_noise(simulator):
    noisy = _with_noise(simulator, 0.01)
    count = choose_coarsening(noisy)
    assert count == max(COARSENINGS)
    coarse = noisy.coarsen(count)
    segments = cut_readable_segments(coarse, 0.5)
    predicted = [
        s.leapfrog.simulate((), np.zeros((1, 0)), w)[0]
        for s, w in ((coarse, segments), (noisy, segments.with_finer_steps(count)))
    ]
    change = np.sqrt(np.mean((predicted[0] - predicted[1]) ** 2, axis=0))
    noise = np.concatenate([c.noise for c in noisy.channels])
    assert (change > 0).all() and (change < 2 * MAX_COARSENING_ERROR * noise).all()


def test_readings_without_noise_ask_for_the_models_own_step(simulator):
    assert choose_coarsening(_with_noise(simulator, 1e-7)) == 1


def test_a_step_is_no_longer_than_the_time_between_samples(tmp_path):
    made = bench(_in_steps(0.01), tmp_path, episodes=2, seconds=1.0, rate=100)
    assert choose_coarsening(_with_noise(made.simulator, 1.0)) == 1


def test_where_something_touches_the_models_own_step_counts(simulator):
    touching = replace(_with_noise(simulator, 1.0), has_contact=True)
    assert choose_coarsening(touching) == 1


def test_its_own_steps_are_those_of_before(simulator):
    again = simulator.coarsen(4).native
    assert again.timestep == simulator.timestep and again.coarsening == 1
    for one, other in zip(again.episodes, simulator.episodes, strict=True):
        np.testing.assert_allclose(one.sample_steps, other.sample_steps, rtol=1e-12)
        np.testing.assert_allclose(one.ctrl, other.ctrl, atol=1e-9)
    assert simulator.native is simulator
