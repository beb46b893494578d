"""Three engines, one law: the same bodies under the same actions read the same."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.body import Bodies
from selfheal.engine import ENGINES, make_engine
from selfheal.engine.arrays import pack_bodies, plan_race
from selfheal.engine.channels import MAX_CLEARANCE, list_channels
from selfheal.engine.mjx import Mjx, _compile_program
from selfheal.engine.mujoco import MuJoCo
from selfheal.engine.readings import Readings, compute_readings
from selfheal.engine.statics import Statics
from selfheal.errors import UnknownNameError
from tests.support.star_robot import ACTIONS, ANATOMY, STAR, draw_trees, make_stars

STATICS, MJX, MUJOCO = Statics(10), Mjx(batch=40), MuJoCo()
LOSS = list_channels(ANATOMY).loss
TREES = 40

fast = pytest.mark.parametrize("engine", [STATICS, MJX], ids=lambda e: e.name)
every = pytest.mark.parametrize("engine", [STATICS, MJX, MUJOCO], ids=lambda e: e.name)


def _trees() -> tuple[Bodies, np.ndarray]:
    """Random trees of the starfish's parts, and a target for each."""
    return draw_trees(TREES), ACTIONS[np.random.default_rng(1).integers(36, size=TREES)]


@functools.cache
def _reference(what: str) -> Readings:
    """Native MuJoCo's readings of the star under all actions, or of the trees."""
    return MUJOCO.simulate(*(_star() if what == "star" else _trees()))


def _star() -> tuple[Bodies, np.ndarray]:
    return make_stars(36), ACTIONS


def _gap(one: Readings, other: Readings) -> np.ndarray:
    """(N) the larger difference of the two tilts [deg]."""
    return np.degrees(np.abs(one.tilt - other.tilt)).max(axis=1)


def _same(one: Readings, other: Readings) -> None:
    for name in ("tilt", "clearance", "touch", "angles", "failed"):
        np.testing.assert_array_equal(
            getattr(one, name), getattr(other, name), err_msg=name
        )


@fast
def test_the_star_rests_as_in_mujoco_under_every_action(engine):
    seen, reference = engine.simulate(*_star()), _reference("star")
    assert _gap(seen, reference).max() < 0.5
    assert np.abs(seen.clearance - reference.clearance).max() < 0.003
    assert (seen.touch == reference.touch).mean() > 0.9


@fast
def test_random_trees_rest_as_in_mujoco(engine):
    """A loose bound: benchmarks/accuracy.py has the figure."""
    gap = _gap(engine.simulate(*_trees()), _reference("trees"))
    assert (gap < 2).mean() >= 0.85


@every
def test_readings_have_the_shapes_and_ranges_that_they_say(engine):
    bodies, targets = _trees()
    seen = engine.simulate(bodies[:6], targets[:6])
    shapes = [x.shape for x in (seen.tilt, seen.clearance, seen.touch, seen.angles)]
    assert shapes == [(6, 2), (6,), (6, 4), (6, 8)]
    assert not seen.failed.any()
    assert (np.abs(seen.tilt) <= np.pi / 2).all()
    assert ((seen.clearance >= 0) & (seen.clearance <= MAX_CLEARANCE)).all()
    assert set(np.unique(seen.touch)) <= {0, 1}
    np.testing.assert_allclose(seen.angles, targets[:6], atol=np.radians(1))


@every
def test_the_same_input_gives_the_same_output(engine):
    bodies, targets = _trees()
    once = engine.simulate(bodies[:6], targets[:6])
    _same(engine.simulate(bodies[:6], targets[:6]), once)


@every
def test_a_row_does_not_depend_on_its_neighbors(engine):
    bodies, targets = _trees()
    rows = np.array([4, 1, 5])
    together = engine.simulate(bodies[:6], targets[:6])
    _same(engine.simulate(bodies[rows], targets[rows]), together[rows])


def test_one_program_serves_every_tree_and_any_number_of_them():
    MJX.simulate(make_stars(3), ACTIONS[:3])
    MJX.simulate(draw_trees(45), ACTIONS[np.arange(45) % 36])
    nobody = MJX.simulate(draw_trees(1)[:0], ACTIONS[:0])
    assert nobody.tilt.shape == (0, 2) and nobody.angles.shape == (0, 8)
    assert _compile_program.cache_info().currsize == 1


def test_statics_on_threads_gives_what_it_gives_on_one():
    bodies, targets = _trees()
    many = np.tile(np.arange(TREES), 10)
    threads = Statics(10, threads=3).simulate(bodies[many], targets[many])
    _same(threads, Statics(10, threads=1).simulate(bodies[many], targets[many]))


