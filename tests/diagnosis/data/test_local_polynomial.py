"""Local parabolas: value and slope of what moves, and its noise."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from selfheal.diagnosis.data.episodes import build_channels, sample_episode
from selfheal.diagnosis.data.local_polynomial import (
    MAX_HALF_WIDTH,
    ar1_error_factors,
    choose_half_width,
    fit_polynomials,
)
from selfheal.recording import Episode, Recording, Signal
from tests.support.hinge_recordings import (
    STEP,
    draw_times,
    make_hinge_recording,
    sample_recording,
)


@pytest.mark.parametrize("seed", range(3))
def test_a_parabola_tells_value_and_slope_of_a_quadratic_exactly(seed):
    rng = np.random.default_rng(seed)
    time, (a, b, c) = draw_times(rng), rng.normal(size=3)
    episode, _ = sample_recording(
        make_hinge_recording(time, knee=a + b * time + c * time**2)
    )
    at = rng.uniform(0, episode.sample_steps[-1], 50)
    value, slope = episode.interpolate(at, STEP)
    t = time[0] + at * STEP
    np.testing.assert_allclose(value[:, 0], a + b * t + c * t**2, atol=1e-6)
    np.testing.assert_allclose(slope[:, 0], b + 2 * c * t, atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_a_body_that_turns_fast_and_evenly_is_told_exactly(seed):
    rng = np.random.default_rng(seed)
    time = np.arange(60) * 0.005
    rate = 15 * rng.normal(size=3)  # [rad/s], of the body's own frame
    start = Rotation.random(random_state=seed)

    def turned(at) -> np.ndarray:
        turns = start * Rotation.from_rotvec(rate * at[:, None])
        return turns.as_quat(scalar_first=True)

    exact = turned(time)
    signal = Signal(exact, "body_orientation", "b", "quaternion")
    episode = Episode(time, np.zeros((60, 0)), (), {"turn": signal})
    found = build_channels([Recording({"only": episode})])
    value, slope = sample_episode("only", episode, found, STEP).interpolate(
        time / STEP, STEP
    )
    sign = np.sign((value * exact).sum(axis=1))[:, None]
    assert np.abs(sign * value - exact).max() < 1e-9
    # the ends too, where no reading is on the other side
    rates = (turned(time + 1e-5) - turned(time - 1e-5)) / 2e-5
    assert np.abs(sign * slope - rates).max() < 1e-4 * np.linalg.norm(rate)


def test_missing_samples_do_not_speak():
    rng = np.random.default_rng(0)
    time = np.arange(100) * 0.005
    values = 1 + time + time**2
    lost = rng.permutation(100)[:30]
    values[lost] = np.nan
    episode, found = sample_recording(make_hinge_recording(time, knee=values))
    value, slope = episode.interpolate(np.arange(0, 240.0), STEP)
    t = np.arange(240) * STEP
    known = np.isfinite(value[:, 0])
    assert known.mean() > 0.5
    np.testing.assert_allclose(value[known, 0], (1 + t + t**2)[known], atol=1e-5)
    np.testing.assert_allclose(slope[known, 0], (1 + 2 * t)[known], atol=1e-3)
    assert np.isfinite(found[0].spread) and found[0].noise < 1e-6


def test_noise_is_told_from_motion():
    rng = np.random.default_rng(1)
    time = np.arange(400) * 0.005
    clean = np.sin(3 * time)
    near = fit_polynomials(time, (clean + 0.01 * rng.normal(size=400))[:, None])
    assert np.sqrt(np.mean(near.scatter**2)) == pytest.approx(0.01, rel=0.15)
    _, found = sample_recording(
        make_hinge_recording(time, knee=clean + 0.01 * rng.normal(size=400))
    )
    assert found[0].noise == pytest.approx(0.01, rel=0.15)


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


@pytest.mark.parametrize("gap", [1e-9, 1e-7, 1e-5])
def test_a_parabola_looks_at_a_bounded_number_of_neighbors(gap):
    """Of a clock in days, and of samples that come in bursts."""
    even = np.arange(1000.0)
    assert choose_half_width(gap * even) == (pytest.approx(gap), MAX_HALF_WIDTH)
    bursts = 0.1 * (even // 10) + gap * (even % 10)
    assert choose_half_width(bursts)[1] < 5
    assert choose_half_width(0.005 * even) == (pytest.approx(0.005), 4)
