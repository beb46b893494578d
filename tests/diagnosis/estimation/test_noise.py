"""Noise of channels: which is larger than its fit says, and what outliers change."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.data.local_polynomial import (
    ar1_error_factors,
    choose_half_width,
)
from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.noise import (
    robust_noise,
    update_noise_model,
    worst_channel_ratio,
)
from selfheal.diagnosis.estimation.problem import Problem
from tests.support.problems import NOISE, make_pose_problem, make_problem


def test_one_column_with_large_residuals_is_found_among_many(arm):
    problem = make_problem(arm)

    def ratio(column: int, times: float, problem=problem, chosen=None) -> float:
        segments = problem.segments
        off = times * NOISE * np.eye(len(problem.sigma))[column]
        if chosen is not None:
            off = np.isin(segments.segment_of_sample, chosen)[:, None] * off
        segments = replace(segments, readings=segments.readings + off)
        changed = replace(problem, segments=segments)
        return worst_channel_ratio(fit_parameters(changed, (), np.zeros(0)))

    quiet = ratio(0, 0)
    assert 0.5 < quiet < 2 and ratio(1, 20) > 10
    (torque,) = (c for c in arm.simulator.channels if not c.is_scored)
    assert ratio(torque.first_column, 1e3) == quiet  # what is not scored moves nothing
    rough = replace(problem, simulator=replace(problem.simulator, has_contact=True))
    half = range(len(problem.segments) // 2 - 1)
    assert ratio(1, 20, rough) > 10 and ratio(1, 20, rough, half) < 2
    # one odd segment is not the whole column
    assert len(problem.segments) > 6 and ratio(1, 100, chosen=[2]) < 2
    assert ratio(1, 100, chosen=half) > 10


def test_errors_of_most_single_readings_are_their_noise(arm):
    problem, rng = make_pose_problem(arm, 400), np.random.default_rng(0)
    r = rng.normal(size=problem.segments.readings.shape)
    noise = robust_noise(problem, r.ravel())
    assert noise == pytest.approx(np.isfinite(problem.segments.readings).sum(), rel=0.3)
    r[::20] = 100.0
    assert robust_noise(problem, r.ravel()) == pytest.approx(noise, rel=0.3)


def test_readings_that_are_rounded_have_the_noise_of_rounding(arm):
    """Of a joint that hardly moves they scatter less."""
    problem = make_problem(arm)
    quantum = 100 * NOISE
    channels = tuple(replace(c, quantum=quantum) for c in problem.simulator.channels)
    rounded = replace(problem, simulator=problem.simulator.with_channels(channels))
    residuals = np.zeros(problem.segments.readings.size)
    for channel in update_noise_model(rounded, residuals).channels:
        assert (channel.noise >= quantum / np.sqrt(12)).all()


SIZE = 1e-3


def _remembering(rng, shape, memory: float) -> np.ndarray:
    """AR(1) noise of unit variance along the first axis."""
    fresh = rng.normal(size=shape)
    for i in range(1, len(fresh)):
        fresh[i] = memory * fresh[i - 1] + np.sqrt(1 - memory**2) * fresh[i]
    return fresh


def _left(b, residuals, memory: float) -> tuple[Problem, np.ndarray]:
    """A problem and the residuals (R) of its fit; a parabola has found its scatter."""
    segments = cut_segments(b.simulator.episodes, 150)
    _, m = choose_half_width(
        b.simulator.episodes[0].sample_steps * b.simulator.timestep
    )
    scatter = SIZE * np.sqrt(ar1_error_factors(memory, m)[2])
    signals = tuple(
        replace(
            c,
            quantum=0.0,
            scatter=np.full(c.width, scatter),
            noise=np.full(c.width, scatter),
        )
        for c in b.simulator.channels
    )
    left = residuals(segments.readings.shape)
    sigma = np.full(left.shape[1], 2 * SIZE)
    left = np.where(np.isfinite(segments.readings), left / sigma, 0.0)
    return Problem(b.simulator.with_channels(signals), segments, sigma), left.ravel()


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
def test_the_noise_model_finds_the_size_of_autocorrelated_noise(
    noiseless_arm, memory, mismatch
):
    rng = np.random.default_rng(int(100 * memory))

    def residuals(shape):
        swing = np.sin(2 * np.pi * np.arange(shape[0]) / 90)[:, None]
        return SIZE * (_remembering(rng, shape, memory) + mismatch * swing)

    problem, left = _left(noiseless_arm, residuals, memory)
    for c in update_noise_model(problem, left).channels:
        np.testing.assert_allclose(c.noise, SIZE, rtol=0.35)
        if memory:
            np.testing.assert_allclose(c.ar1, memory, atol=0.15)


@pytest.mark.parametrize(
    "grown", [np.cumsum, lambda x, axis: np.cumsum(np.cumsum(x, axis), axis)]
)
def test_what_a_model_error_accumulates_is_no_noise(noiseless_arm, grown):
    """Jumps of a velocity or of a force accumulate so."""
    rng = np.random.default_rng(0)

    def residuals(shape):
        return SIZE * (rng.normal(size=shape) + grown(rng.normal(size=shape), axis=0))

    problem, left = _left(noiseless_arm, residuals, 0.0)
    for c in update_noise_model(problem, left).channels:
        assert (c.noise < 1.2 * SIZE).all()


def test_where_a_command_jumps_the_scatter_about_a_parabola_is_no_noise(noiseless_arm):
    rng = np.random.default_rng(0)
    problem, left = _left(
        noiseless_arm, lambda shape: 0.2 * SIZE * rng.normal(size=shape), 0.0
    )
    for c in update_noise_model(problem, left).channels:
        np.testing.assert_allclose(c.noise, 0.2 * SIZE, rtol=0.1)
