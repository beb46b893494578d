"""The MJX engine: one compiled program for all trees, rows that ignore each other."""

import itertools
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from selfheal.body.body import Anatomy
from selfheal.body.genome import build_bodies, draw_genomes, encode_tree
from selfheal.engine._mjx_body import list_sphere_owners
from selfheal.engine.mjx import Mjx, _compile_program
from selfheal.engine.statics import Statics

STAR_PARENTS = np.array([0, 0, 0, 0, 1, 2, 3, 4])


def _star_anatomy() -> Anatomy:
    """The four-legged robot of papers.md 1.1: upper legs, lower legs with housings."""
    names = [f"{k}_{s}" for k in ("upper", "lower") for s in "lfrb"]
    return Anatomy(
        name="star",
        parts=tuple(names),
        joints=tuple(names),
        torso_half=np.array([0.041, 0.041, 0.0425]),
        torso_mass=0.5,
        rim=np.array([0.07, 0.07, 0.0]),
        length=np.array([0.095] * 4 + [0.125] * 4),
        radius=np.full(8, 0.007),
        mass=np.array([0.143] * 4 + [0.118] * 4),
        block_half=np.array([[0.0, 0, 0]] * 4 + [[0.0185, 0.015, 0.02]] * 4),
        block_center=np.array([0.0] * 4 + [0.0185] * 4),
        block_mass=np.array([0.0] * 4 + [0.023] * 4),
        feet=(5, 6, 7, 8),
    )


def _star(count: int):
    """`count` times the four-legged robot."""
    placement = np.array([0.125, 0.375, 0.625, 0.875] + [0.375] * 4)
    star = build_bodies(ANATOMY, encode_tree(ANATOMY, STAR_PARENTS, placement))
    return star[np.zeros(count, int)]


def _actions() -> np.ndarray:
    """(36, 8) one or two joints at -30 degrees, all others at 30 (papers.md 1.2)."""
    joints = range(8)
    lowered = [*((i,) for i in joints), *itertools.combinations(joints, 2)]
    targets = np.full((len(lowered), 8), np.radians(30))
    for row, chosen in enumerate(lowered):
        targets[row, list(chosen)] *= -1
    return targets


def _trees(count: int):
    """Random attachment trees."""
    genomes = draw_genomes(ANATOMY, count, np.random.default_rng(0), False)
    return build_bodies(ANATOMY, genomes)


ANATOMY = _star_anatomy()
ENGINE = Mjx(batch=40)


def _same(one, other) -> None:
    """Bit for bit the same readings."""
    np.testing.assert_array_equal(one.tilt, other.tilt)
    np.testing.assert_array_equal(one.clearance, other.clearance)
    np.testing.assert_array_equal(one.touch, other.touch)


def test_the_star_rests_as_in_statics():
    actions = _actions()
    dynamic = ENGINE.simulate(_star(36), actions)
    static = Statics(10).simulate(_star(36), actions)
    assert not dynamic.failed.any()
    assert np.degrees(np.abs(dynamic.tilt - static.tilt)).max() < 0.5
    assert np.abs(dynamic.clearance - static.clearance).max() < 0.002
    assert (dynamic.touch == static.touch).mean() > 0.95


def test_most_random_trees_rest_as_in_statics():
    targets = _actions()[np.random.default_rng(1).integers(36, size=40)]
    gap = ENGINE.simulate(_trees(40), targets).tilt
    gap = gap - Statics(10).simulate(_trees(40), targets).tilt
    assert (np.degrees(np.abs(gap)).max(axis=1) < 2).mean() > 0.85


def test_one_program_serves_every_tree():
    ENGINE.simulate(_star(3), _actions()[:3])
    ENGINE.simulate(_trees(45), _actions()[np.arange(45) % 36])
    shape = list_sphere_owners(ANATOMY), ANATOMY.feet
    program = _compile_program(*shape, ENGINE.ramp, ENGINE.hold, ENGINE.batch)
    assert program._cache_size() == 1


def test_rows_do_not_depend_on_how_many_there_are():
    bodies, targets = _trees(5), _actions()[:5]
    together = ENGINE.simulate(bodies, targets)
    for i in range(5):
        _same(ENGINE.simulate(bodies[[i]], targets[[i]]), together[[i]])
    nobody = ENGINE.simulate(bodies[:0], targets[:0])
    assert nobody.tilt.shape == (0, 2) and nobody.angles.shape == (0, 8)


@pytest.mark.parametrize(
    "field, value", [("length", np.nan), ("mass", 1e300), ("mass", -0.1)]
)
def test_a_failed_candidate_spoils_nobody_else(field, value):
    bodies, targets = _trees(4), _actions()[:4]
    broken = getattr(bodies, field).copy()
    broken[1, 2] = value
    mixed = ENGINE.simulate(replace(bodies, **{field: broken}), targets)
    assert mixed.failed.tolist() == [False, True, False, False]
    assert np.isnan(mixed.tilt[1]).all()
    others = np.array([0, 2, 3])
    _same(mixed[others], ENGINE.simulate(bodies, targets)[others])


def test_a_large_batch_ends_from_a_fresh_process(tmp_path):
    """On two cores it waited forever for an XLA pool of two threads (engines.md)."""
    code = f"""
import sys
sys.path.insert(0, {os.path.dirname(__file__)!r})
import test_mjx
star = test_mjx._star(36)
rest = test_mjx.Mjx(0.1, 0.1, batch=256).simulate(star, test_mjx._actions())
print(int(rest.failed.sum()))
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,  # [s]; it takes 10 to 20
    )
    assert done.stdout == "0\n", done.stderr
    assert not list(tmp_path.iterdir()), "something was written where it ran"
