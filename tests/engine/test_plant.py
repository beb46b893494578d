"""Damaged plants: only what a damage says is changed; motors keep their limits."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.damage import list_sensors, parse_damages
from selfheal.engine.plant import (
    Plant,
    apply_damages,
    build_rated_plant,
    compute_set_points,
    list_gone_targets,
    list_lost_parts,
    list_motions,
)
from selfheal.robot.actions import load_published_body

BODY = load_published_body()
ANATOMY = BODY.anatomy


def _damage(said: str, plant: Plant | None = None) -> Plant:
    """A rated plant, or this one, after damages."""
    plant = plant or build_rated_plant(BODY)
    return apply_damages(plant, *parse_damages(said, ANATOMY))


def test_a_leg_is_lost_with_all_that_hangs_on_it():
    upper = ANATOMY.parts.index("right_upper")
    gone = [ANATOMY.parts[i] for i in list_lost_parts(BODY, upper)]
    assert gone == ["right_upper", "right_lower"]
    after = _damage("loss:right_upper").body
    changed = np.flatnonzero(after.length[0] != BODY.length[0])
    assert [ANATOMY.parts[i] for i in changed] == gone


def test_a_damage_changes_only_what_it_says():
    plant = build_rated_plant(BODY)
    weak = _damage("weak:back_knee:0.4", plant)
    joint = ANATOMY.joints.index("back_knee")
    ratio = weak.torque / plant.torque
    assert ratio[joint] == pytest.approx(0.4)
    assert np.all(np.delete(ratio, joint) == 1)
    assert weak.body is plant.body
    dead = _damage("dead:vertical", plant)
    assert dead.gain == {"vertical": 0.0}
    assert set(list_sensors(ANATOMY)) >= {"vertical", "left_hip_position"}


def test_damages_of_one_part_add_up_and_never_shrink_it_beyond_a_lost_one():
    plant = build_rated_plant(BODY)
    short = parse_damages("right_lower:0.5, lie:clearance:0.5", ANATOMY)
    twice = apply_damages(plant, *short, *short)
    part = ANATOMY.parts.index("right_lower")
    assert twice.body.thickness[0, part] == pytest.approx(0.25)
    assert twice.gain["clearance"] == pytest.approx(0.25)
    lost = _damage("loss:right_lower").body
    most = apply_damages(plant, *8 * short, *parse_damages("loss:right_upper", ANATOMY))
    assert most.body.thickness[0, part] == pytest.approx(lost.thickness[0, part])


def test_what_hangs_on_a_lost_part_and_what_is_jammed_or_dead_is_gone():
    found = parse_damages("loss:left_upper, jam:back_hip, dead:clearance", ANATOMY)
    assert list_gone_targets(BODY, found) == {
        *("body:left_upper", "body:left_lower", "joint:left_hip", "joint:left_knee"),
        *("actuator:left_hip_servo", "actuator:left_knee_servo"),
        *("sensor:left_hip_position", "sensor:left_knee_position"),
        *("sensor:left_upper_touch", "sensor:left_lower_touch"),
        *("joint:back_hip", "actuator:back_hip_servo", "sensor:clearance"),
    }


def test_plants_that_differ_in_what_they_read_move_alike():
    plant = build_rated_plant(BODY)
    said = ("dead:vertical", "lie:vertical", "weak:left_hip", "friction:0.2")
    plants = [plant, *(_damage(s, plant) for s in said)]
    moving, place = list_motions(plants)
    assert place == [0, 0, 0, 1, 2]
    assert [id(p) for p in moving] == [id(plants[k]) for k in (0, 3, 4)]


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
    plant = _damage("jam:left_hip:20")
    points = _points(plant, np.zeros((200, ANATOMY.size)))
    joint = ANATOMY.joints.index("left_hip")
    assert points[100:, joint] == pytest.approx(np.radians(20))
    assert np.all(np.delete(points, joint, axis=1) == 0)
