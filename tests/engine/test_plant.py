"""Plants: motors keep their limits, joints what holds them."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.damage.apply import apply_damages
from selfheal.damage.words import parse_damages
from selfheal.engine.plant import (
    build_rated_plant,
    compute_set_points,
)
from selfheal.robot.actions import load_published_body

BODY = load_published_body()
ANATOMY = BODY.anatomy


def _points(plant, commands, period=0.01):
    start = np.zeros((1, ANATOMY.size))
    return compute_set_points([plant], commands[None], period, start)[0]


def test_set_points_keep_to_the_motors_speed_and_range():
    plant = build_rated_plant(BODY)
    commands = np.full((400, ANATOMY.size), np.radians(170))
    points = _points(plant, commands)
    steps = np.diff(np.vstack([0 * points[:1], points]), axis=0) / 0.01
    assert np.all(steps <= plant.speed + 1e-9)
    assert points[-1] == pytest.approx(plant.high)


def test_late_commands_with_play_follow_the_same_way_later():
    plant = replace(build_rated_plant(BODY), delay=0.05, backlash=0.02)
    time = np.arange(300) * 0.01
    commands = 0.3 * np.sin(2 * time)[:, None] * np.ones(ANATOMY.size)
    points, ideal = _points(plant, commands), _points(build_rated_plant(BODY), commands)
    assert np.abs(points[5:] - ideal[:-5]).max() <= 0.01 + 1e-9


def test_a_jammed_joint_stays_where_it_is():
    jam = parse_damages("jam:left_hip:20", ANATOMY)
    plant = apply_damages(build_rated_plant(BODY), *jam)
    points = _points(plant, np.zeros((200, ANATOMY.size)))
    joint = ANATOMY.joints.index("left_hip")
    assert points[100:, joint] == pytest.approx(np.radians(20))
    assert np.all(np.delete(points, joint, axis=1) == 0)
