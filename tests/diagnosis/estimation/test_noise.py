"""Noise of channels: which is larger than its fit says, and what outliers change."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.noise import robust_noise, worst_channel_ratio
from tests.support.problems import NOISE, make_pose_problem, make_problem


def test_one_loud_column_is_heard_among_many(arm):
    problem = make_problem(arm)

    def ratio(column: int, times: float, problem=problem, windows=None) -> float:
        pieces = problem.segments
        off = times * NOISE * np.eye(len(problem.sigma))[column]
        if windows is not None:
            off = np.isin(pieces.segment_of_sample, windows)[:, None] * off
        pieces = replace(pieces, readings=pieces.readings + off)
        told = replace(problem, segments=pieces)
        return worst_channel_ratio(told, fit_parameters(told, (), np.zeros(0)))

    quiet = ratio(0, 0)
    assert 0.5 < quiet < 2 and ratio(1, 20) > 10
    (torque,) = (c for c in arm.simulator.channels if not c.is_scored)
    assert ratio(torque.first_column, 1e3) == quiet  # what is not scored moves nothing
    rough = replace(problem, simulator=replace(problem.simulator, has_contact=True))
    half = range(len(problem.segments) // 2 - 1)
    assert ratio(1, 20, rough) > 10 and ratio(1, 20, rough, half) < 2
    # one odd window is not the whole column
    assert len(problem.segments) > 6 and ratio(1, 100, windows=[2]) < 2
    assert ratio(1, 100, windows=half) > 10


def test_errors_of_most_single_readings_are_their_noise(arm):
    problem, rng = make_pose_problem(arm, 400), np.random.default_rng(0)
    r = rng.normal(size=problem.segments.readings.shape)
    noise = robust_noise(problem, r.ravel())
    assert noise == pytest.approx(np.isfinite(problem.segments.readings).sum(), rel=0.3)
    r[::20] = 100.0
    assert robust_noise(problem, r.ravel()) == pytest.approx(noise, rel=0.3)
