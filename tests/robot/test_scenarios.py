"""Scenarios of damage strike what a robot has."""

import pytest

from selfheal.body.legged import LEGGED, load_legged_robot
from selfheal.damage.apply import build_damaged_plants, reduce_damages
from selfheal.robot.scenarios import SCENARIOS, draw_scenario


@pytest.mark.parametrize("number", SCENARIOS)
@pytest.mark.parametrize("name", LEGGED)
def test_scenarios_strike_what_is_there(name, number):
    robot = load_legged_robot(name)
    for seed in range(4):
        damage = draw_scenario(number, robot, seed)
        assert damage == draw_scenario(number, robot, seed)
        assert reduce_damages(robot, damage) == tuple(
            sorted(damage, key=lambda d: (d.kind, d.target))
        )
        assert len(damage) == {4: 2, 7: 2, 8: 3, 9: 0}.get(number, 1)
        build_damaged_plants(robot, [damage])
