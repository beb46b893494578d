"""A study that takes no time, its command, and a process that runs it."""

import hashlib
import os
import signal
import subprocess
import sys
from pathlib import Path

from selfheal.study.plan import Study, Table, Task
from tests.support.paths import ROOT

# `selfheal` that knows the study too
CHILD = """
import os, sys
import tests.support.toy_study
from selfheal.cli import app, study
from selfheal.study import plan

plan.STUDIES["toy"] = "tests.support.toy_study"
study._add_command("toy", "A study that takes no time.")
{more}
app(sys.argv[1:])
"""


def play(settings):
    """A number that hangs on the seed alone; some runs fail, some kill their worker."""
    seed = settings["seed"]
    if (mark := os.environ.get("TOY_KILL")) and seed % 9 == 0:
        # the first run of such a seed takes its worker with it, or its whole job
        file = Path(mark) / str(seed)
        if not file.exists():
            file.touch()
            if job := os.environ.get("SLURM_JOB_ID"):
                subprocess.run(["scancel", job], check=True)
                signal.pause()
            os.kill(os.getpid(), signal.SIGKILL)
    if seed % 5 == 4 and not os.environ.get("TOY_WELL"):
        raise ValueError(f"seed {seed} is not well")
    digest = hashlib.sha256(str(seed).encode()).hexdigest()
    return {"number": int(digest[:6], 16)}


def _tables(records):
    rows = [(str(r["settings"]["seed"]), str(r["outcome"]["number"])) for r in records]
    return [Table("Numbers", "One a seed.", ("seed", "number"), rows)]


STUDY = Study(
    about="A study that takes no time.",
    list_tasks=lambda asked: [Task(f"run {k}", {"seed": k}) for k in asked.seeds],
    run_task=play,
    make_tables=_tables,
)


def selfheal(*words, more="", **environment):
    """Run `selfheal` to its end."""
    command = [sys.executable, "-c", CHILD.format(more=more), *map(str, words)]
    return subprocess.run(
        command,
        check=False,
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={**os.environ, **environment},
    )