@pytest.mark.parametrize(
    "engine, field, value",
    [
        *((e, f, np.nan) for e in every.args[1] for f in ("length", "mass", "heading")),
        (MJX, "mass", 1e300),
        (MJX, "mass", -0.1),
    ],
)
def test_a_body_without_sense_fails_and_spoils_nobody_else(
    engine, field, value, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    bodies, targets = _trees()
    column = getattr(bodies, field).copy()
    column[1, 2] = value
    mixed = engine.simulate(replace(bodies, **{field: column})[:4], targets[:4])
    assert mixed.failed.tolist() == [False, True, False, False]
    assert np.isnan(mixed.channels[1]).all()
    others = np.array([0, 2, 3])
    _same(mixed[others], engine.simulate(bodies[others], targets[others]))
    assert not list(tmp_path.iterdir()), "e.g. a MUJOCO_LOG.TXT"


def test_a_diverging_simulation_fails_without_a_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bodies, targets = _trees()
    light = replace(bodies, mass=bodies.mass * np.where(np.arange(8) == 7, 1e12, 1.0))
    seen = MuJoCo().simulate(light[:2], targets[:2])
    assert seen.failed.shape == (2,)
    np.testing.assert_array_equal(np.isnan(seen.tilt).all(axis=1), seen.failed)
    assert not list(tmp_path.iterdir())


def _race(bound: float, order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every tree against what the star felt: losses (N, 7) raced, and in full."""
    bodies, _ = _trees()
    targets, felt = ACTIONS[:7], _reference("star").channels[:7]
    race = plan_race(TREES, order, bound)
    each = STATICS.race(bodies, (targets, felt), LOSS, race)
    row = np.repeat(np.arange(TREES), 7)
    rest = STATICS.simulate(bodies[row], np.tile(targets, (TREES, 1)))
    full = LOSS(rest.channels, np.tile(felt, (TREES, 1))).reshape(TREES, 7)
    return (np.take_along_axis(x, race.order, axis=1) for x in (each, full))


def test_a_race_without_a_bound_is_the_sum_of_simulations():
    each, full = _race(np.inf, np.arange(7))
    np.testing.assert_allclose(each, full, atol=1e-9)


def test_every_body_races_in_its_own_order_until_its_bound_is_reached():
    order = np.random.default_rng(0).permuted(np.tile(np.arange(7), (TREES, 1)), axis=1)
    limit = 25.0
    each, full = _race(limit, order)
    before = np.cumsum(full, axis=1) - full
    np.testing.assert_array_equal(np.isnan(each), before >= limit)
    np.testing.assert_allclose(each[before < limit], full[before < limit], atol=1e-9)
    assert np.isnan(each).any() and not np.isnan(each).all(axis=1).any()


def _race_trees_against_mujoco(other_rest: float) -> np.ndarray:
    """(N, N) losses of each tree under each one's action, against that one's rest."""
    bodies, targets = _trees()
    race = plan_race(TREES, np.arange(TREES), np.inf, other_rest)
    return STATICS.race(bodies, (targets, _reference("trees").channels), LOSS, race)


def test_a_body_rests_where_mujoco_says_if_it_is_put_down_so():
    falls, put = (_race_trees_against_mujoco(cost) for cost in (np.inf, 1.0))
    other = np.diag(falls) > 10
    assert 0 < other.sum() < 0.2 * TREES, "statics and mujoco differ in a few rests"
    assert (np.diag(put)[other] < 1.0 + 2.0).all()
    assert (put >= np.minimum(falls, 1.0)).all() and (put <= falls).all()


def test_a_race_counts_a_body_without_sense_as_infinitely_bad():
    bodies, _ = _trees()
    length = bodies.length.copy()
    length[1] = np.nan
    bodies = replace(bodies, length=length)[:3]
    race = plan_race(3, np.arange(3), np.inf)
    each = STATICS.race(bodies, (ACTIONS[:3], np.zeros((3, 3))), LOSS, race)
    assert each[1, 0] == np.inf and np.isnan(each[1, 1:]).all()
    assert np.isfinite(each[[0, 2]]).all()


def test_readings_far_beyond_the_sensors_are_within_their_range():
    up = np.array([[0, 0, 1.0], [0, 0, -1], [0, 1, 0], [np.nan, 0, 1]])
    bodies = make_stars(4)
    height, tips, angles = np.ones(4), np.zeros((4, 1)), np.zeros((4, 8))
    seen = compute_readings(bodies, pack_bodies(bodies), up, height, tips, angles)
    assert seen.failed.tolist() == [False, False, False, True]
    np.testing.assert_array_equal(seen.clearance[:3], MAX_CLEARANCE)
    np.testing.assert_allclose(seen.tilt[:3], [[0, 0], [0, 0], [-np.pi / 2, 0]])


@every
def test_the_flat_star_lies_level_on_its_belly(engine):
    seen = engine.simulate(STAR, np.zeros((1, 8)))
    np.testing.assert_allclose(seen.tilt, 0, atol=1e-3)
    np.testing.assert_allclose(seen.clearance, 0, atol=1e-3)
    np.testing.assert_array_equal(seen.touch, 0)


def test_engines_are_made_by_name():
    for name in ENGINES.keys() - {"auto"}:
        assert make_engine(name).name == name
    with pytest.raises(UnknownNameError, match=r"'bullet'; valid: auto, mjx, mujoco"):
        make_engine("bullet")
