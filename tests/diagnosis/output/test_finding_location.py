"""Where an error lies: how likely it is by chance."""

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import Segments
from selfheal.diagnosis.output.finding_location import improvement_p_value


def test_few_segments_have_the_smallest_p_value_they_can():
    at = np.arange(6)
    segments = Segments(0 * at, at, 1 + 0 * at, at, 1.0 * at, np.zeros((6, 1)))
    assert improvement_p_value(segments, np.zeros(6)) == 1
    for n in range(1, 7):
        assert improvement_p_value(segments, 1.0 * (at < n)) == pytest.approx(0.5**n)
