"""`recover`: batches that go on, and refusals before any work."""

import json

import pytest
from typer.testing import CliRunner

from selfheal.cli import app
from selfheal.recovery.recover_run import RecoverSettings
from tests.support.short_recover import shorten


@pytest.fixture
def short(monkeypatch):
    """Searches of a second."""
    shorten(monkeypatch.setattr)


def _run(*words):
    return CliRunner().invoke(app, ["recover", *(str(word) for word in words)])


def test_on_the_command_line_a_batch_goes_on(short, tmp_path, monkeypatch):
    monkeypatch.setattr("selfheal.robot.scenarios.TABLE", (1, 9))
    monkeypatch.setattr(RecoverSettings, "__init__", _short_settings)
    made = _run("--robot", "quadruped", "--out", tmp_path, "--json",
                "--method", "as-described")  # fmt: skip
    assert made.exit_code == 0, made.output
    batch = json.loads(made.stdout)
    assert [r["scenario"] for r in batch["runs"]] == [1, 9]
    assert (tmp_path / "scenario-09" / "report.html").is_file()
    again = _run("--resume", tmp_path, "--json")
    assert json.loads(again.stdout) == batch
    taken = _run("--robot", "quadruped", "--out", tmp_path)
    assert taken.exit_code == 2 and "--force" in taken.stderr
    shown = _run("--resume", tmp_path)
    assert "quadruped, as-described" in shown.stdout
    assert "scenario 9" in shown.stdout


_INIT = RecoverSettings.__init__


def _short_settings(self, *args, **more):
    _INIT(self, *args, **{**more, "generations": 2, "trials": 1})


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "--resume RECOVER.h5"),
        (("--robot", "tripod"), "hexapod, quadruped"),
        (("--robot", "quadruped", "--scenario", "16"), "1 to 15"),
        (("--robot", "quadruped", "--scenario", "some"), "'all'"),
        (("--robot", "quadruped", "--method", "luck"), "as-described"),
        (("--robot", "quadruped", "--range", "60"), "30 or 45"),
        (("--robot", "quadruped", "--gap", "2"), "gap"),
        (("--robot", "quadruped", "--seed", "-1"), "negative"),
        (("--resume", "{tmp}/nothing.h5"), "no such run file"),
        (("--resume", "{tmp}"), "no recover.h5"),
        (("--resume", "{tmp}/nothing.h5", "--seed", "1"), "leave out --seed"),
    ],
)
def test_what_makes_no_sense_is_refused(words, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = _run(*(word.format(tmp=tmp_path) for word in words))
    assert made.exit_code == 2
    assert said in made.stderr and "Traceback" not in made.stderr
