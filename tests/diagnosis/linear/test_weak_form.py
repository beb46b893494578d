"""Means of derivatives over windows, from the readings themselves."""

import numpy as np
import pytest

from selfheal.diagnosis.linear.weak_form import average_derivatives

CENTERS, HALF = np.linspace(0.3, 1.6, 14), 0.06


def average(curve):
    """Means of a function over the windows, by many samples of it."""
    s = np.linspace(-1, 1, 4001)
    window = (1 + np.cos(np.pi * s)) / 2
    return np.trapezoid(window * curve(CENTERS[:, None] + HALF * s), s, axis=1)


@pytest.mark.parametrize("jitter", [0.0, 0.002])
@pytest.mark.parametrize("order", [1, 2])
def test_the_mean_derivative_of_a_fast_wave_has_no_bias(order, jitter):
    rng = np.random.default_rng(1)
    time = np.arange(0, 2, 0.01) + rng.uniform(-jitter, jitter, 200)
    rate = 2 * np.pi * 6
    found = average_derivatives(time, np.sin(rate * time), CENTERS, HALF)[0][order]
    turned = {1: np.cos, 2: lambda x: -np.sin(x)}[order]
    true = average(lambda t: rate**order * turned(rate * t))
    assert found == pytest.approx(true, abs=6e-3 * rate**order)


def test_an_acceleration_that_jumps_is_seen_whole():
    time, at = np.arange(0, 2, 0.01), 0.957
    readings = np.where(time > at, 4.0 * (time - at) ** 2, 0.0)
    found = average_derivatives(time, readings, CENTERS, HALF)[0][2]
    true = average(lambda t: np.where(t > at, 8.0, 0.0))
    assert found == pytest.approx(true, abs=0.15)


def test_its_variance_is_that_of_repeated_noise():
    rng = np.random.default_rng(2)
    time = np.arange(0, 2, 0.01)
    noise = rng.normal(size=(400, 200))
    found = [average_derivatives(time, y, CENTERS, HALF)[0][2] for y in noise]
    variance = average_derivatives(time, noise[0], CENTERS, HALF)[1][2]
    assert np.var(found, axis=0) == pytest.approx(variance, rel=0.3)
