"""Names that would control a terminal: shown by every command, sent by none."""

import ast
import json
import logging
import re
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from selfheal.cli import app
from selfheal.cli._print import print_table
from selfheal.cli._progress import ProgressBar
from selfheal.cli._streams import PrintableStream
from selfheal.cli._warnings import say_warnings
from selfheal.cli.diagnose import _print_diagnosis
from selfheal.cli.identify import _print_result
from selfheal.printable import MAX_TEXT
from selfheal.recording import Recording, write
from selfheal.selfmodel.loop import identify_body
from selfheal.selfmodel.run import Settings, save_run
from selfheal.study.plan import Task
from selfheal.study.store import create_study, open_journal
from selfheal.study.worker import PinnedWorker
from tests.support.diagnosis_folder import write_empty_diagnosis
from tests.support.hostile.names import HALVES, NAMES, find_raw, spoil
from tests.support.made_up_diagnosis import DELAY, FINDING, make_diagnosis
from tests.support.made_up_run import make_run
from tests.support.paths import ROOT
from tests.support.stick_robot import Toy

OWN = r"\x1b\[[0-9;?]*[A-Za-z]|\r"  # what rich writes where there are colors, a bar
HOSTILE = pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)


def _run(*arguments):
    """Standard output, standard error and code of a command, both without control."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    out, err = result.stdout_bytes.decode(), result.stderr_bytes.decode()
    assert not find_raw(out) and not find_raw(err)
    return out, err, result.exit_code


def _refused(*arguments) -> str:
    """The one line that a refusal says."""
    out, err, code = _run(*arguments)
    assert (out, code) == ("", 2)
    assert err.startswith("selfheal: ") and err.count("\n") == 1
    assert len(err) <= MAX_TEXT + 1
    return err


# ---- recordings and models


@pytest.fixture
def named(recording, tmp_path):
    """Write a recording with one name everywhere."""

    def make(name: str) -> Path:
        episode = recording.episodes["alpha"]
        voltage = replace(episode.signals["voltage"], target=name)
        signals = {name: voltage, "up": replace(episode.signals["up"], unit=name)}
        episode = replace(episode, motion=name, signals=signals)
        episode = replace(episode, ctrl_names=("motor", name))
        made = Recording({name: episode}, robot=name, source=name)
        write(made, tmp_path / "named.h5")
        return tmp_path / "named.h5"

    return make


@HOSTILE
def test_a_recording_of_any_names_is_shown_and_refused_in_a_line(name, named, model):
    file = named(name)
    out, err, code = _run("recording", "check", file)
    assert (err, code) == ("", 0) and "keeps the contract." in out
    assert name in out or name != NAMES["markup"]
    rows = [line for line in out.splitlines() if line.startswith("selfheal")]
    assert rows == []  # a newline in a name forges no line
    out, _, _ = _run("recording", "check", file, "--json")
    assert out.isascii() and out.count("\n") == 1
    told = json.loads(out)
    (episode,) = told["episodes"]
    signal, actuator = episode["signals"][0], episode["actuators"][1]
    found = {told["robot"], told["source"], episode["id"], episode["motion"], actuator}
    assert found | {signal["name"], signal["target"]} == {name}
    said = _refused("recording", "check", file, "--model", model)
    assert "the model has no actuator" in said


def test_a_model_of_many_odd_names_is_listed_in_a_line(named, tmp_path):
    motors = "".join(f'<motor name="\u202e\x85{k}" joint="j"/>' for k in range(500))
    (tmp_path / "odd.xml").write_text(
        '<mujoco><worldbody><body><joint name="j"/><geom size="1"/></body></worldbody>'
        f"<actuator>{motors}</actuator></mujoco>"
    )
    said = _refused("recording", "check", named("b"), "--model", tmp_path / "odd.xml")
    assert r"would fit: '\u202e\x850', '\u202e\x851', " in said
    assert re.search(r", \.\.\. and 4\d\d more$", said)


@HOSTILE
def test_a_file_that_a_user_names_is_named_in_a_line(name, tmp_path):
    _refused("recording", "check", f"{tmp_path}/{name}")
    assert _run("recording", "check", "a", name)[2] == 2  # the parser's own words
    assert _run(name)[2] == 2


def test_a_path_that_is_no_text_is_shown_and_is_in_json(recording, tmp_path):
    path = f"{tmp_path}/caf\udce9.h5"
    write(recording, path)
    assert r"/caf\udce9.h5" in _run("recording", "check", path)[0]
    out, _, _ = _run("recording", "check", path, "--json")
    assert json.loads(out)["file"] == path


# ---- diagnoses, runs, studies


def test_a_diagnosis_of_any_names_is_printed(capsys, tmp_path):
    given = make_diagnosis(findings=(FINDING, DELAY))
    document = {**spoil(given.document), "verdict": "partly"}
    made = replace(given, document=document, remarks=(spoil("a"), HALVES))
    _print_diagnosis(made, tmp_path / NAMES["lines"])
    out = capsys.readouterr().out
    assert not find_raw(out) and NAMES["markup"] in out
    assert r"\u202e" in out and r"\ud800 caf\udce9" in out
    assert all(len(line) <= MAX_TEXT for line in out.splitlines())


@HOSTILE
def test_a_diagnosis_file_of_any_names_is_refused_in_a_line(
    name, named, model, tmp_path
):
    folder = write_empty_diagnosis(tmp_path / "d", model)
    document = json.loads((folder / "diagnosis.json").read_text())
    values = ({"effect": name}, {"effect": "wind", "target": name}, name)
    for key in ("findings", "refit"):
        for value in values:
            changed = {**document, key: [value]}
            (folder / "diagnosis.json").write_text(json.dumps(changed))
            _refused("replay", folder, named("b"), "--out", tmp_path / "p.h5")


def test_a_run_of_any_names_is_printed(capsys):
    run = make_run()
    names = tuple(f"{name}{HALVES}" for name in list(NAMES.values())[-3:])
    result = {"sureness": [0.5] * 3, "tilt_error": 0.1}
    anatomy = replace(run.anatomy, parts=names)
    made = replace(run, anatomy=anatomy, counts={NAMES["title"]: 1}, result=result)
    _print_result(made, [Path(NAMES["color"])])
    out = capsys.readouterr().out
    assert not find_raw(out) and r"\x1b[31mred" in out


def test_a_run_file_of_any_names_is_shown(tmp_path):
    small = Settings("toy", engine="statics", cycles=2, budget=40)
    run = next(identify_body(Toy(), small))
    names = tuple(NAMES.values())[: run.anatomy.size]
    anatomy = replace(run.anatomy, parts=names, joints=names)
    settings = replace(run.settings, robot=NAMES["bidi"], recordings=NAMES["color"])
    save_run(replace(run, anatomy=anatomy, settings=settings), tmp_path / "run.h5")
    _, err, code = _run("show", tmp_path / "run.h5")
    assert (err, code) == ("", 0)
    page = (tmp_path / "report.html").read_text()
    assert not find_raw(page) and r"\u202egnp.exe" in page


@HOSTILE
def test_a_study_of_any_names_is_shown(name, tmp_path):
    fit = dict.fromkeys(("given", "refit", "patched", "explainable_removed"), 0.5)
    finding = {"value": 0.5, "low": 0.4, "high": 0.6, "name": name, "unit": name}
    finding |= {"effect": name, "target": name}
    outcome = {"verdict": name, "findings": [finding], "fit": fit}
    settings = {"robot": name, "seed": 0}
    tasks = [Task(key, settings) for key in (name, f"{name}2")]
    done = {"settings": settings, "seconds": 1.0, "megabytes": 5, "worker": name}
    create_study(tmp_path / "study.h5", "diagnose", {name: name}, tasks)
    with open_journal(tmp_path / "study.h5") as journal:
        failed = {"key": f"{name}2", "outcome": None, "error": f"Error: {name}"}
        found = {"key": name, "outcome": outcome, "error": ""}
        journal.add([found | done, failed | done])
    out, _, code = _run("study", "show", tmp_path / "study.h5")
    assert code == 0 and out.endswith("report.md\n")
    told = json.loads(_run("study", "show", tmp_path / "study.h5", "--json")[0])
    assert told["failed"] == [{"key": f"{name}2", "error": f"Error: {name}"}]
    assert told["tables"][0]["rows"][0][0] == name
    page, text = ((tmp_path / f"report.{end}").read_text() for end in ("html", "md"))
    assert not find_raw(page, keep="\n\t") and not find_raw(text)
    assert "<b>" not in text
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert [row.count("|") for row in rows] == [8] * 3 + [7] * 6


# ---- terminals with colors, progress, warnings, what nobody expected


@pytest.fixture
def colors(monkeypatch):
    """Have rich write for a terminal with colors."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")


