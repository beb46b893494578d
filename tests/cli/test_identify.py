"""`identify`, `show`, `robots`: JSON and files; refusals before anything is written."""

import json
import math
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import mujoco
import pytest

from selfheal.recording import Recording, write
from selfheal.robot.open_robot import open_robot
from selfheal.selfmodel.read_run import load_run
from selfheal.selfmodel.run import Run, save_run
from tests.support.commands.run import refuse, run, run_well

SMALL = ["--robot", "starfish", "--engine", "statics", "--cycles", "2"]
SMALL += ["--budget", "600", "--seed", "5"]
pytestmark = pytest.mark.usefixtures("undrawn")


_identify, _refused = partial(run, "identify"), partial(refuse, "identify")


def _numbers(value):
    """Every number in a JSON value."""
    if isinstance(value, dict):
        value = [*value.values()]
    if isinstance(value, list):
        return [n for item in value for n in _numbers(item)]
    return [value] if isinstance(value, int | float) else []


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The folder of a finished run, and what `--json` said of it."""
    folder = tmp_path_factory.mktemp("runs") / "star"
    result = _identify(*SMALL, "--out", folder, "--json")
    assert result.exit_code == 0, result.output
    return folder, result


@pytest.fixture
def copied(finished, tmp_path):
    """A copy of that folder, to spoil."""
    shutil.copytree(finished[0], tmp_path / "copy")
    return tmp_path / "copy"


@pytest.fixture
def recorded(tmp_path):
    """A recording of the first three actions of a simulated starfish."""
    robot, episodes = open_robot("starfish"), {}
    for action in range(3):
        episodes |= robot.act(action).episodes
    write(Recording(episodes), tmp_path / "three.h5")
    return tmp_path / "three.h5"


def test_json_is_one_object_with_the_keys_of_the_contract(finished):
    folder, result = finished
    assert result.stderr == "" and result.stdout.count("\n") == 1
    told = json.loads(result.stdout)
    assert set(told) == {
        *("format", "version", "robot", "method", "seed", "parent", "sureness"),
        *("length", "tilt_error", "actions", "simulations", "seconds"),
        *("run", "model"),
    }
    assert (told["format"], told["version"]) == ("selfheal-identify", 1)
    assert (told["robot"], told["method"], told["seed"]) == ("starfish", "default", 5)
    assert all(math.isfinite(number) for number in _numbers(told))
    sizes = {len(told[name]) for name in ("parent", "sureness", "length")}
    assert sizes == {8}
    assert all(0 <= parent <= part for part, parent in enumerate(told["parent"]))
    assert all(0 <= share <= 1 for share in told["sureness"])
    assert len(told["actions"]) == 2 and told["simulations"]["mujoco"] == 36
    assert (told["run"], told["model"]) == (
        str(folder / "run.h5"),
        str(folder / "best.xml"),
    )


def test_a_run_leaves_the_run_the_body_and_the_page(finished):
    folder, result = finished
    names = sorted(path.name for path in folder.iterdir())
    assert names == ["best.xml", "report.html", "run.h5"]
    assert load_run(folder / "run.h5").result == json.loads(result.stdout)
    model = mujoco.MjModel.from_xml_path(str(folder / "best.xml"))
    assert model.nu == 8
    page = (folder / "report.html").read_text()
    assert page.startswith("<!doctype html>") or page.startswith("<!DOCTYPE html>")


def test_a_run_without_a_folder_gets_one_named_after_robot_and_seed(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    first, again = _identify(*SMALL), _identify(*SMALL, "--json")
    told = json.loads(again.stdout)
    assert (first.exit_code, again.exit_code) == (0, 0)
    # progress goes to stderr and the table to stdout
    for word in ("left_upper", "hangs on", "truth", "tilt error", "report.html"):
        assert word in first.stdout
    assert "disagreement" in first.stderr and "disagreement" not in first.stdout
    run = load_run("runs/starfish-5/run.h5")
    assert told["parent"] == run.result["parent"]
    made = {tmp_path / "runs" / "starfish-5" / "run.h5", Path(told["run"])}
    assert set(tmp_path.rglob("run.h5")) == made and len(made) == 2


BAD = [
    (["--robot", "crab"], "unknown robot 'crab'; valid: starfish, starfish-2006"),
    (["--robot", "starfish", "--method", "luck"], "unknown method 'luck'; valid: def"),
    (["--robot", "starfish", "--space", "any"], "unknown space 'any'; valid: free"),
    (["--robot", "starfish", "--engine", "ode"], "unknown engine 'ode'; valid: auto"),
    (["--robot", "starfish", "--cycles", "0"], "cycles must be 1 to 36"),
    (["--robot", "starfish", "--known-lengths"], "known lengths go with space 'full'"),
    (["--robot", "starfish", "--space", "sides", "--known-lengths"], "always known"),
    (
        ["--robot", "starfish", "--method", "paper", "--random-actions"],
        "random actions go with method 'default', not 'paper'",
    ),
    (["--robot", "starfish", "--cycles", "37"], "cycles must be 1 to 36"),
    (["--robot", "starfish", "--budget", "-5"], "budget must be positive; not -5"),
    (["--robot", "starfish", "--seed", "-1"], "seed must not be negative"),
    (["--robot", "starfish", "--moves", "-1"], "moves must be 0 to 100; not -1"),
    (["--robot", "tree", "--seed", "-1"], "seed must not be negative"),
    (["--robot", "starfish-2006"], "--recordings intact.h5"),
    (["--robot", "starfish-2006", "--recordings", "no.h5"], "there is no such file"),
    (["--robot", "starfish", "--recordings", "no.h5"], "answers from no recording"),
    (["--robot", "starfish", "--resume", "a.h5"], "either --robot NAME or --resume"),
    ([], "either --robot NAME or --resume"),
    (["--resume", "nowhere.h5"], "nowhere.h5: no such run file"),
    (["--resume", "no/where.h5"], "no/where.h5"),
    (["--resume", "a.h5", "--cycles", "3", "--force"], "leave out --cycles, --force"),
]


@pytest.mark.parametrize("arguments, text", BAD, ids=[" ".join(a) for a, _ in BAD])
def test_bad_input_is_refused_and_writes_nothing(
    arguments, text, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    for extra in ([], ["--json"]):
        assert text in _refused(*arguments, *extra)
        assert not list(tmp_path.iterdir())


def test_a_recording_offers_only_its_own_actions(recorded, tmp_path):
    given = ["--robot", "starfish-2006", "--recordings", recorded, *SMALL[2:]]
    out = ["--out", tmp_path / "out"]
    assert "must be 1 to 3" in _refused(*given, "--cycles", "4", *out)
    result = _identify(*given, "--cycles", "3", *out, "--json")
    assert sorted(json.loads(result.stdout)["actions"]) == [[0], [1], [2]]


def test_a_run_is_not_started_over_by_accident(copied):
    before = (copied / "run.h5").read_bytes()
    _refused(*SMALL, "--cycles", "0", "--out", copied, "--force")
    said = _refused(*SMALL, "--out", copied)
    for way in (f"--resume {copied / 'run.h5'}", "--force", "--out"):
        assert way in said
    assert (copied / "run.h5").read_bytes() == before
    again = _identify(*SMALL, "--seed", "6", "--out", copied, "--force", "--json")
    assert json.loads(again.stdout)["seed"] == 6
    assert load_run(copied / "run.h5").settings.seed == 6


@pytest.mark.parametrize("name", ["best.xml", "report.html"])
def test_files_of_somebody_else_are_not_overwritten_by_accident(name, tmp_path):
    (tmp_path / name).write_text("mine")
    said = _refused(*SMALL, "--out", tmp_path)
    assert f"{tmp_path / name} is there already; start over by --force" in said
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "mine"


def test_a_finished_run_resumed_says_the_same_again(copied, finished):
    result = _identify("--resume", copied / "run.h5", "--json")
    assert result.stdout == finished[1].stdout


def test_a_run_without_a_cycle_begins_when_resumed(copied, finished):
    run = load_run(copied / "run.h5")
    empty = Run(run.settings, run.anatomy, run.actions, truth=run.truth)
    save_run(empty, copied / "run.h5")
    assert "no cycle yet" in refuse("show", copied / "run.h5")
    told = json.loads(_identify("--resume", copied / "run.h5", "--json").stdout)
    first = json.loads(finished[1].stdout)
    assert told["parent"] == first["parent"] and told["actions"] == first["actions"]
    assert told["run"] == str(copied / "run.h5")


HOLD = """
import sys
from selfheal.files import lock_file
with lock_file(sys.argv[1]):
    print("ready", flush=True)
    sys.stdin.read()
