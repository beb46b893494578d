"""`selfheal` in a process that is killed at a moment, and what its files then say."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np

from selfheal.cli import app
from selfheal.recovery import phased_run
from tests.support.paths import ROOT


def replace_attribute(module: object, name: str, value: object) -> None:
    """Set an attribute that is there; one that is not is a mistake of the test."""
    if not hasattr(module, name):
        raise AttributeError(f"{module!r} has no {name!r}")
    setattr(module, name, value)


def main(moment: str, words: list[str]) -> None:
    """Run `selfheal`, killed when a phase has been saved or while it is.

    Args:
        moment: "after PHASE", or "within PHASE": its file is written and has no name
            yet; any other is never reached.
    """
    when, _, phase = moment.partition(" ")
    save = phased_run.save_phased_run

    def die(*args: object) -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    def killed(run, path):
        reached = phase in run.phases and not run.result
        if reached and when == "within":
            os.replace = die
        save(run, path)
        if reached:
            die()

    phased_run.save_phased_run = killed
    app(words)


def selfheal(before: str, moment: str, *words: object) -> subprocess.CompletedProcess:
    """`main` in a process of its own, and what it does before, as Python."""
    code = f"import sys\nfrom tests.support import killed_process\n{before}\n"
    code += "killed_process.main(sys.argv[1], sys.argv[2:])"
    command = [sys.executable, "-c", code, moment, *map(str, words)]
    return subprocess.run(
        command, capture_output=True, text=True, cwd=ROOT, check=False
    )


def read_run(path: Path, kind: type[phased_run.PhasedRun]) -> str:
    """All that a run's file says but how long it took."""
    return format_run(phased_run.load_phased_run(path, kind))


def format_run(run: phased_run.PhasedRun) -> str:
    """All of a run but how long it took."""
    phases = [(name, {**what, "seconds": 0}) for name, what in run.phases.items()]
    result = {**run.result, "seconds": 0}
    return json.dumps([phases, result], default=np.ndarray.tolist, sort_keys=True)