@HOSTILE
def test_a_table_in_colors_has_no_control_but_its_own(name, colors, capsys):
    print_table((name, "b"), [(name, [name, "c"])], title=name)
    out = capsys.readouterr().out
    assert "\x1b[1m" in out and not find_raw(re.sub(OWN, "", out))
    assert len(re.findall("\x1b.*?m", out)) == len(re.findall("\x1b\\[[0-9]*m", out))


@HOSTILE
def test_progress_has_no_control_but_its_own(name, colors, capsys):
    with ProgressBar(name, as_json=False, progress=False) as live:
        live.say(name, head="1")
        live.show(name, 0.5)
        print(name, file=sys.stderr)
        print(name)
    out, err = capsys.readouterr()
    assert out == "" and not find_raw(re.sub(OWN, "", err))
    assert r"\x1b[31m" in err or name != NAMES["color"]


@HOSTILE
def test_whoever_writes_to_a_guarded_stream_controls_nothing(name, capsys):
    stream = PrintableStream(sys.stdout)
    assert stream.write(name) == len(name)
    stream.writelines([name, "\n"])
    assert stream.isatty() is False
    assert not find_raw(capsys.readouterr().out)


def test_a_warning_of_mujoco_is_a_line(tmp_path):
    """Two joints about one axis: an inertia that cannot be inverted."""
    model = tmp_path / "odd.xml"
    model.write_text(
        '<mujoco><worldbody><body name="b"><joint name="j"/><joint name="k"/>'
        '<geom size="0.1" mass="1"/></body></worldbody></mujoco>'
    )
    folder = write_empty_diagnosis(tmp_path / "d", model)
    still = {"qpos0": np.zeros(2), "qvel0": np.zeros(2)}
    given = Recording.from_arrays(np.arange(5) / 10, {}, {}, **still)
    write(given, tmp_path / "in.h5")
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        arguments = ("replay", folder, tmp_path / "in.h5", "--out", tmp_path / "p.h5")
        _, err, code = _run(*arguments)
    assert code == 0 and err.count("\n") == 1
    assert err.startswith("selfheal: warning: Inertia matrix is too close to singular")


