"""A damage and the effect of its name are one change of a model, in two rooms."""

import numpy as np
import pytest

from selfheal.body.legged import load_legged_robot
from selfheal.damage.apply import build_damaged_plants
from selfheal.damage.kinds import KINDS, Damage
from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.effects.places import BodyPlace, GeomsPlace, Place
from selfheal.engine.reflex import _build_batch

ROBOT = load_legged_robot("quadruped")
PART = "left_front_upper"
SHARED = sorted(set(KINDS) & set(load_catalogue()))


def _damage(kind, target="world", value=0.0, azimuth=0.0):
    """Fields of the model by which the plant of a damage is simulated."""
    damage = Damage(kind, target, value, azimuth)
    return _build_batch(build_damaged_plants(ROBOT, [[damage]]))


def _effect(name, place, values):
    """The model as the effect changes it, of values that the damage has."""
    model = ROBOT.model.__copy__()
    load_catalogue()[name].edit_model(model, place, np.asarray(values, float))
    return model


def test_the_rooms_share_the_names_of_changes():
    assert SHARED == ["ground_friction", "joint_jam", "limb_loss", "slope", "wind"]


@pytest.mark.parametrize("kind", SHARED)
def test_a_change_has_one_kind_of_target(kind):
    assert KINDS[kind].sort in load_catalogue()[kind].target_kinds


@pytest.mark.parametrize("kind", SHARED)
def test_a_change_has_one_unit(kind):
    units = {spec.unit for spec in load_catalogue()[kind].parameters}
    assert not units or any(f"[{unit}]" in KINDS[kind].meaning for unit in units)


@pytest.mark.parametrize(("tilt", "azimuth"), [(0.1, 0.0), (0.3, 2.0), (0.0, 1.0)])
def test_a_slope_turns_gravity_alike(tilt, azimuth):
    batch = _damage("slope", value=tilt, azimuth=azimuth)
    model = _effect("slope", Place(), (tilt, azimuth))
    np.testing.assert_allclose(
        batch.expand("opt.gravity")[0], model.opt.gravity, atol=1e-15
    )


def test_a_wind_blows_alike():
    batch = _damage("wind", value=5.0, azimuth=0.7)
    model = _effect("wind", Place(), (5 * np.cos(0.7), 5 * np.sin(0.7), 0.0))
    np.testing.assert_array_equal(batch.expand("opt.wind")[0], model.opt.wind)


def test_a_lost_limb_has_the_same_mass_left_and_touches_nothing():
    batch = _damage("limb_loss", f"body:{PART}")
    place = BodyPlace(body=ROBOT.model.body(PART).id)
    model = _effect("limb_loss", place, ())
    np.testing.assert_array_equal(batch.expand("body_mass")[0], model.body_mass)
    np.testing.assert_array_equal(batch.expand("body_inertia")[0], model.body_inertia)
    np.testing.assert_array_equal(batch.expand("geom_contype")[0], model.geom_contype)


def test_the_ground_is_as_slippery():
    batch = _damage("ground_friction", value=0.2)
    floor = np.flatnonzero(ROBOT.model.geom_bodyid == 0)
    model = _effect("ground_friction", GeomsPlace(geoms=tuple(map(int, floor))), (0.2,))
    for friction in (batch.expand("geom_friction")[0], model.geom_friction):
        # a contact has the larger friction of its two geoms
        assert max(friction[floor, 0].max(), friction[:, 0].max()) == pytest.approx(0.2)
