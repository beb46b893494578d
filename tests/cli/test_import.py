"""`recording import`: from a log to a recording, and one message where it cannot."""

import json
import re
import shlex

import numpy as np
import pytest
from typer.testing import CliRunner

from selfheal.cli import app
from selfheal.recording import read
from tests.support.diagnosis_folder import write_empty_diagnosis

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


def test_a_guess_says_how_all_of_its_logs_are_imported(home):
    (home / "run 2.csv").write_bytes((home / "log.csv").read_bytes())
    words = ("--model", "robot.xml", "--guess", "--out", "mine.toml")
    guessed = _run("log.csv", "run 2.csv", *words)
    _, _, command = guessed.stdout.strip().rpartition("selfheal recording import ")
    ended = _run(*shlex.split(command))
    assert ended.exit_code == 0, ended.output
    assert len(read("recording.h5").episodes) == 2


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


def _write(path, *columns, header="t,goal,angle"):
    rows = [",".join(map(str, row)) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")


TIME = np.arange(0, 2, 0.01)
WAVE = np.sin(3 * TIME)


@pytest.mark.parametrize(
    ("columns", "said"),
    [
        (([], [], []), "log.csv: it holds no row"),
        (([0], [0.1], [0.1]), "log.csv: it holds one row"),
        ((1e3 * TIME, WAVE, WAVE), 'would fit in the map: [time] unit = "ms"'),
        ((1e9 * TIME, WAVE, WAVE), 'would fit in the map: [time] unit = "ns"'),
        ((TIME, ["off"] * 200, WAVE), "column 'goal' holds the text 'off'"),
        ((TIME, WAVE, ["off", *WAVE[1:]]), "column 'angle' holds the text 'off'"),
        ((TIME, ["nan"] * 200, WAVE), "no number in column 'goal'"),
    ],
)
def test_a_log_that_tells_no_motion_is_one_message(home, columns, said):
    _write(home / "log.csv", *columns)
    ended = _run("log.csv", "--model", "robot.xml", "--map", "map.toml", "--out", "r")
    assert ended.exit_code == 2, ended.output
    assert ended.stderr.startswith("selfheal: ") and said in ended.stderr
    assert not (home / "r").exists()


def test_a_guess_tells_the_column_of_texts_that_it_could_not_use(home):
    _write(home / "log.csv", TIME, ["off"] * 200, WAVE)
    ended = _run("log.csv", "--model", "robot.xml", "--guess", "--out", "guess.toml")
    assert ended.exit_code == 0, ended.output
    assert "no command was found for servo" in ended.stdout
    assert "columns that hold texts are not used: goal" in ended.stdout


@pytest.mark.parametrize("rows", [0, 1])
def test_nothing_is_guessed_of_a_row(home, rows):
    _write(home / "log.csv", *([0.0] * rows for _ in range(3)))
    ended = _run("log.csv", "--model", "robot.xml", "--guess", "--out", "guess.toml")
    assert ended.exit_code == 2 and "row; would fit" in ended.stderr
    assert not (home / "guess.toml").exists()


def test_an_empty_file_is_called_empty(home):
    (home / "log.csv").write_bytes(b"")
    words = ("--model", "robot.xml", "--guess", "--out", "mine.toml")
    ended = _run("log.csv", *words)
    assert ended.exit_code == 2 and "log.csv: it is empty" in ended.stderr


def test_a_unit_of_time_that_is_stated_is_taken_and_told(home):
    _write(home / "log.csv", 10 * np.arange(20.0), WAVE[:20], WAVE[:20])
    text = MAP.replace('column = "t"', 'column = "t"\nunit = "s"')
    (home / "map.toml").write_text(text)
    ended = _run(
        "log.csv", "--model", "robot.xml", "--map", "map.toml", "--out", "r.h5"
    )
    assert ended.exit_code == 0, ended.output
    assert "190.0 s, 20 rows" in ended.stdout and "0.01 s in ms" in ended.stdout


def test_a_column_without_a_number_is_told(home):
    _write(home / "log.csv", TIME, WAVE, ["nan"] * 200)
    ended = _run(
        "log.csv", "--model", "robot.xml", "--map", "map.toml", "--out", "r.h5"
    )
    assert ended.exit_code == 0, ended.output
    assert "no number was taken from 'angle'" in ended.stdout


def test_nothing_is_overwritten_without_force(home):
    (home / "rec.h5").write_text("mine")
    words = ("log.csv", "--model", "robot.xml", "--map", "map.toml", "--out")
    ended = _run(*words, "rec.h5")
    assert ended.exit_code == 2 and "rec.h5 is there already; --force" in ended.stderr
    assert (home / "rec.h5").read_text() == "mine"
    assert _run(*words, "rec.h5", "--force").exit_code == 0
    assert read("rec.h5").episodes["000"].time.size == 500
    for name in ("log.csv", "robot.xml", "map.toml"):
        before = (home / name).read_bytes()
        ended = _run(*words, name, "--force")
        assert ended.exit_code == 2 and "would overwrite" in ended.stderr
        assert (home / name).read_bytes() == before


def test_a_model_without_actuators_is_told_at_once(home):
    bare = re.sub("<actuator>.*</actuator>", "", MODEL)
    (home / "robot.xml").write_text(bare)
    guessed = _run("log.csv", "--model", "robot.xml", "--guess", "--out", "mine.toml")
    assert guessed.exit_code == 0 and "selfheal model prepare" in guessed.stdout
    words = ("log.csv", "--model", "robot.xml", "--out", "rec.h5", "--map")
    refused = _run(*words, "map.toml")
    assert refused.exit_code == 2 and "selfheal model prepare" in refused.stderr
    imported = _run(*words, "mine.toml")
    assert imported.exit_code == 0 and "selfheal model prepare" in imported.stdout


def test_what_is_imported_is_replayed(home):
    """By the commands that the refusal of a log says, and those after them."""
    whole = ("diagnose", "robot.xml", "log.csv", "--out", "found")
    refused = CliRunner().invoke(app, whole)
    assert refused.exit_code == 2 and not (home / "found").exists()
    (home / "map.toml").unlink()
    for command in re.findall("selfheal (recording import [^;\n]*?)(?=;|$)",
                              refused.stderr.strip().replace("then ", "")):  # fmt: skip
        ended = CliRunner().invoke(app, command.split())
        assert ended.exit_code == 0, ended.output
    write_empty_diagnosis(home / "found", home / "robot.xml")
    ended = CliRunner().invoke(
        app, "replay found recording.h5 --out predicted.h5".split()
    )
    assert ended.exit_code == 0, ended.output
    played, given = (read(f) for f in ("predicted.h5", "recording.h5"))
    angles = [
        r.episodes["000"].signals["hinge_position"].values for r in (played, given)
    ]
    assert np.isfinite(angles[0]).all()
    assert abs(angles[0][0] - angles[1][0]) < 0.05
