"""A robot whose friction hangs on whether it sticks or slips."""

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from tests.support.recorded_robots import bench


@pytest.fixture(scope="session")
def sticky(tmp_path_factory):
    """A cart that sticks or slips by how fast it was, and the friction it has."""
    b = bench("cart_pole", tmp_path_factory.mktemp("cart"), episodes=6, seconds=0.9)
    (term, *_) = find_effect("stribeck_friction").propose_terms(b.robot)
    return b, term, np.array([0.1, 1.0, 0.03])
