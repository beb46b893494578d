"""`recording import`: from a log to a recording, and one message where it cannot."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from selfheal.cli import app
from selfheal.recording import read

MODEL = """<mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/>
<geom size="0.1" pos="0 0 0.2"/></body></worldbody>
<actuator><position name="servo" joint="hinge" kp="5"/></actuator></mujoco>"""
MAP = """
[time]
column = "t"
[[signals]]
kind = "command"
columns = ["goal"]
targets = ["servo"]
[[signals]]
kind = "joint_position"
columns = ["angle"]
targets = ["hinge"]
"""


@pytest.fixture
def home(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.xml").write_text(MODEL)
    (tmp_path / "map.toml").write_text(MAP)
    time = np.arange(0, 5, 0.01)
    rows = np.stack([time, np.sin(time), np.sin(time - 0.05)], axis=1)
    np.savetxt(
        tmp_path / "log.csv", rows, delimiter=",", header="t,goal,angle", comments=""
    )
    return tmp_path


def _run(*words):
    return CliRunner().invoke(app, ["recording", "import", *map(str, words)])


def test_a_log_becomes_a_recording_and_what_was_done_is_said(home):
    words = ("log.csv", "--model", "robot.xml", "--map", "map.toml", "--out", "rec.h5")
    ended = _run(*words)
    assert ended.exit_code == 0, ended.output
    assert "1 episode, 5.0 s, 500 rows" in ended.stdout
    assert "100 Hz" in ended.stdout
    assert "assumed to be in rad" in ended.stdout
    assert read("rec.h5").episodes["000"].time.size == 500
    (home / "rec.h5").unlink()
    told = json.loads(_run(*words, "--json").stdout)
    assert told["episodes"][0]["rows"] == 500


def test_a_guess_writes_a_map_that_imports(home):
    ended = _run("log.csv", "--model", "robot.xml", "--guess", "--out", "mine.toml")
    assert ended.exit_code == 0, ended.output
    assert "its motion" in ended.stdout.replace("\n", " ") or "follows it" in (
        (home / "mine.toml").read_text()
    )
    ended = _run(
        "log.csv", "--model", "robot.xml", "--map", "mine.toml", "--out", "r.h5"
    )
    assert ended.exit_code == 0, ended.output
    assert set(read("r.h5").episodes["000"].signals) == {"hinge_position"}


@pytest.mark.parametrize(
    "words, said",
    [
        (("log.csv", "--model", "robot.xml"), "give either --map MAP.toml or --guess"),
        (("log.csv", "--model", "robot.xml", "--map", "map.toml"), "--out FILE.h5 is"),
        (("log.csv", "--model", "robot.xml", "--guess"), "map.toml is there already"),
        (("no.csv", "--model", "robot.xml", "--map", "map.toml", "--out", "r.h5"),
         "no.csv: there is no such"),
        (("log.csv", "--model", "no.xml", "--map", "map.toml", "--out", "r.h5"),
         "no.xml"),
        (("log.csv", "--model", "robot.xml", "--map", "no.toml", "--out", "r.h5"),
         "no.toml: there is no such file"),
        (("robot.xml", "--model", "robot.xml", "--map", "map.toml", "--out", "r.h5"),
         "robot.xml: no log that is read"),
        (("log.csv", "--model", "robot.xml", "--map", "log.csv", "--out", "r.h5"),
         "log.csv: no TOML"),
        (("log.csv", "--model", "robot.xml", "--map", "map.toml", "--out", "no/r.h5"),
         "no/r.h5"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_one_message(home, words, said):
    before = sorted(path.name for path in home.iterdir())
    ended = _run(*words)
    assert ended.exit_code == 2, ended.output
    assert ended.stderr.startswith("selfheal: ") and said in ended.stderr
    assert ended.stderr.count("selfheal: ") == 1
    assert sorted(path.name for path in home.iterdir()) == before


def test_a_line_that_is_cut_off_is_left_out_and_told(home):
    with (home / "log.csv").open("a") as file:
        file.write("5.0,0.1")
    words = "recording import log.csv --model robot.xml --map map.toml --out rec.h5"
    result = CliRunner().invoke(app, words.split())
    assert result.exit_code == 0
    assert (
        "log.csv is damaged: the last line is cut off; that was left out."
        in result.stdout
    )
    assert read("rec.h5").episodes["000"].time.size == 500
