"""Derivatives of readings: exact where they are a quartic, narrow where it bends."""

import numpy as np
import pytest

from selfheal.diagnosis.linear.quartics import choose_half_width, fit_quartics


@pytest.mark.parametrize("jitter", [0.0, 0.002])
def test_derivatives_of_a_quartic_are_its_own_at_any_time(jitter):
    rng = np.random.default_rng(1)
    time = np.arange(0, 0.6, 0.01) + rng.uniform(-jitter, jitter, 60)
    curve = np.polynomial.Polynomial([0.3, -1.0, 2.0, 5.0, -4.0])
    readings = curve(time)
    readings[20] = np.nan
    at = np.linspace(0.1, 0.5, 37)
    found, _ = fit_quartics(time, readings, 6).differentiate(at)
    for k in range(3):
        assert found[k] == pytest.approx(curve.deriv(k)(at) if k else curve(at))


def test_variances_are_those_of_repeated_noise():
    rng = np.random.default_rng(2)
    time, at = np.arange(0, 0.5, 0.01), np.array([0.2513])
    noise = rng.normal(size=(3000, len(time)))
    found = np.array([fit_quartics(time, y, 7).differentiate(at)[0] for y in noise])
    _, variance = fit_quartics(time, noise[0], 7).differentiate(at)
    assert found.var(axis=0)[:, 0] == pytest.approx(variance[:, 0], rel=0.15)


def test_nothing_is_known_where_neighbors_are_missing():
    time = np.arange(0, 0.3, 0.01)
    found, _ = fit_quartics(time, np.sin(time), 5).differentiate(time)
    assert np.isnan(found[:, [0, 4, -5, -1]]).all()
    assert np.isfinite(found[:, 5:-5]).all()
    assert np.isnan(fit_quartics(time[:9], time[:9], 5).coefficients).all()


def test_the_more_noise_there_is_the_wider_a_polynomial_may_be():
    rng = np.random.default_rng(3)
    time = np.arange(0, 20, 0.002)
    widths = []
    for noise in (1e-5, 1e-3, 1e-1):
        readings = np.sin(15 * time) + noise * rng.normal(size=time.size)
        widths.append(choose_half_width(time, readings, noise, 2, 0.5))
    assert widths == sorted(widths) and widths[0] < widths[-1]
    assert choose_half_width(time, np.full(time.size, np.nan), 1.0, 2, 0.5) > 0
