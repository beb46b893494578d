"""The example's files fit together, and what it conceals is found."""

import json

import pytest
from typer.testing import CliRunner

from selfheal import diagnose
from selfheal.cli import app
from selfheal.recording import read


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """What the command says of the files that it wrote."""
    folder = tmp_path_factory.mktemp("example")
    words = ["example", "pendulum", "--out", str(folder), "--json"]
    ended = CliRunner().invoke(app, words)
    assert ended.exit_code == 0, ended.output
    return json.loads(ended.stdout)


def test_the_recording_is_what_its_map_makes_of_the_log(made, tmp_path):
    words = ["recording", "import", made["log"], "--model", made["model"]]
    words += ["--map", made["map"], "--out", str(tmp_path / "rec.h5")]
    ended = CliRunner().invoke(app, words)
    assert ended.exit_code == 0, ended.output
    imported, given = read(tmp_path / "rec.h5"), read(made["recording"])
    assert list(imported.episodes) == list(given.episodes)
    for found, true in zip(
        imported.episodes.values(), given.episodes.values(), strict=True
    ):
        assert found.time == pytest.approx(true.time)
        assert found.ctrl == pytest.approx(true.ctrl, abs=1e-4)
        angle = found.signals["hinge_position"].values
        assert angle == pytest.approx(true.signals["hinge_position"].values, abs=1e-4)


def test_what_is_concealed_is_found(made):
    document = diagnose(made["model"], made["recording"]).document
    (found,) = document["findings"]
    assert (found["effect"], found["target"]) == ("coulomb_friction", "joint:hinge")
    (friction,) = found["parameters"]
    assert friction["low"] <= 0.12 <= friction["high"]
    assert document["verdict"] == "explained"


def test_an_unknown_example_is_refused(tmp_path):
    ended = CliRunner().invoke(app, ["example", "pendulums", "--out", str(tmp_path)])
    assert ended.exit_code == 2
    assert not list(tmp_path.iterdir())
