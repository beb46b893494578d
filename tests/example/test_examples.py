"""The files of an example fit together, and what it conceals is found."""

import json
import re
import shlex

import numpy as np
import pytest

from selfheal import diagnose
from selfheal.example import EXAMPLES
from selfheal.recording import read
from tests.support.commands.run import refuse, run_well
from tests.support.paths import ROOT


@pytest.fixture(scope="module", params=EXAMPLES)
def made(request, tmp_path_factory):
    """What the command says of the files that it wrote."""
    folder = tmp_path_factory.mktemp(request.param)
    return json.loads(run_well("example", request.param, "--out", folder, "--json"))


def _compare(imported, given):
    for found, true in zip(
        imported.episodes.values(), given.episodes.values(), strict=True
    ):
        assert found.time == pytest.approx(true.time, abs=1e-6)
        assert found.ctrl_names == true.ctrl_names
        assert found.ctrl == pytest.approx(true.ctrl, abs=1e-4)
        assert found.signals.keys() == true.signals.keys()
        for name, signal in found.signals.items():
            assert signal.values == pytest.approx(true.signals[name].values, abs=1e-4)


def test_without_a_folder_there_is_one_below_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for folder in ("runs/example-pendulum", "runs/example-pendulum.2"):
        assert run_well("example", "pendulum").startswith(f"{folder}/model.xml")


def test_the_recording_is_what_its_map_makes_of_the_log(made, tmp_path):
    words = ("recording", "import", made["log"], "--model", made["model"])
    run_well(*words, "--map", made["map"], "--out", tmp_path / "rec.h5")
    _compare(read(tmp_path / "rec.h5"), read(made["recording"]))


def test_a_guess_makes_the_same_recording(made, tmp_path):
    words = ("recording", "import", made["log"], "--model", made["model"])
    run_well(*words, "--guess", "--out", tmp_path / "map.toml")
    run_well(*words, "--map", tmp_path / "map.toml", "--out", tmp_path / "rec.h5")
    found, given = read(tmp_path / "rec.h5"), read(made["recording"])
    assert len(found.episodes) == len(given.episodes)
    last = [list(r.episodes.values())[-1] for r in (found, given)]
    assert last[0].ctrl == pytest.approx(last[1].ctrl, abs=1e-4)
    for name, signal in last[1].signals.items():
        if np.isfinite(signal.values).all():
            values = last[0].signals[name].values
            assert values == pytest.approx(signal.values, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_the_commands_of_the_page_of_four_logs_work(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "four-logs.md").read_text()
    (section,) = (s for s in page.split("\n## ") if f"example {name} " in s)
    lines = re.findall(r"^    selfheal (.*)$", section, re.M)
    done = [run_well(*shlex.split(line)) for line in lines if "diagnose" not in line]
    assert len(done) == 4 and "no fault of the log" in done[-1]


@pytest.mark.slow
def test_what_the_pendulum_conceals_is_found(tmp_path):
    told = json.loads(run_well("example", "pendulum", "--out", tmp_path, "--json"))
    document = diagnose(told["model"], told["recording"]).document
    (found,) = document["findings"]
    assert (found["effect"], found["target"]) == ("coulomb_friction", "joint:hinge")
    (friction,) = found["parameters"]
    assert friction["low"] <= 0.12 <= friction["high"]
    assert document["verdict"] == "explained"


def test_an_unknown_example_is_refused(tmp_path):
    said = refuse("example", "pendulums", "--out", tmp_path)
    assert "valid: desk_arm, hung_quadruped, pendulum, six_axis" in said
    assert not list(tmp_path.iterdir())
