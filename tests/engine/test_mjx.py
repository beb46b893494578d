"""The MJX engine: one compiled program for all trees, rows that ignore each other."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from selfheal.engine.mjx import Mjx, _compile_program
from selfheal.engine.statics import Statics
from tests.support.paths import ROOT
from tests.support.star_robot import ACTIONS, draw_trees, make_stars

ENGINE = Mjx(batch=40)


def _same(one, other) -> None:
    """Bit for bit the same readings."""
    np.testing.assert_array_equal(one.tilt, other.tilt)
    np.testing.assert_array_equal(one.clearance, other.clearance)
    np.testing.assert_array_equal(one.touch, other.touch)


def test_the_star_and_most_random_trees_rest_as_in_statics():
    dynamic = ENGINE.simulate(make_stars(36), ACTIONS)
    static = Statics(10).simulate(make_stars(36), ACTIONS)
    assert not dynamic.failed.any()
    assert np.degrees(np.abs(dynamic.tilt - static.tilt)).max() < 0.5
    assert np.abs(dynamic.clearance - static.clearance).max() < 0.002
    assert (dynamic.touch == static.touch).mean() > 0.95
    targets = ACTIONS[np.random.default_rng(1).integers(36, size=40)]
    gap = ENGINE.simulate(draw_trees(40), targets).tilt
    gap = gap - Statics(10).simulate(draw_trees(40), targets).tilt
    assert (np.degrees(np.abs(gap)).max(axis=1) < 2).mean() > 0.85


def test_one_program_serves_every_tree():
    ENGINE.simulate(make_stars(3), ACTIONS[:3])
    ENGINE.simulate(draw_trees(45), ACTIONS[np.arange(45) % 36])
    assert _compile_program.cache_info().currsize == 1


def test_rows_do_not_depend_on_how_many_there_are():
    bodies, targets = draw_trees(5), ACTIONS[:5]
    together = ENGINE.simulate(bodies, targets)
    for i in range(5):
        _same(ENGINE.simulate(bodies[[i]], targets[[i]]), together[[i]])
    nobody = ENGINE.simulate(bodies[:0], targets[:0])
    assert nobody.tilt.shape == (0, 2) and nobody.angles.shape == (0, 8)


@pytest.mark.parametrize(
    "field, value", [("length", np.nan), ("mass", 1e300), ("mass", -0.1)]
)
def test_a_failed_candidate_spoils_nobody_else(field, value):
    bodies, targets = draw_trees(4), ACTIONS[:4]
    broken = getattr(bodies, field).copy()
    broken[1, 2] = value
    mixed = ENGINE.simulate(replace(bodies, **{field: broken}), targets)
    assert mixed.failed.tolist() == [False, True, False, False]
    assert np.isnan(mixed.tilt[1]).all()
    others = np.array([0, 2, 3])
    _same(mixed[others], ENGINE.simulate(bodies, targets)[others])


@pytest.mark.slow
def test_a_large_batch_ends_from_a_fresh_process(tmp_path):
    """On two cores it waited forever for an XLA pool of two threads (engines.md)."""
    code = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from selfheal.engine.mjx import Mjx
from tests.support.star_robot import ACTIONS, make_stars
rest = Mjx(0.1, 0.1, batch=256).simulate(make_stars(36), ACTIONS)
print(int(rest.failed.sum()))
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,  # [s]; it takes 10 to 20
    )
    assert done.stdout == "0\n", done.stderr
    assert not list(tmp_path.iterdir()), "something was written where it ran"


@pytest.mark.slow
def test_a_program_is_traced_once_and_again_where_its_file_is_damaged(tmp_path):
    code = f"""
import sys
sys.path.insert(0, {str(ROOT)!r})
from selfheal.engine.mjx import Mjx
from tests.support.star_robot import ACTIONS, ANATOMY, make_stars
engine = Mjx(0.1, 0.1, batch=4)
print(engine.prepare(ANATOMY))
print(engine.simulate(make_stars(4), ACTIONS[:4]).tilt.tobytes().hex())
print("mujoco.mjx" in sys.modules)
"""

    own = {"XDG_CACHE_HOME": str(tmp_path)}

    def run() -> list[str]:
        how = dict(capture_output=True, text=True, timeout=120)
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, env=os.environ | own, check=True, **how)
        return done.stdout.splitlines()

    kept, tilt, traced = run()
    assert (kept, traced) == ("False", "True")
    assert run() == ["True", tilt, "False"]
    (file,) = tmp_path.glob("selfheal/jax/traced-*.bin")
    for damaged in (b"", file.read_bytes()[:-1000], b"x" * 1000):
        file.write_bytes(damaged)
        assert run() == ["False", tilt, "True"]
    assert run() == ["True", tilt, "False"]
