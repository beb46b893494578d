"""Segments cover every reading once."""

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import Segments, cut_segments
from tests.support.hinge_recordings import (
    draw_times,
    make_hinge_recording,
    sample_recording,
)


def _three_logs():
    rng = np.random.default_rng(5)
    logs = []
    for n in range(3):
        time = draw_times(rng, 60 + 20 * n)
        values = rng.normal(size=time.size)
        values[rng.permutation(time.size)[:5]] = np.nan
        logs.append(sample_recording(make_hinge_recording(time, knee=values))[0])
    return logs


@pytest.mark.parametrize("steps", [None, 25, 100, 10000])
def test_segments_cover_every_reading_once(steps):
    logs = _three_logs()
    found = cut_segments(logs, steps)
    read = np.sort(np.concatenate([x.readings for x in logs]).ravel())
    np.testing.assert_array_equal(
        np.sort(found.readings.ravel()), read[np.isfinite(read)]
    )
    assert (found.sample_steps >= 0).all()
    assert (found.sample_steps <= found.lengths[found.segment_of_sample]).all()
    assert (np.diff(found.segment_of_sample) >= 0).all()
    for w, log_of, start in zip(
        range(len(found)), found.episode, found.first_step, strict=True
    ):
        rows = found.segment_of_sample == w
        at = logs[log_of].sample_steps
        back = np.interp(found.sample_steps[rows] + start, at, np.arange(len(at)))
        np.testing.assert_allclose(back, np.round(back), atol=1e-6)


def test_segments_of_every_sample_are_cut_with_empty():
    logs = _three_logs()
    found = cut_segments(logs, None, empty=True)
    assert len(found.sample_steps) == sum(len(x.sample_steps) for x in logs)


def test_selected_segments_keep_their_samples_in_the_order_asked_for():
    found = cut_segments(_three_logs(), 50)
    chosen = np.array([4, 1, 7])
    few = found.select(chosen)
    np.testing.assert_array_equal(
        few.readings, found.readings[found.find_sample_rows(chosen)]
    )
    for new, old in enumerate(chosen):
        np.testing.assert_array_equal(
            few.sample_steps[few.segment_of_sample == new],
            found.sample_steps[found.segment_of_sample == old],
        )


def test_segments_of_episodes_joined_are_the_segments_of_all():
    logs = _three_logs()
    apart = Segments.concatenate([cut_segments(logs, 40, only=i) for i in range(3)])
    whole = cut_segments(logs, 40)
    for field in (
        "episode",
        "first_step",
        "lengths",
        "segment_of_sample",
        "sample_steps",
        "readings",
    ):
        np.testing.assert_array_equal(getattr(apart, field), getattr(whole, field))
