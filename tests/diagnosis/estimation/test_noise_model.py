"""Noise that remembers the sample before: told from motion, and what it does."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.data.local_polynomial import (
    MAX_HALF_WIDTH,
    ar1_error_factors,
    choose_half_width,
)
from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.data.state_estimate import estimate_initial_state
from selfheal.diagnosis.estimation.noise import update_noise_model
from selfheal.diagnosis.estimation.problem import Problem
from tests.support.recorded_robots import bench

SIZE = 1e-3


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    return bench("arm", folder, episodes=30, seconds=2.0, rate=200, seed=3, noise=0.0)


def _remembering(rng, shape, memory: float) -> np.ndarray:
    """Noise of unit variance, of first order along the first axis."""
    fresh = rng.normal(size=shape)
    for i in range(1, len(fresh)):
        fresh[i] = memory * fresh[i - 1] + np.sqrt(1 - memory**2) * fresh[i]
    return fresh


def _left(b, residuals, memory: float) -> tuple[Problem, np.ndarray]:
    """Windows of which a fit left these, and a parabola its share of their noise."""
    pieces = cut_segments(b.simulator.episodes, 150)
    _, m = choose_half_width(
        b.simulator.episodes[0].sample_steps * b.simulator.timestep
    )
    scatter = SIZE * np.sqrt(ar1_error_factors(memory, m)[2])
    signals = tuple(
        replace(c, scatter=np.full(c.width, scatter), noise=np.full(c.width, scatter))
        for c in b.simulator.channels
    )
    told = residuals(pieces.readings.shape)
    sigma = np.full(told.shape[1], 2 * SIZE)
    told = np.where(np.isfinite(pieces.readings), told / sigma, 0.0)
    return Problem(b.simulator.with_channels(signals), pieces, sigma), told.ravel()


@pytest.mark.parametrize(
    ("memory", "mismatch"),
    [
        (0.0, 0.0),
        (0.5, 0.0),
        (0.8, 0.0),
        (0.9, 0.0),
        (0.0, 3.0),
        (0.5, 3.0),
        (0.8, 3.0),
    ],
)
def test_noise_is_as_large_as_it_is_however_slow(arm, memory, mismatch):
    rng = np.random.default_rng(int(100 * memory))

    def residuals(shape):
        swing = np.sin(2 * np.pi * np.arange(shape[0]) / 90)[:, None]
        return SIZE * (_remembering(rng, shape, memory) + mismatch * swing)

    problem, told = _left(arm, residuals, memory)
    for c in update_noise_model(problem, told).channels:
        np.testing.assert_allclose(c.noise, SIZE, rtol=0.35)
        if memory:
            np.testing.assert_allclose(c.ar1, memory, atol=0.15)


@pytest.mark.parametrize(
    "grown", [np.cumsum, lambda x, axis: np.cumsum(np.cumsum(x, axis), axis)]
)
def test_what_a_mismatch_piles_up_is_no_noise(arm, grown):
    """As jumps of a velocity or a force do."""
    rng = np.random.default_rng(0)

    def residuals(shape):
        return SIZE * (rng.normal(size=shape) + grown(rng.normal(size=shape), axis=0))

    problem, told = _left(arm, residuals, 0.0)
    for c in update_noise_model(problem, told).channels:
        assert (c.noise < 1.2 * SIZE).all()


@pytest.mark.parametrize("memory", [0.0, 0.6, 0.95])
@pytest.mark.parametrize("m", [2, 5, 11])
def test_what_slow_noise_does_to_a_parabola(memory, m):
    rng = np.random.default_rng(m)
    t = np.arange(-m, m + 1.0)
    noise = np.linalg.cholesky(
        memory ** np.abs(t[:, None] - t) + 1e-12 * np.eye(len(t))
    )
    size = 20000
    white, slow = (
        np.polynomial.polynomial.polyfit(t, a @ rng.normal(size=(len(t), size)), 2)
        for a in (np.eye(len(t)), noise)
    )
    value, slope, left = ar1_error_factors(memory, m)
    ratio = slow.std(axis=1) / white.std(axis=1)
    np.testing.assert_allclose(ratio[:2], [value, slope], rtol=0.05)
    drawn = noise @ rng.normal(size=(len(t), size))
    fitted = np.polynomial.polynomial.polyfit(t, drawn, 2)
    about = drawn - np.polynomial.polynomial.polyval(t, fitted).T
    assert (about**2).sum(axis=0).mean() / (len(t) - 3) == pytest.approx(left, rel=0.05)


def test_where_noise_is_slow_a_start_is_known_less_well(arm):
    def errors(memory):
        signals = tuple(
            replace(c, noise=np.full(c.width, SIZE), ar1=np.full(c.width, memory))
            for c in arm.simulator.channels
        )
        return estimate_initial_state(
            arm.simulator.with_channels(signals), 0, np.array([200.0]), {}
        )[2]

    assert (errors(0.8) > 1.2 * errors(0.0)).all()


def test_where_a_command_jumps_what_a_parabola_leaves_is_no_noise(arm):
    rng = np.random.default_rng(0)
    problem, told = _left(arm, lambda shape: 0.2 * SIZE * rng.normal(size=shape), 0.0)
    for c in update_noise_model(problem, told).channels:
        np.testing.assert_allclose(c.noise, 0.2 * SIZE, rtol=0.1)


@pytest.mark.parametrize("gap", [1e-9, 1e-7, 1e-5])
def test_a_parabola_looks_at_a_bounded_number_of_neighbors(gap):
    """Of a clock in days, and of samples that come in bursts."""
    even = np.arange(1000.0)
    assert choose_half_width(gap * even) == (pytest.approx(gap), MAX_HALF_WIDTH)
    bursts = 0.1 * (even // 10) + gap * (even % 10)
    assert choose_half_width(bursts)[1] < 5
    assert choose_half_width(0.005 * even) == (pytest.approx(0.005), 4)
