"""Legged robots: their counts, and damages that imply others."""

import numpy as np
import pytest

from selfheal.body.damage import Damage
from selfheal.body.legged import load_legged_robot, reduce_damages
from selfheal.engine.reflex import build_damaged_plants
from selfheal.errors import InputError, UnknownNameError
from selfheal.robot.scenarios import draw_scenario
from tests.support.short_recover import JAM, LOST, LOWER, QUADRUPED


@pytest.mark.parametrize(
    ("name", "synapses", "motors", "feet", "places"),
    [("quadruped", 68, 8, 4, 8), ("hexapod", 120, 18, 6, 12)],
)
def test_robots_have_the_counts_of_the_overview(name, synapses, motors, feet, places):
    robot = load_legged_robot(name)
    assert robot.synapses == synapses
    assert (len(robot.motors), robot.feet) == (motors, feet)
    assert len(robot.sensors) == 2 * feet
    assert len(robot.damage_sites) == places
    assert len(load_legged_robot(name, apart=True).damage_sites) == motors


def test_what_there_is_not_is_refused():
    with pytest.raises(UnknownNameError, match="hexapod, quadruped"):
        load_legged_robot("tripod")
    with pytest.raises(InputError, match="30 or 45"):
        load_legged_robot("quadruped", 60)
    with pytest.raises(InputError, match="1 to 15"):
        draw_scenario(16, QUADRUPED, 0)


def test_what_a_loss_says_is_not_said_twice():
    knee = Damage("joint_jam", "joint:left_front_knee")
    angle = Damage("sensor_dead", "sensor:left_front_hip_position")
    said = reduce_damages(QUADRUPED, [LOWER, knee, LOST, JAM, angle, JAM])
    assert said == (JAM, LOST)
    plants = build_damaged_plants(QUADRUPED, [said, (LOST, LOWER, JAM, angle)])
    for one, other in (plants.present, plants.unlocked):
        np.testing.assert_array_equal(one, other)