"""


def test_two_processes_do_not_share_a_folder(copied):
    pipe, file = subprocess.PIPE, copied / "run.h5"
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, file], stdin=pipe, stdout=pipe, text=True
    ) as other:
        assert other.stdout.readline() == "ready\n"
        busy = "another process is working on it"
        assert busy in _refused("--resume", file)
        assert busy in _refused(*SMALL, "--out", copied, "--force")
        other.communicate()
    assert _identify("--resume", file, "--json").exit_code == 0


def test_show_prints_what_identify_printed(copied, finished):
    shown = run_well("show", copied / "run.h5", "--json")
    assert shown == finished[1].stdout
    (copied / "report.html").unlink()
    table = run_well("show", copied / "run.h5")
    assert "hangs on" in table
    assert (copied / "report.html").is_file()


def test_show_of_an_interrupted_run_says_how_to_go_on(copied):
    run = load_run(copied / "run.h5")
    save_run(replace(run, cycles=run.cycles[:1], result={}), copied / "run.h5")
    shown = run_well("show", copied / "run.h5")
    assert "1 of 2 cycles" in shown
    assert f"--resume {copied / 'run.h5'}" in shown
    told = json.loads(run_well("show", copied / "run.h5", "--json"))
    assert told["cycles"] == 1


def test_robots_are_listed():
    lines = run("robots").stdout.splitlines()
    told = json.loads(run("robots", "--json").stdout)
    assert [line.split()[0] for line in lines] == [*told["robots"]]
    assert "starfish" in told["robots"]
