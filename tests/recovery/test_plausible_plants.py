"""Robots that walk as the whole one did: nearer to it than the one believed in."""

import numpy as np
import pytest

from selfheal.damage.apply import apply_damages
from selfheal.damage.kinds import Damage
from selfheal.engine.plant import build_rated_plant
from selfheal.engine.walk import compute_channels, list_channels, simulate_walks
from selfheal.gait.synthesis import Gait, randomize_plant
from selfheal.recovery.plausible_plants import (
    compute_effective_share,
    find_plausible_plants,
    predict_walk,
)
from selfheal.recovery.probes import find_residual_scale, list_probes, predict_values
from selfheal.robot.actions import load_published_body

PLANT = build_rated_plant(load_published_body())
GAIT = Gait("waves", np.linspace(-1, 1, 25), 0.0, 0.0, 0.0, 0.0, 0, 0)
WALK = list_probes(GAIT, PLANT.body.anatomy.joints)[-1]
SCALE = find_residual_scale(WALK, list_channels(PLANT.body.anatomy).names)


def _felt(plant):
    return compute_channels(simulate_walks([plant], WALK.commands[None]), [plant])[0]


@pytest.fixture(scope="module")
def other():
    """A robot that is not the one believed in, and the likely ones after its walk."""
    hidden = randomize_plant(PLANT, np.random.default_rng(3))
    return hidden, find_plausible_plants(
        PLANT, WALK, _felt(hidden), np.random.default_rng(4)
    )


def _misfit(plant, hidden):
    shown = predict_values([plant, hidden], WALK, np.zeros(len(SCALE)))
    return np.abs(np.diff(shown, axis=0) / SCALE).mean()


def test_likely_robots_walk_more_as_the_whole_one_did(other):
    hidden, known = other
    believed = _misfit(PLANT, hidden)
    assert all(_misfit(plant, hidden) < believed for plant in known.plants)


def test_where_nothing_broke_every_likely_robot_predicts_the_walk_of_the_whole_one(
    other,
):
    hidden, known = other
    shown = predict_walk(known, [Damage("none")], WALK)[0]
    felt = predict_values([hidden], WALK, np.zeros(len(SCALE)))
    assert shown == pytest.approx(np.repeat(felt, len(shown), axis=0))


def test_the_plant_that_walked_is_the_most_plausible():
    known = find_plausible_plants(PLANT, WALK, _felt(PLANT), np.random.default_rng(5))
    assert known.plants[0] is PLANT
    assert known.bias[0] == pytest.approx(0, abs=1e-9)


def test_a_damage_changes_the_walk_of_every_plausible_plant(other):
    _, known = other
    lost = Damage("limb_loss", "body:left_upper")
    whole, broken = predict_walk(known, [Damage("none"), lost], WALK)
    assert (np.abs(whole - broken) / SCALE).max(axis=1).min() > 3
    assert broken[0] - known.bias[0] == pytest.approx(
        predict_values(
            [apply_damages(known.plants[0], lost)], WALK, np.zeros(len(SCALE))
        )[0]
    )


def test_values_that_change_together_are_worth_one_and_others_themselves():
    rng = np.random.default_rng(6)
    same = np.repeat(rng.normal(size=(4000, 1)), 8, axis=1)
    assert compute_effective_share(same) == pytest.approx(1 / 8)
    assert compute_effective_share(rng.normal(size=(4000, 8))) == pytest.approx(
        1, abs=0.05
    )
    assert compute_effective_share(np.column_stack([same, 0 * same])) == pytest.approx(
        1 / 8
    )
