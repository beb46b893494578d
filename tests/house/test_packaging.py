"""The package list is the tree, and starting up loads nothing heavy."""

import subprocess
import sys
import tomllib
from importlib.resources import files

import pytest

import selfheal
from tests.support.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
HEAVY = {"dask", "distributed", "h5py", "jax", "matplotlib", "mujoco", "numba",
         "numpy", "rich", "scipy"}  # fmt: skip


def _tree() -> list[str]:
    mapped = {
        "selfheal": "selfheal",
        "cli": "selfheal.cli",
        "models": "selfheal.models",
    }
    return sorted(
        ".".join([name, *init.parent.relative_to(ROOT / folder).parts])
        for folder, name in mapped.items()
        for init in (ROOT / folder).rglob("__init__.py")
    )


def _list_loaded(code: str) -> set[str]:
    """The modules that are loaded once a fresh process has run this."""
    report = f"{code}; import sys; print(*sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", report], capture_output=True, text=True, check=True
    )
    return set(result.stdout.split())


def test_every_package_of_the_tree_is_installed():
    assert sorted(PROJECT["tool"]["setuptools"]["packages"]) == _tree()


def test_every_folder_with_code_is_a_package():
    bare = {
        path.parent
        for top in ("selfheal", "cli", "models")
        for path in (ROOT / top).rglob("*.py")
        if not (path.parent / "__init__.py").exists()
    }
    assert not bare


def test_the_version_is_one():
    assert PROJECT["project"]["version"] == selfheal.__version__
    assert f"## {selfheal.__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_data_files_are_found_where_they_are_installed():
    assert files("selfheal").joinpath("py.typed").is_file()
    assert files("selfheal.models").joinpath("__init__.py").is_file()


@pytest.mark.parametrize(
    "code",
    [
        "import selfheal",
        "import selfheal.cli",
        "from typer.testing import CliRunner; from selfheal.cli import app; "
        "assert CliRunner().invoke(app, ['--help']).exit_code == 0",
    ],
)
def test_starting_up_loads_nothing_heavy(code):
    assert not HEAVY & _list_loaded(code)


def test_a_diagnosis_loads_nothing_that_it_has_no_use_for():
    rooms = ("api", "telemetry", "diagnosis.diagnose", "report.diagnose")
    code = f"import {', '.join(f'selfheal.{room}' for room in rooms)}"
    loaded = {name.partition(".")[0] for name in _list_loaded(code)}
    assert "scipy" in loaded
    assert not loaded & {"dask", "distributed", "jax", "mcap", "numba", "pandas",
                         "pyarrow", "rerun", "rosbags"}  # fmt: skip


@pytest.mark.parametrize(
    "command",
    [
        "pip install -e . && selfheal identify --robot starfish",
        "pip install -e '.[test]' && pytest",
    ],
)
def test_the_readme_has_the_two_commands(command):
    assert command in (ROOT / "README.md").read_text()
