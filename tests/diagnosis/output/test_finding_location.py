"""Where an error lies: how likely it is by chance."""

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import Segments
from selfheal.diagnosis.output.finding_location import improvement_p_value


def test_few_windows_tell_as_much_as_few_can():
    at = np.arange(6)
    pieces = Segments(0 * at, at, 1 + 0 * at, at, 1.0 * at, np.zeros((6, 1)))
    assert improvement_p_value(pieces, np.zeros(6)) == 1
    for n in range(1, 7):
        assert improvement_p_value(pieces, 1.0 * (at < n)) == pytest.approx(0.5**n)
