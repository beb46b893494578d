"""`recover`: batches that go on, and refusals before any work."""

import json

import pytest

from selfheal.recovery.recover_run import RecoverSettings
from tests.support.commands.run import refuse, run_well
from tests.support.short_recover import shorten


@pytest.fixture
def short(monkeypatch):
    """Searches of a second."""
    shorten(monkeypatch.setattr)


def test_on_the_command_line_a_batch_goes_on(short, tmp_path, monkeypatch):
    monkeypatch.setattr("selfheal.robot.scenarios.TABLE", (1, 9))
    monkeypatch.setattr(RecoverSettings, "__init__", _short_settings)
    start = "recover", "--robot", "quadruped", "--out", tmp_path
    batch = json.loads(run_well(*start, "--json", "--method", "as-described"))
    assert [r["scenario"] for r in batch["runs"]] == [1, 9]
    assert (tmp_path / "scenario-09" / "report.html").is_file()
    again = run_well("recover", "--resume", tmp_path, "--json")
    assert json.loads(again) == batch
    assert "--force" in refuse(*start)
    shown = run_well("recover", "--resume", tmp_path)
    assert "quadruped, as-described" in shown and "scenario 9" in shown


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
    assert said in refuse("recover", *(word.format(tmp=tmp_path) for word in words))
