"""Studies on real workers that die, clients that die, a real SLURM, and bad input."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import pytest

from selfheal.study.store import find_journal, load_study
from tests.support.commands.run import run
from tests.support.paths import ROOT
from tests.support.toy_study import selfheal

# killed when so many records are kept: after a chunk, within one (half a line is
# written), when the file is written and has no name yet, and when the journal is in it
DIE = """
from pathlib import Path
from selfheal.study import store

moment = {moment!r}
add = store.Journal.add

def die(*args, **more):
    os.kill(os.getpid(), 9)

def killed(journal, records):
    for record in records:  # a chunk each, however they came
        if moment == "within":
            whole = __import__("json").dumps(record)
            os.write(journal._file, whole[: len(whole) // 2].encode())
            die()
        add(journal, [record])
        if moment == "after":
            die()

store.Journal.add = killed
if moment == "unnamed":
    replace, os.replace = os.replace, lambda *names: (
        die() if Path("{folder}/study.h5.journal").exists() else replace(*names))
if moment == "merged":
    unlink, Path.unlink = Path.unlink, lambda path, **more: (
        die() if path.name.endswith(".journal") else unlink(path, **more))
"""

# after the first run a terminal's Ctrl-C, which all of its processes hear, also where
# the tests were started in the background and hear none
INTERRUPT = """
import signal
from selfheal.study import store

signal.signal(signal.SIGINT, signal.default_int_handler)
os.setsid()
add = store.Journal.add

def interrupted(journal, records):
    add(journal, records[:1])
    os.killpg(0, 2)

store.Journal.add = interrupted
"""

# Kill the worker whose first result has come, before the result is read
LOSE = """
from distributed import as_completed, default_client

batches = as_completed.batches

def late(done):
    batch = next(waiting := batches(done))
    future, _ = batch[0]
    default_client().run(os._exit, 1, on_error="ignore")
    while future.status == "finished":
        pass
    print("its future is", future.status)
    yield batch
    yield from waiting

as_completed.batches = late
"""


def _values(folder):
    """The outcome of each run of a study, once all of it is in one file."""
    file = folder / "study.h5"
    assert not find_journal(file).exists()
    with h5py.File(file) as kept:
        records = [json.loads(text) for text in kept["records"].asstr()[()]]
    return [(r["key"], r["outcome"], r["error"].split("\n")[-1]) for r in records]


@pytest.fixture(scope="module")
def calm(tmp_path_factory):
    """A study of 16 runs that nobody disturbed."""
    folder = tmp_path_factory.mktemp("calm")
    ended = selfheal("study", "toy", "--runs", 16, "--workers", 1, "--out", folder)
    assert ended.returncode == 0, ended.stderr
    return folder


def test_every_run_is_there_once_and_a_failing_one_with_its_error(calm):
    values = _values(calm)
    assert [key for key, *_ in values] == [f"run {k}" for k in range(16)]
    for k, (_, outcome, error) in enumerate(values):
        well = k % 5 != 4
        assert (outcome is not None) == well
        assert error == ("" if well else f"ValueError: seed {k} is not well")
    shown = selfheal("study", "show", calm / "study.h5", "--json")
    document = json.loads(shown.stdout)
    assert (document["runs"], document["done"], len(document["failed"])) == (16, 16, 3)
    assert len(document["tables"][0]["rows"]) == 13
    page = (calm / "report.html").read_text()
    assert "seed 14 is not well" in page and "Numbers" in page
    assert "| 3 | " in (calm / "report.md").read_text()


@pytest.mark.slow
def test_workers_that_are_killed_change_no_value(calm, tmp_path):
    marks = tmp_path / "marks"
    marks.mkdir()
    words = "study", "toy", "--runs", 16, "--workers", 2, "--out", tmp_path
    ended = selfheal(*words, TOY_KILL=str(marks))
    assert ended.returncode == 0, ended.stderr
    assert sorted(int(mark.name) for mark in marks.iterdir()) == [0, 9]
    assert _values(tmp_path) == _values(calm)


@pytest.mark.slow
def test_a_result_counts_though_its_worker_died_after_sending_it(calm, tmp_path):
    words = "study", "toy", "--runs", 16, "--workers", 1, "--out", tmp_path
    ended = selfheal(*words, more=LOSE)
    assert ended.returncode == 0, ended.stderr
    assert "its future is" in ended.stdout
    assert _values(tmp_path) == _values(calm)


@pytest.mark.slow
def test_a_client_killed_again_and_again_changes_no_value(calm, tmp_path):
    words = ("toy", "--runs", 16, "--out", tmp_path)
    for moment in ("after", "within", "unnamed", "merged"):
        more = DIE.format(moment=moment, folder=tmp_path)
        ended = selfheal("study", *words, "--workers", 1, more=more)
        assert ended.returncode == -signal.SIGKILL, ended.stderr
        words = "toy", "--resume", tmp_path / "study.h5"
    assert len(load_study(tmp_path / "study.h5").left) < 16
    ended = selfheal("study", *words, "--workers", 1)
    assert ended.returncode == 0, ended.stderr
    assert _values(tmp_path) == _values(calm)


@pytest.mark.slow
def test_an_interrupted_study_says_how_to_go_on(calm, tmp_path):
    words = "study", "toy", "--runs", 16, "--workers", 1, "--out", tmp_path
    ended = selfheal(*words, more=INTERRUPT)
    assert (ended.returncode, "Traceback" in ended.stderr) == (130, False), ended.stderr
    left = len(load_study(tmp_path / "study.h5").left)
    how = f"selfheal study toy --resume {tmp_path}/study.h5"
    message = f"{left} of 16 runs are left; go on with: {how}"
    assert 0 < left < 16 and message in ended.stderr
    assert message in selfheal("study", "show", tmp_path / "study.h5").stdout
    assert selfheal(*how.split()[1:], "--workers", 1).returncode == 0
    assert _values(tmp_path) == _values(calm)


@pytest.mark.slow
def test_only_failed_runs_are_done_again(calm, tmp_path):
    file = Path(shutil.copy(calm / "study.h5", tmp_path))
    before = load_study(file).records
    words = "study", "toy", "--resume", file, "--only", "failed", "--workers", 1
    assert selfheal(*words, TOY_WELL="yes").returncode == 0
    after = load_study(file)
    assert not after.failed
    same = [key for key, record in before.items() if after.records[key] == record]
    assert len(same) == 13 and len(after.records) == 16


def test_bad_input_is_refused(calm, tmp_path):
    file, study, none = calm / "study.h5", ("study", "table3"), tmp_path / "none"
    cut = tmp_path / "cut.h5"
    cut.write_bytes(file.read_bytes()[:2000])
    lines = Path(shutil.copy(file, tmp_path / "study.h5"))
    find_journal(lines).write_text("not JSON\n")
    for words, message in (
        (("study", "nosuch"), "No such command 'nosuch'"),
        ((*study, "--runs", 0, "--out", tmp_path / "new"), "runs must be positive"),
        ((*study, "--workers", 0), "workers must be positive"),
        ((*study, "--cluster", "cray"), "valid: lsf, pbs, sge, slurm"),
        ((*study, "--cluster", "slurm"), "--cluster needs --workers N"),
        ((*study, "--scheduler", "tcp://a:1", "--workers", 2), "leave out"),
        ((*study, "--only", "failed"), "goes with --resume"),
        ((*study, "--resume", file, "--runs", 3), "leave out --runs"),
        ((*study, tmp_path), "has no use for"),
        (("study", "diagnose", none), "no such folder"),
        (("study", "diagnose"), "needs a FOLDER"),
        ((*study, "--recordings", none), "no such folder"),
        ((*study, "--out", calm), "study.h5 is there already"),
        ((*study, "--resume", file), "is of study 'toy'"),
        (("study", "show", none), "no such run file"),
        (("study", "show", cut), "truncated"),
        (("study", "show", lines), "damaged journal"),
    ):
        ended = run(*words)
        assert ended.exit_code == 2 and message in ended.output, ended.output
        assert "Traceback" not in ended.output


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_said_in_time(tmp_path):
    words = ("study", "toy", "--runs", 1, "--scheduler", "tcp://127.0.0.1:9")
    timeout = {"DASK_DISTRIBUTED__COMM__TIMEOUTS__CONNECT": "1s"}
    ended = selfheal(*words, "--out", tmp_path, **timeout)
    assert ended.returncode == 2 and "no Dask scheduler answers" in ended.stderr


@pytest.fixture
def scheduler():
    """Address of a Dask cluster that somebody else started."""
    code = (
        "from distributed import LocalCluster\n"
        "if __name__ == '__main__':\n"
        "    made = LocalCluster(n_workers=1, threads_per_worker=1, host='127.0.0.1',\n"
        "                        dashboard_address=':0')\n"
        "    print(made.scheduler_address, flush=True)\n"
        "    input()\n"
    )
    ends = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, **ends) as cluster:
        yield cluster.stdout.readline().strip()
        cluster.communicate("\n")


@pytest.mark.slow
def test_a_cluster_that_is_there_already_does_the_same(calm, tmp_path, scheduler):
    words = "study", "toy", "--runs", 16, "--scheduler", scheduler
    ended = selfheal(*words, "--out", tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert _values(tmp_path) == _values(calm)


@pytest.fixture
def slurm(tmp_path):
    """A SLURM of this machine alone; its configuration file."""
    needed = ("slurmctld", "slurmd", "sbatch", "munged")
    if missing := [tool for tool in needed if not shutil.which(tool)]:
        pytest.skip(f"no {', '.join(missing)}: apt-get install slurm-wlm munge")
    if os.geteuid():
        pytest.skip("SLURM's daemons need root")
    folder = tmp_path / "slurm"
    script = ROOT / "tests" / "study" / "slurm.sh"
    command = [script, "start", folder]
    started = subprocess.run(command, capture_output=True, text=True, check=False)
    if started.returncode:
        pytest.skip(f"SLURM does not start here: {started.stderr[-500:]}")
    yield folder / "slurm.conf"
    subprocess.run([script, "stop", folder], check=True)


@pytest.mark.slow
def test_a_slurm_job_that_is_cancelled_is_replaced(calm, tmp_path, slurm):
    marks = tmp_path / "marks"
    marks.mkdir()
    (marks / "9").touch()  # one job is enough
    words = "study", "toy", "--runs", 16, "--cluster", "slurm", "--workers", 2
    ended = selfheal(
        *words,
        "--out",
        tmp_path,
        TOY_KILL=str(marks),
        SLURM_CONF=str(slurm),
        PYTHONPATH=str(ROOT),
    )
    assert ended.returncode == 0, ended.stderr
    assert (marks / "0").exists()
    assert _values(tmp_path) == _values(calm)
    assert list((tmp_path / "jobs").iterdir())
