"""Support: what touches the floor, and whether the torso lies still."""

import numpy as np

from selfheal.engine.support import measure_support
from tests.support.star_robot import make_stars

PERIOD = 0.05  # [s]


def _go_to(angle: float) -> np.ndarray:
    """(T, 8) [rad] commands from zero to one angle of all joints."""
    ramp = np.concatenate([np.linspace(0, 1, 20), np.ones(10)])
    return np.outer(ramp, np.full(8, np.radians(angle)))


def test_a_torso_lies_still_while_its_legs_are_up_and_not_where_they_go_down():
    touched, tilt = measure_support(make_stars(1), _go_to(20.0), PERIOD)
    assert touched == 0 and tilt < np.radians(1.0)
    assert measure_support(make_stars(1), _go_to(-20.0), PERIOD)[0] > 10
    one = _go_to(20.0)
    one[:, 0] *= -2.0
    assert measure_support(make_stars(1), one, PERIOD)[1] > np.radians(3.0)
