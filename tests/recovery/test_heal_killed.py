"""A heal that is killed at any moment and resumed ends as if it had not been."""

import json
import signal
from functools import partial

import pytest

from selfheal.recovery.phased_run import load_phased_run
from selfheal.recovery.record import HealRun
from tests.support.killed_process import read_run, selfheal
from tests.support.short_heal import identified

BEFORE = """
from tests.support.killed_process import replace_attribute
from tests.support.short_heal import shorten

shorten(replace_attribute)
"""
_selfheal = partial(selfheal, BEFORE)


@pytest.mark.slow
def test_a_heal_killed_again_and_again_ends_as_one_that_was_not(tmp_path):
    run, _ = identified(tmp_path)
    start = "heal", run, "--damage", "dead:left_hip_position"
    whole = _selfheal("never", *start, "--out", tmp_path / "whole", "--json")
    assert whole.returncode == 0, whole.stderr

    file = tmp_path / "killed" / "heal.h5"
    words = *start, "--out", file.parent
    for moment, kept in (
        ("within whole", ["gait"]),
        ("after alarm", ["gait", "whole", "alarm"]),
        ("within verdict", ["gait", "whole", "alarm", "ask-01", "ask-02"]),
    ):
        killed = _selfheal(moment, *words)
        assert killed.returncode == -signal.SIGKILL, killed.stderr
        assert list(load_phased_run(file, HealRun).phases) == kept
        words = "heal", "--resume", file
    ended = _selfheal("never", *words, "--json")
    assert ended.returncode == 0, ended.stderr
    left = {path.name for path in file.parent.iterdir()}
    assert left == {"heal.h5", "report.html"}  # nothing of the killed ones
    assert read_run(file, HealRun) == read_run(tmp_path / "whole" / "heal.h5", HealRun)
    printed = (json.loads(made.stdout) for made in (ended, whole))
    assert len({json.dumps({**said, "seconds": 0}) for said in printed}) == 1
