"""A batch of recoveries that is killed at any moment and resumed ends as if not."""

import json
import signal
from functools import partial

import pytest

from selfheal.recovery.phased_run import load_phased_run
from selfheal.recovery.recover_run import RecoverRun
from tests.support.killed_process import read_run, selfheal

# two scenarios, two generations, one trial
BEFORE = """
from tests.support.killed_process import replace_attribute
from tests.support.short_recover import shorten
from selfheal.recovery.recover_run import RecoverSettings
from selfheal.robot import scenarios

shorten(replace_attribute)
replace_attribute(scenarios, "TABLE", (1, 9))
made = RecoverSettings.__init__
RecoverSettings.__init__ = lambda self, *args, **more: made(
    self, *args, **{**more, "generations": 2, "trials": 1})
"""
_selfheal = partial(selfheal, BEFORE)
FIRST, SECOND = "scenario-01/recover.h5", "scenario-09/recover.h5"


@pytest.mark.slow
def test_a_batch_killed_again_and_again_ends_as_one_that_was_not(tmp_path):
    start = "recover", "--robot", "quadruped"
    whole_place = tmp_path / "whole"
    whole = _selfheal("never", *start, "--out", whole_place, "--json")
    assert whole.returncode == 0, whole.stderr

    place = tmp_path / "killed"
    words = *start, "--out", place
    for moment, kept in (
        ("within failure", ["original"]),
        ("after estimate-1", ["original", "failure", "estimate-1"]),
        ("within trial-1", ["original", "failure", "estimate-1", "explore-1"]),
    ):
        killed = _selfheal(moment, *words)
        assert killed.returncode == -signal.SIGKILL, killed.stderr
        assert list(load_phased_run(place / FIRST, RecoverRun).phases) == kept
        assert not load_phased_run(place / SECOND, RecoverRun).phases
        words = "recover", "--resume", place
    ended = _selfheal("never", *words, "--json")
    assert ended.returncode == 0, ended.stderr
    for file in (FIRST, SECOND):
        ends = [read_run(folder / file, RecoverRun) for folder in (place, whole_place)]
        assert ends[0] == ends[1]
    runs = [json.loads(made.stdout)["runs"] for made in (ended, whole)]
    assert len(runs[0]) == 2
    for run in (*runs[0], *runs[1]):
        del run["seconds"], run["run"]
    assert runs[0] == runs[1]
