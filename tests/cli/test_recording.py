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
from tests.support.commands.run import refuse, run, run_well

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


@pytest.mark.parametrize(
    ("error", "code", "ends_by"),
    [
        (InputError("no"), 2, SystemExit),
        (EngineError("no"), 1, SystemExit),
        (KeyboardInterrupt(), 130, SystemExit),
        (ZeroDivisionError(), 1, ZeroDivisionError),
    ],
)
def test_only_failures_that_nobody_expected_have_a_traceback(
    monkeypatch, error, code, ends_by
):
    def fail(*_):
        raise error

    monkeypatch.setattr("selfheal.recording.read", fail)
    result = _check("a.h5")
    assert result.exit_code == code and isinstance(result.exception, ends_by)


@pytest.mark.parametrize("json_option", [[], ["--json"]])
def test_a_full_disk_behind_stdout_is_one_message(file, json_option):
    command = [sys.executable, "-c", "from selfheal.cli import app; app()"]
    command += ["recording", "check", str(file), *json_option]
    error = subprocess.PIPE
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, check=False, stdout=full, stderr=error)
    assert done.returncode == 1
    assert done.stderr == b"selfheal: cannot write: No space left on device\n"


def test_a_map_is_corrected_by_the_rules_that_are_printed(tmp_path):
    model, map_file = tmp_path / "arm.xml", tmp_path / "map.toml"
    limited = '<joint name="{}" range="-90 90" limited="true"/><geom size=".1"/>'
    upper, lower = map(limited.format, "ab")
    body = f"<body>{upper}<body>{lower}</body></body>"
    model.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    time = np.arange(200) / 50
    positions = {"a": 80 * np.sin(time), "b": 80 * np.sin(1.7 * time)}
    made = Recording.from_arrays(time, {}, {"joint_position": positions})
    write(made, tmp_path / "r.h5")
    map_file.write_text(
        '[[signals]]\nkind = "joint_position"\ncolumns = "q_*"\nunit = "rad"\n'
    )
    words = "recording", "check", tmp_path / "r.h5", "--model", model
    said = " ".join(run_well(*words, "--map", map_file).split())
    assert "map.toml, in place of the 1. [[signals]]:" in said
    assert "scale = 0.0174532925" in said
    assert "keeps the contract, but contradicts" in said and "refuses it" in said
    told = json.loads(run_well(*words, "--map", map_file, "--json"))
    (rule,) = told["corrected_rules"]
    assert rule["rule"] == 0 and 'kind = "joint_position"' in rule["lines"]
    assert "needs --model" in refuse(*words[:3], "--map", map_file)