def test_a_warning_is_said_once_and_a_log_that_nobody_reads_in_a_line(capsys):
    kept = warnings.showwarning
    with say_warnings():
        warnings.simplefilter("always")
        for text in ("\x1b[31m\nfirst", "second", "second"):
            warnings.warn(text, stacklevel=1)
        record = logging.makeLogRecord(
            {"msg": "no %s", "args": ("\x1b",), "levelname": "WARNING"}
        )
        logging.lastResort.emit(record)
    assert capsys.readouterr().err.splitlines() == [
        r"selfheal: warning: no \x1b",
        r"selfheal: warning: \x1b[31m\nfirst",
        "selfheal: warning: second",
    ]
    assert warnings.showwarning is kept and logging.lastResort.formatter is None


@pytest.mark.parametrize("code, said", [(0, 1), (2, 0)])
def test_a_command_that_refuses_says_no_warning(capsys, code, said):
    with pytest.raises(SystemExit), say_warnings():
        warnings.simplefilter("default")
        warnings.warn("odd", stacklevel=1)
        sys.exit(code)
    assert capsys.readouterr().err.count("selfheal: warning: odd") == said


def test_arithmetic_warns_nobody(capsys):
    with warnings.catch_warnings():
        warnings.resetwarnings()
        with say_warnings():
            np.float64(1e308) * 10
    assert capsys.readouterr().err == ""


def test_a_worker_of_a_study_is_silent(monkeypatch):
    monkeypatch.setenv("NPROC", "")
    with warnings.catch_warnings(record=True) as heard:
        PinnedWorker().setup(None)
        warnings.warn("a thousand times", stacklevel=1)
    assert heard == []


def test_no_command_prints_by_itself():
    """Only the modules that make text printable know how to print."""
    allowed = {"_print.py", "_progress.py"}
    for path in (ROOT / "cli").glob("*.py"):
        tree = ast.parse(path.read_text())
        called = {
            ast.unparse(n.func) for n in ast.walk(tree) if isinstance(n, ast.Call)
        }
        imported = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
        uses_rich = any((name or "").startswith("rich") for name in imported)
        prints = {"print", "typer.echo", "typer.secho", "sys.stdout.write"} & called
        assert path.name in allowed or not (prints or uses_rich), path
