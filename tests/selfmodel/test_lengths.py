"""Lengths of parts from readings, and what is stated of them."""

import numpy as np
import pytest

from selfheal.body.genome import LENGTH_RANGE
from selfheal.engine.statics import Statics
from selfheal.robot.actions import load_published_body
from selfheal.selfmodel.lengths import estimate_lengths
from selfheal.selfmodel.schema import (
    CHANNELS,
    SENSOR_SETS,
    SearchPlan,
    estimate_models,
    make_lengths_plan,
    set_lengths,
    simulate_channels,
)
from selfheal.study.after_damage import _state_intervals


def test_estimation_of_lengths_counts_what_it_simulates(known, rng):
    assert len(SENSOR_SETS) == 7
    low, high = LENGTH_RANGE
    ends = set_lengths(known, np.array([[0.0] * 8, [1.0] * 8])).length
    assert np.allclose(ends, [[low] * 8, [high] * 8])
    poses = np.zeros((3, 8))
    poses[:, :4] = rng.uniform(-0.5, 0.5, (3, 4))
    truth = load_published_body()
    felt = simulate_channels(truth[np.zeros(3, int)], poses, Statics())
    assert felt.shape == (3, sum(map(len, CHANNELS.values())))
    plan = SearchPlan(8, lambda genes: set_lengths(known, genes), 20, 5, ("tilt",))
    steps = list(estimate_models(truth, poses, felt, plan, rng))
    assert [spent for *_, spent in steps] == [120 * n for n in (1, 3, 6)]
    assert all(np.isfinite(error) for _, error, _ in steps)


@pytest.mark.parametrize(
    ("sensors", "robots"),
    [
        (("tilt",), 1),
        pytest.param(("tilt",), 5, marks=pytest.mark.slow),
        pytest.param(("clearance", "touch"), 5, marks=pytest.mark.slow),
    ],
)
def test_our_lengths_of_robots_whose_zeros_are_off(sensors, robots, known):
    """Most robots; one whose few poses show little is off by a centimeter."""
    truth, stages, gaps = load_published_body(), (7, 7), []
    for seed in range(robots):
        rng = np.random.default_rng(seed)
        offers = np.radians(30) * rng.choice([-1.0, 1.0], (60, 8))
        zeros, asked = np.radians(rng.normal(0, 1, 8)), []

        def ask(pose, targets=offers + zeros, asked=asked):
            asked.append(pose)
            return simulate_channels(truth, targets[[pose]], Statics())[0]

        plan = make_lengths_plan(known, sensors)
        found, spent = estimate_lengths(
            plan, truth, offers, ask, stages=stages, rng=rng
        )
        assert len(set(asked)) == len(asked) == sum(stages) and spent > 0
        gaps.append(np.abs(found.length - truth.length).mean())
    # a servo that is off by a degree moves a foot by 3 mm
    assert np.median(gaps) < 0.005


def test_feet_alone_tell_lengths_without_slopes(known, rng):
    truth = load_published_body()
    offers = np.radians(30) * rng.choice([-1.0, 1.0], (30, 8))

    def ask(pose):
        return simulate_channels(truth, offers[[pose]], Statics())[0]

    plan = make_lengths_plan(known, ("touch",))
    found, _ = estimate_lengths(plan, truth, offers, ask, stages=(4, 4), rng=rng)
    low, high = LENGTH_RANGE
    assert ((found.length >= low) & (found.length <= high)).all()


def test_a_stated_interval_of_a_length_holds_its_stated_probability(rng):
    anatomy = load_published_body().anatomy
    every = np.ones((105, 8))
    for k in range(104):
        every[k + 1, k // 13] = np.linspace(0.1, 1.8, 13)[k % 13]
    for _ in range(20):
        belief = rng.dirichlet(np.full(105, 0.1))
        for part, (low, high, share_of, _) in enumerate(
            _state_intervals(every, belief, anatomy)
        ):
            inside = (every[:, part] > low) & (every[:, part] < high)
            assert 0.9 - 1e-9 <= share_of <= belief[inside].sum() + 1e-9
