"""Where errors lie: in which regime of motion."""

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import Segments, cut_segments
from selfheal.diagnosis.output import localization
from tests.support.recorded_robots import bench


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    return bench("arm", folder, episodes=4, seconds=3.0, seed=6)


@pytest.mark.parametrize("regime", ["reversal", "fast", "slow", "after_step"])
def test_an_error_in_one_regime_is_located_there(regime, arm):
    segments = cut_segments(arm.simulator.episodes, 150)
    masks = localization.classify_samples(arm.simulator, arm.robot, segments)
    r = localization.REGIMES.index(regime)
    names = [c.name for c in arm.simulator.channels]
    elbow, shoulder = names.index("elbow"), names.index("shoulder")
    rng = np.random.default_rng(0)
    square = rng.chisquare(1, (len(segments.sample_steps), len(names)))
    square[:, elbow] += 20 * masks[r, :, elbow]
    share, p = localization.localize_error(arm.simulator, arm.robot, segments, square)
    assert p[elbow, r] < 1e-3
    inside = masks[:, :, elbow]
    density = share[elbow] / inside.mean(axis=1)
    assert np.nanargmax(density) == r
    assert p[shoulder].min() > 0.01
    known = np.isfinite(share)
    assert (share[known] >= 0).all() and (share[known] <= 1).all()


def test_white_noise_lies_nowhere(arm):
    segments = cut_segments(arm.simulator.episodes, 150)
    rng = np.random.default_rng(1)
    square = rng.chisquare(1, (len(segments.sample_steps), len(arm.simulator.channels)))
    _, p = localization.localize_error(arm.simulator, arm.robot, segments, square)
    assert p.min() > 0.01


def test_regimes_are_what_they_are_called(arm):
    segments = cut_segments(arm.simulator.episodes, 150)
    each = localization.classify_samples(arm.simulator, arm.robot, segments)
    masks = dict(zip(localization.REGIMES, each, strict=True))
    elbow = [c.name for c in arm.simulator.channels].index("elbow")
    assert not (masks["slow"] & masks["fast"])[:, elbow].any()
    assert not masks["contact"].any() and not masks["saturated"].any()
    for name in ("reversal", "slow", "fast", "high_load", "after_step", "near_limit"):
        assert 0 < masks[name].mean() < 1, name


def test_contact_is_where_something_touches(tmp_path):
    b = bench("box", tmp_path, episodes=3, seconds=0.8)
    segments = cut_segments(b.simulator.episodes, None)
    masks = localization.classify_samples(b.simulator, b.robot, segments)
    touch = masks[localization.REGIMES.index("contact"), :, 0]
    low = segments.readings[:, b.simulator.channels[0].first_column + 2] < 0.05
    assert touch[low].mean() > 0.85 and not touch[segments.sample_steps < 10].any()


@pytest.mark.parametrize("seed", range(3))
def test_holms_correction_is_holms(seed):
    rng = np.random.default_rng(seed)
    p, tested = rng.uniform(0, 0.2, (4, 5)), rng.random((4, 5)) < 0.7
    fixed = localization._correct_holm(p, tested)
    assert (fixed[~tested] == 1).all() and (fixed[tested] >= p[tested]).all()
    raw, new, m = p[tested], fixed[tested], tested.sum()
    for cell in range(m):
        # the largest of all that are smaller
        worst = max((m - np.sum(raw < q)) * q for q in raw[raw <= raw[cell]])
        assert new[cell] == pytest.approx(min(1, worst))


def test_few_segments_have_the_smallest_p_value_they_can():
    at = np.arange(6)
    segments = Segments(0 * at, at, 1 + 0 * at, at, 1.0 * at, np.zeros((6, 1)))
    assert localization.improvement_p_value(segments, np.zeros(6)) == 1
    for n in range(1, 7):
        assert localization.improvement_p_value(
            segments, 1.0 * (at < n)
        ) == pytest.approx(0.5**n)
