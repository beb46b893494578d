"""`selfheal recording check`: a table or JSON on stdout, refusals on stderr, codes."""

import json
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from selfheal import __version__
from selfheal.errors import EngineError, InputError
from selfheal.recording import Episode, Recording, Signal, write
from tests.support.commands.run import refuse, run

_check = partial(run, "recording", "check")


def test_the_version_is_said():
    assert run("--version").stdout.split() == ["selfheal", __version__]


def test_the_tables_name_every_episode_signal_and_kind(recording, file, model):
    result = _check(file, "--model", model)
    assert result.exit_code == 0
    for episode, content in recording.episodes.items():
        assert episode in result.stdout
        for name, signal in content.signals.items():
            assert name in result.stdout
            assert signal.unit in result.stdout
    assert "fits" in result.stdout


def test_json_is_one_object_and_nothing_else(recording, file):
    result = _check(file, "--json")
    summary = json.loads(result.stdout)
    assert (summary["format"], summary["version"]) == ("selfheal-recording-check", 1)
    for episode in summary["episodes"]:
        content = recording.episodes[episode["id"]]
        assert episode["samples"] == content.time.size
        assert episode["seconds"] == content.time[-1] - content.time[0]
        shares = {signal["missing"] for signal in episode["signals"]}
        assert shares == {1 / content.time.size}
    assert result.stderr == ""


SLIDE = """<mujoco><worldbody><body><joint name="x" type="slide" limited="true"
  range="-1 1"/><geom size="0.1"/></body></worldbody></mujoco>"""


def test_what_contradicts_the_model_is_told(tmp_path):
    (tmp_path / "slide.xml").write_text(SLIDE)
    time = np.arange(80) / 50
    signal = Signal(3 * np.sin(time), "joint_position", "x", "m")
    e = Episode(time, np.zeros((80, 0)), (), {"[b]x": signal})
    write(Recording({"a": e}), tmp_path / "a.h5")
    arguments = (tmp_path / "a.h5", "--model", tmp_path / "slide.xml")
    result = _check(*arguments, "--json")
    assert result.exit_code == 0, result.output
    summary = json.loads(result.stdout)
    (fault,) = summary["telemetry"]
    assert (fault["kind"], fault["columns"]) == ("joint_range", ["[b]x"])
    assert summary["unchecked"]
    result = _check(*arguments)
    assert result.exit_code == 0 and "joint_range" in result.stdout
    assert "not checked" in result.stdout and "[b]x" in result.stdout
    assert "keeps the contract and fits" in result.stdout


def test_a_refused_file_is_one_message_and_code_2(tmp_path):
    (tmp_path / "bad.h5").write_text("no HDF5")
    for arguments in ([], ["--json"]):
        said = refuse("recording", "check", tmp_path / "bad.h5", *arguments)
        assert said.startswith(f"selfheal: {tmp_path}/bad.h5: it is no HDF5")


def test_a_model_that_does_not_fit_is_code_2(file, tmp_path):
    (tmp_path / "other.xml").write_text("<mujoco/>")
    said = refuse("recording", "check", file, "--model", tmp_path / "other.xml")
    assert "the model has no actuator" in said


@pytest.mark.parametrize(
    ("error", "code"),
    [(InputError("no"), 2), (EngineError("no"), 1), (KeyboardInterrupt(), 130)],
)
def test_expected_failures_have_a_code_and_no_traceback(monkeypatch, error, code):
    monkeypatch.setattr("selfheal.recording.read", _raiser(error))
    result = _check("a.h5")
    assert result.exit_code == code
    assert isinstance(result.exception, SystemExit)


def test_what_nobody_expected_keeps_its_traceback(monkeypatch):
    monkeypatch.setattr("selfheal.recording.read", _raiser(ZeroDivisionError()))
    result = _check("a.h5")
    assert result.exit_code == 1
    assert isinstance(result.exception, ZeroDivisionError)


def _raiser(error):
    def fail(*_):
        raise error

    return fail


@pytest.mark.parametrize("json_option", [[], ["--json"]])
def test_a_full_disk_behind_stdout_is_one_message(file, json_option):
    command = [sys.executable, "-c", "from selfheal.cli import app; app()"]
    command += ["recording", "check", str(file), *json_option]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stderr == "selfheal: cannot write: No space left on device\n"


def test_a_map_is_told_the_rules_that_mend_it(tmp_path):
    model = tmp_path / "arm.xml"
    model.write_text(
        '<mujoco><worldbody><body><joint name="a" range="-90 90" limited="true"/>'
        '<geom size=".1"/><body><joint name="b" range="-90 90" limited="true"/>'
        '<geom size=".1"/></body></body></worldbody></mujoco>'
    )
    time = np.arange(200) / 50
    signals = {
        f"{name}_position": Signal(
            80 * np.sin(rate * time), "joint_position", name, "rad"
        )
        for name, rate in (("a", 1.0), ("b", 1.7))
    }
    write(
        Recording({"0": Episode(time, np.empty((200, 0)), (), signals)}),
        tmp_path / "r.h5",
    )
    map_file = tmp_path / "map.toml"
    map_file.write_text(
        '[[signals]]\nkind = "joint_position"\ncolumns = "q_*"\nunit = "rad"\n'
    )
    words = "recording", "check", tmp_path / "r.h5", "--model", model
    ended = run(*words, "--map", map_file)
    assert "map.toml, in place of the 1. [[signals]]:" in " ".join(ended.stdout.split())
    assert "scale = 0.0174532925" in ended.stdout
    told = " ".join(ended.stdout.split())
    assert "keeps the contract, but contradicts" in told and "refuses it" in told
    assert (
        max(map(len, ended.stdout.splitlines())) <= 80 or str(tmp_path) in ended.stdout
    )
    assert run(*words[:3], "--map", map_file).exit_code == 2
