"""Damaged plants: only what a damage says is changed, and what it implies is known."""

from dataclasses import fields

import numpy as np
import pytest

from selfheal.damage.apply import (
    apply_damages,
    build_damaged_plants,
    list_gone_targets,
    reduce_damages,
)
from selfheal.damage.kinds import KINDS, Damage
from selfheal.damage.words import list_names, parse_damages
from selfheal.engine.plant import build_rated_plant, list_motions
from selfheal.engine.reflex import build_intact_plants
from selfheal.robot.actions import load_published_body
from tests.support.short_recover import JAM, LOST, LOWER, QUADRUPED

BODY = load_published_body()
ANATOMY = BODY.anatomy


def test_a_leg_is_lost_with_all_that_hangs_on_it():
    after = apply_damages(
        build_rated_plant(BODY), *parse_damages("loss:right_upper", ANATOMY)
    ).body
    changed = np.flatnonzero(after.length[0] != BODY.length[0])
    assert [ANATOMY.parts[i] for i in changed] == ["right_upper", "right_lower"]


def test_a_damage_changes_only_what_it_says():
    plant = build_rated_plant(BODY)
    weak = apply_damages(plant, *parse_damages("weak:back_knee:0.4", ANATOMY))
    joint = ANATOMY.joints.index("back_knee")
    ratio = weak.torque / plant.torque
    assert ratio[joint] == pytest.approx(0.4)
    assert np.all(np.delete(ratio, joint) == 1)
    assert weak.body is plant.body
    dead = apply_damages(plant, *parse_damages("dead:vertical", ANATOMY))
    assert dead.gain == {"vertical": 0.0}
    assert {*list_names(ANATOMY)["sensor"]} >= {"vertical", "left_hip_position"}


@pytest.mark.parametrize("name", KINDS)
def test_what_a_search_looks_for_changes_the_plants_that_it_simulates(name):
    kind, whole = KINDS[name], build_rated_plant(BODY)
    names = list_names(ANATOMY).get(kind.sort, ())
    for damage in kind.list_damages(names, kind.heal_values.grid[:1]):
        broken = apply_damages(whole, damage)
        assert any(
            getattr(broken, f.name) is not getattr(whole, f.name) for f in fields(whole)
        )
    intact = build_intact_plants(QUADRUPED, 1)
    grid = kind.recover_values.grid[:1]
    for damage in kind.list_damages(QUADRUPED.targets[kind.sort], grid):
        legged = build_damaged_plants(QUADRUPED, [(damage,)])
        assert any(
            (getattr(legged, f.name) != getattr(intact, f.name)).any()
            for f in fields(intact)[1:]
        )


def test_damages_of_one_part_add_up_and_never_shrink_it_beyond_a_lost_one():
    plant = build_rated_plant(BODY)
    short = parse_damages("right_lower:0.5, lie:clearance:0.5", ANATOMY)
    twice = apply_damages(plant, *short, *short)
    part = ANATOMY.parts.index("right_lower")
    assert twice.body.thickness[0, part] == pytest.approx(0.25)
    assert twice.gain["clearance"] == pytest.approx(0.25)
    lost = apply_damages(plant, *parse_damages("loss:right_lower", ANATOMY)).body
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
    plants = [plant, *(apply_damages(plant, *parse_damages(s, ANATOMY)) for s in said)]
    moving, place = list_motions(plants)
    assert place == [0, 0, 0, 1, 2]
    assert [id(p) for p in moving] == [id(plants[k]) for k in (0, 3, 4)]


def test_what_a_loss_says_is_not_said_twice():
    knee = Damage("joint_jam", "joint:left_front_knee")
    angle = Damage("sensor_dead", "sensor:left_front_hip_position")
    said = reduce_damages(QUADRUPED, [LOWER, knee, LOST, JAM, angle, JAM])
    assert said == (JAM, LOST)
    one, two = build_damaged_plants(QUADRUPED, [said, (LOST, JAM, angle)])[[0]], None
    two = build_damaged_plants(QUADRUPED, [(LOST, LOWER, JAM, angle)])
    for f in fields(one)[1:3]:
        np.testing.assert_array_equal(getattr(one, f.name), getattr(two, f.name))
