"""`recording import`: from a log to a recording, and one message where it cannot."""

import json
import re
import shlex

import numpy as np
import pytest

from selfheal.recording import read
from tests.support.commands.run import refuse, run_well
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


def _words(*more, log="log.csv"):
    return "recording", "import", log, "--model", "robot.xml", *more


def _import(map_file="map.toml", out="rec.h5", *more):
    """The words that make a recording of the log."""
    return _words("--map", map_file, "--out", out, *more)


GUESS = _words("--guess", "--out", "mine.toml")


def test_a_log_becomes_a_recording_and_what_was_done_is_said(home):
    said = run_well(*_import())
    for words in ("1 episode, 5.0 s, 500 rows", "100 Hz", "assumed to be in rad"):
        assert words in said
    assert read("rec.h5").episodes["000"].time.size == 500
    (home / "rec.h5").unlink()
    told = json.loads(run_well(*_import(), "--json"))
    assert told["episodes"][0]["rows"] == 500


def test_a_guess_says_how_all_of_its_logs_are_imported(home):
    (home / "run 2.csv").write_bytes((home / "log.csv").read_bytes())
    guessed = run_well(*GUESS[:3], "run 2.csv", *GUESS[3:])
    assert "follows it" in (home / "mine.toml").read_text()
    _, _, command = guessed.strip().rpartition("selfheal ")
    run_well(*shlex.split(command))
    found = read("recording.h5").episodes.values()
    assert [set(e.signals) for e in found] == 2 * [{"hinge_position"}]


@pytest.mark.parametrize(
    "words, said",
    [
        (_words(), "give either --map MAP.toml or --guess"),
        (_words("--map", "map.toml"), "--out FILE.h5 is"),
        (_words("--guess"), "map.toml is there already"),
        (_words(*_import()[5:], log="no.csv"), "no.csv: there is no such"),
        (_import("map.toml", "r.h5", "--model", "no.xml"), "no.xml"),
        (_import("no.toml"), "no.toml: there is no such file"),
        (_words(*_import()[5:], log="robot.xml"), "robot.xml: no log that is read"),
        (_import("log.csv"), "log.csv: no TOML"),
        (_import("map.toml", "no/r.h5"), "no/r.h5"),
    ],
)
def test_what_cannot_be_done_is_one_message(home, words, said):
    before = sorted(path.name for path in home.iterdir())
    assert said in refuse(*words)
    assert sorted(path.name for path in home.iterdir()) == before


def test_a_line_that_is_cut_off_is_left_out_and_told(home):
    with (home / "log.csv").open("a") as file:
        file.write("5.0,0.1")
    told = run_well(*_import())
    assert "log.csv is damaged: the last line is cut off; that was left out." in told
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
    assert said in refuse(*_import())
    assert not (home / "rec.h5").exists()


def test_a_guess_tells_the_column_of_texts_that_it_could_not_use(home):
    _write(home / "log.csv", TIME, ["off"] * 200, WAVE)
    told = run_well(*GUESS)
    assert "no command was found for servo" in told
    assert "columns that hold texts are not used: goal" in told


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t,goal,angle\n", "row; would fit"),
        ("t,goal,angle\n0,0,0\n", "row; would fit"),
        ("", "log.csv: it is empty"),
    ],
)
def test_nothing_is_guessed_of_a_row(home, text, said):
    (home / "log.csv").write_text(text)
    assert said in refuse(*GUESS)
    assert not (home / "mine.toml").exists()


def test_a_unit_of_time_that_is_stated_is_taken_and_told(home):
    _write(home / "log.csv", 10 * np.arange(20.0), WAVE[:20], WAVE[:20])
    text = MAP.replace('column = "t"', 'column = "t"\nunit = "s"')
    (home / "map.toml").write_text(text)
    told = run_well(*_import())
    assert "190.0 s, 20 rows" in told and "0.01 s in ms" in told


def test_a_column_without_a_number_is_told(home):
    _write(home / "log.csv", TIME, WAVE, ["nan"] * 200)
    assert "no number was taken from 'angle'" in run_well(*_import())


def test_nothing_is_overwritten_without_force(home):
    (home / "rec.h5").write_text("mine")
    assert "rec.h5 is there already; --force" in refuse(*_import())
    assert (home / "rec.h5").read_text() == "mine"
    run_well(*_import(), "--force")
    assert read("rec.h5").episodes["000"].time.size == 500
    for name in ("log.csv", "robot.xml", "map.toml"):
        before = (home / name).read_bytes()
        assert "would overwrite" in refuse(*_import("map.toml", name, "--force"))
        assert (home / name).read_bytes() == before


def test_a_model_without_actuators_is_told_at_once(home):
    bare = re.sub("<actuator>.*</actuator>", "", MODEL)
    (home / "robot.xml").write_text(bare)
    prepare = "selfheal model prepare"
    assert prepare in run_well(*GUESS)
    assert prepare in refuse(*_import())
    assert prepare in run_well(*_import("mine.toml"))


def test_what_is_imported_is_replayed(home):
    """By the commands that the refusal of a log says, and those after them."""
    said = refuse("diagnose", "robot.xml", "log.csv", "--out", "found")
    assert not (home / "found").exists()
    (home / "map.toml").unlink()
    for command in re.findall(
        "selfheal (recording import [^;\n]*?)(?=;|$)", said.strip().replace("then ", "")
    ):
        run_well(*command.split())
    write_empty_diagnosis(home / "found", home / "robot.xml")
    run_well("replay", "found", "recording.h5", "--out", "predicted.h5")
    played, given = (read(f) for f in ("predicted.h5", "recording.h5"))
    angles = [
        r.episodes["000"].signals["hinge_position"].values for r in (played, given)
    ]
    assert np.isfinite(angles[0]).all()
    assert abs(angles[0][0] - angles[1][0]) < 0.05
