"""Support: what touches the floor, and whether the torso lies still."""

import numpy as np

from selfheal.engine.support import measure_support
from tests.support.star_robot import make_stars

PERIOD = 0.05  # [s]


def _go_to(angle: float) -> np.ndarray:
    """(T, 8) [rad] commands from zero to one angle of all joints."""
    ramp = np.concatenate([np.linspace(0, 1, 20), np.ones(10)])
    return np.outer(ramp, np.full(8, np.radians(angle)))


def test_a_torso_whose_legs_are_up_carries_all_and_lies_still():
    touched, tilt = measure_support(make_stars(1), _go_to(20.0), PERIOD)
    assert touched == 0 and tilt < np.radians(1.0)


def test_legs_that_go_down_touch_the_floor():
    touched, _ = measure_support(make_stars(1), _go_to(-20.0), PERIOD)
    assert touched > 10


def test_a_torso_that_one_leg_lifts_tilts():
    commands = _go_to(20.0)
    commands[:, 0] *= -2.0
    assert measure_support(make_stars(1), commands, PERIOD)[1] > np.radians(3.0)
