"""Programs of the MJX engine in fresh processes; its laws are in test_engines.py."""

import os
import subprocess
import sys

import pytest

from tests.support.paths import ROOT


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
