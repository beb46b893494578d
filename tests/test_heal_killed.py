"""A heal that is killed at any moment and resumed ends as if it had not been."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
from toys_heal import identified

from selfheal.recovery.phased import load
from selfheal.recovery.record import HealRun

# `selfheal` with a small catalogue, killed at a moment that its first argument names:
# when a phase has just been saved, or when its file is written and has no name yet
CHILD = """
import os, signal, sys
import numpy as np
from toys_heal import shorten
from selfheal.cli import app
from selfheal.recovery import hypotheses, phased
from selfheal.report import heal as page

moment, _, phase = sys.argv[1].partition(" ")
save = phased.save

def die(*args):
    os.kill(os.getpid(), signal.SIGKILL)

def killed(run, path):
    reached = phase in run.phases and not run.result
    if reached and moment == "within":
        os.replace = die
    save(run, path)
    if reached:
        die()

shorten(setattr)
phased.save = killed
hypotheses._SCALES = (0.1, 0.5)
hypotheses._JAMS, hypotheses._AZIMUTHS = np.zeros(1), np.zeros(1)
hypotheses._STRENGTHS = hypotheses._FRICTIONS = (0.3,)
page.film = lambda *args, **more: ""
app(sys.argv[2:])
"""


def _selfheal(moment, *words):
    command = [sys.executable, "-c", CHILD, moment, *map(str, words)]
    here = Path(__file__).parent  # of toys_heal
    return subprocess.run(command, capture_output=True, text=True, cwd=here)


def _told(path):
    """All that a heal's file says but how long it took."""
    run = load(path, HealRun)
    phases = [(name, {**what, "seconds": 0}) for name, what in run.phases.items()]
    result = {**run.result, "seconds": 0}
    return json.dumps([phases, result], default=np.ndarray.tolist)


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
        assert list(load(file, HealRun).phases) == kept
        words = "heal", "--resume", file
    ended = _selfheal("never", *words, "--json")
    assert ended.returncode == 0, ended.stderr
    assert _told(file) == _told(tmp_path / "whole" / "heal.h5")
    printed = (json.loads(made.stdout) for made in (ended, whole))
    assert len({json.dumps({**told, "seconds": 0}) for told in printed}) == 1
