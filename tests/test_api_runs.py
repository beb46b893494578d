"""From Python: `selfheal.identify`, `heal` and `recover` do what the commands do."""

import json
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from typer.testing import CliRunner

import selfheal
from selfheal.cli import app
from selfheal.errors import InputError, UnknownNameError
from selfheal.robot.open_robot import open_robot
from selfheal.selfmodel.read_run import load_run
from tests.support import short_heal, short_recover

SMALL = {"engine": "statics", "cycles": 1, "budget": 300, "seed": 5}


@pytest.fixture
def short(monkeypatch):
    """Searches of a second."""
    short_heal.shorten(monkeypatch.setattr)
    short_recover.shorten(monkeypatch.setattr)


def _result(run):
    """What a run found, without what hangs on where and when it ran."""
    return {k: v for k, v in run.items() if k not in ("seconds", "run", "model")}


@pytest.mark.slow
def test_identify_is_what_the_command_runs(tmp_path):
    words = [w for k, v in SMALL.items() for w in (f"--{k}", str(v))]
    command = ["identify", "--robot", "starfish", *words, "--out", str(tmp_path)]
    made = CliRunner().invoke(app, [*command, "--json"])
    assert made.exit_code == 0, made.output
    counts, steps = [], []
    robot = open_robot("starfish", seed=SMALL["seed"])
    run = selfheal.identify(
        robot, **SMALL, progress=counts.append, on_step=steps.append
    )
    assert _result(json.loads(made.stdout)) == _result(run.result)
    assert [len(step.cycles) for step in steps] == [0, 1, 1]
    assert counts == sorted(counts) and counts[-1] > 0
    assert {p.name for p in tmp_path.iterdir()} == {"run.h5", "best.xml", "report.html"}
    again = selfheal.identify(resume=tmp_path / "run.h5")
    assert again.result == load_run(tmp_path / "run.h5").result
    assert _result(again.result) == _result(run.result)


@pytest.mark.slow
def test_heal_takes_a_run_and_a_damage(short, tmp_path, monkeypatch):
    path, run = short_heal.identified(tmp_path)
    damage = "dead:left_hip_position"
    phases = []
    monkeypatch.chdir(tmp_path)
    done = selfheal.heal(
        path.name, damage, out=lambda name: tmp_path, on_step=phases.append
    )
    assert done.result["hypotheses"][0]["target"] == "sensor:left_hip_position"
    monkeypatch.chdir("/")
    for given in (run, path, None):  # the heal's own file says where the run is
        again = selfheal.heal(given, resume=tmp_path / "heal.h5")
        assert again.result == done.result
    assert (tmp_path / "report.html").is_file()
    assert not phases[0].phases and phases[-1] is done


def test_recover_takes_a_scenario(short, tmp_path):
    options = {"method": "as-described", "generations": 2, "trials": 1, "seed": 2}
    run = selfheal.recover("quadruped", 1, out=tmp_path, **options)
    again = selfheal.recover(resume=tmp_path / "recover.h5")
    assert run.settings.generations == 2 and len(run.result["trials"]) == 1
    assert again.result == run.result
    np.testing.assert_array_equal(
        again.phases["explore-1"]["weights"], run.phases["explore-1"]["weights"]
    )


@pytest.mark.parametrize(
    ("call", "error", "said"),
    [
        (selfheal.identify, InputError, "either a robot or a run"),
        (lambda: selfheal.identify("nobody"), UnknownNameError, "nobody"),
        (lambda: selfheal.identify("starfish", cycles=0), InputError, "cycles"),
        (selfheal.heal, InputError, "a run and a damage"),
        (lambda: selfheal.heal("x", "y", heading=7.0), InputError, "2 pi"),
        (lambda: selfheal.recover("quadruped"), InputError, "a scenario"),
        (lambda: selfheal.recover("tripod", 1), UnknownNameError, "hexapod"),
        (lambda: selfheal.recover("quadruped", 1, gap=2.0), InputError, "gap"),
        *(
            (partial(call, "x", "y", sed=1), UnknownNameError, "'sed'; valid: .*seed")
            for call in (selfheal.diagnose, selfheal.heal, selfheal.recover)
        ),
    ],
)
def test_what_makes_no_sense_is_refused(call, error, said):
    with pytest.raises(error, match=said):
        call()


def test_the_api_loads_no_physics_before_it_is_called():
    heavy = "{'mujoco', 'jax', 'numba', 'scipy', 'matplotlib', 'rich'}"
    code = f"import sys, selfheal; selfheal.recover; print({heavy} & set(sys.modules))"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, check=False, text=True)
    assert done.stdout.strip() == "set()", done.stderr
