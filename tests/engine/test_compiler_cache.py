"""A read-only installation and home: compilers work without their caches."""

import os
import subprocess
import sys

import pytest

USE_BOTH = """
from numba.core import caching
caching.CacheImpl._locator_classes = []  # as where no folder can be written
from selfheal.engine import _settle
from selfheal.engine._jax import prepare_jax
print(prepare_jax().config.values["jax_compilation_cache_dir"])
prepare_jax()
"""


@pytest.mark.slow
def test_without_a_folder_to_write_nothing_is_kept_and_that_is_said_once():
    nowhere = os.devnull + "/home"  # no folder: root passes permissions
    own = {"HOME": nowhere, "XDG_CACHE_HOME": nowhere}
    how = dict(env=os.environ | own, text=True, capture_output=True)
    done = subprocess.run([sys.executable, "-c", USE_BOTH], check=False, **how)
    assert (done.returncode, done.stdout) == (0, "None\n"), done.stderr
    said = done.stderr.splitlines()
    assert len(said) == 2
    for line, compiler, variable in (
        (said[0], "numba", "NUMBA_CACHE_DIR"),
        (said[1], "JAX", "JAX_COMPILATION_CACHE_DIR"),
    ):
        assert line.startswith(f"selfheal: {compiler} cannot write")
        assert f"{variable}=FOLDER" in line
