"""The loop: the same seed the same run, wherever it was cut; refusals before work."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

from selfheal.cli import app
from selfheal.errors import InputError, RecordingError, RunFileError, UnknownNameError
from selfheal.files import lock_file
from selfheal.recording import Recording, write
from selfheal.robot.rest_readings import read_rest_channels
from selfheal.selfmodel.loop import check_settings, identify_body
from selfheal.selfmodel.prior import compute_prior_cost
from selfheal.selfmodel.read_run import load_run
from selfheal.selfmodel.run import Run, Settings, save_run
from selfheal.selfmodel.space import find_space
from selfheal.selfmodel.strategy import METHODS
from tests.support.stick_robot import PARTS, Toy

SMALL = Settings("toy", engine="statics", cycles=3, budget=1500)
TIMES = ("seconds",)  # the only thing that may differ between two equal runs


def _same(one, other, where: str = "run") -> None:
    """Two runs, or parts of runs, are equal in everything but the time they took."""
    if is_dataclass(one):
        names = [f.name for f in fields(one) if f.name not in TIMES]
        one, other = ({n: getattr(x, n) for n in names} for x in (one, other))
    if isinstance(one, Mapping):
        assert one.keys() == other.keys(), where
        for name in one:
            _same(one[name], other[name], f"{where}.{name}")
    elif isinstance(one, tuple | list):
        assert len(one) == len(other), where
        for k, pair in enumerate(zip(one, other, strict=True)):
            _same(*pair, f"{where}[{k}]")
    else:
        np.testing.assert_array_equal(one, other, err_msg=where)


def _last(settings: Settings, run: Run | None = None) -> Run:
    *_, last = identify_body(Toy(), settings, run=run)
    return last


def test_another_seed_gives_another_run():
    first, second = (_last(replace(SMALL, seed=seed)) for seed in (0, 1))
    assert first.state["random"] != second.state["random"]


@pytest.mark.parametrize(
    "method",
    [
        m if m in ("default", "paper") else pytest.param(m, marks=pytest.mark.slow)
        for m in METHODS
    ],
)
def test_a_run_cut_after_any_cycle_goes_on_to_the_same_end(method, tmp_path):
    """Cut before the first one it is the same run again: the same seed, the same."""
    settings = replace(SMALL, method=method)
    *parts, whole = identify_body(Toy(), settings)
    assert [len(part.cycles) for part in parts] == [1, 2, 3]
    for part in (
        Run(settings, Toy().anatomy, Toy().actions, truth=Toy().truth),
        *parts,
    ):
        save_run(part, tmp_path / "run.h5")
        _same(_last(settings, load_run(tmp_path / "run.h5")), whole)


def test_where_hinges_are_unknown_the_search_waits_for_the_last_readings():
    early = {}
    for space in ("sides", "full"):
        run = _last(replace(SMALL, space=space, cycles=4, budget=8000))
        early[space] = run.cycles[-2].spent / run.cycles[-1].spent
    assert early["full"] < 0.2 and early["sides"] > 0.3


@pytest.mark.slow
def test_a_run_with_every_simulation_on_mjx():
    run = _last(replace(SMALL, engine="mjx", cycles=2, budget=200))
    assert run.counts["mjx"] >= 200 and "statics" not in run.counts
    assert np.isfinite(run.cycles[-1].losses[0])


@pytest.mark.parametrize(
    "change",
    [
        {"space": "sides"},
        {"space": "full"},
        pytest.param({"engine": "auto", "cycles": 2}, marks=pytest.mark.slow),
    ],
)
def test_a_cut_run_goes_on_in_every_space_and_where_mjx_confirms_it(change, tmp_path):
    settings = replace(SMALL, budget=600, **change)
    first, *_, whole = identify_body(Toy(), settings)
    save_run(first, tmp_path / "run.h5")
    _same(_last(settings, load_run(tmp_path / "run.h5")), whole)
    if settings.engine == "auto":
        assert whole.counts["mjx"] > first.counts["mjx"] > 0


def test_a_finished_run_stays_as_it_is():
    whole, toy = _last(SMALL), Toy()
    (again,) = identify_body(toy, SMALL, run=whole)
    assert again is whole and toy.acts == 0


def test_what_a_run_says_is_what_it_did():
    toy, progress = Toy(), []
    runs = list(identify_body(toy, SMALL, progress=progress.append))
    cycles, result = runs[-1].cycles, runs[-1].result
    assert toy.acts == len(cycles) == SMALL.cycles
    tried = [cycle.action for cycle in cycles]
    assert len(set(tried)) == len(tried)
    down = [np.flatnonzero(toy.actions[a] < 0).tolist() for a in tried]
    assert result["actions"] == down
    assert (np.diff([cycle.spent for cycle in cycles]) > 0).all()
    assert cycles[-1].spent == runs[-1].counts["statics"] == progress[-1]
    assert runs[-1].counts["mujoco"] == len(toy.actions)
    for cycle in cycles:
        costs = cycle.losses + compute_prior_cost(
            toy.anatomy, find_space("free"), cycle.genomes
        )
        assert (np.diff(costs) >= -1e-12).all()
        assert ((cycle.sureness >= 0) & (cycle.sureness <= 1)).all()
        np.testing.assert_allclose(
            cycle.felt, read_rest_channels(toy.act(cycle.action), toy.anatomy)
        )


def test_the_stick_robot_is_identified():
    result = _last(replace(SMALL, cycles=6, budget=8000)).result
    assert result["parent"] == Toy().truth.parent[0].tolist()
    assert result["length"] == pytest.approx(Toy().anatomy.length)
    assert result["tilt_error"] < 1


@pytest.mark.parametrize(
    "change, kind, text",
    [
        ({"cycles": 0}, InputError, "cycles must be 1 to 10"),
        ({"cycles": 11}, InputError, "cycles must be 1 to 10"),
        ({"budget": 0}, InputError, "budget must be positive"),
        ({"budget": -5}, InputError, "budget must be positive; not -5"),
        ({"seed": -1}, InputError, "seed must not be negative"),
        ({"method": "luck"}, UnknownNameError, "'luck'; valid: default, disagreement"),
        ({"space": "any"}, UnknownNameError, "'any'; valid: free, full, sides"),
        ({"engine": "ode"}, UnknownNameError, "'ode'; valid: auto, mjx, mujoco, sta"),
        ({"method": "paper", "space": "full"}, InputError, "only the space 'free'"),
        ({"known_lengths": True}, InputError, "go with space 'full'; in 'free' they"),
        ({"method": "paper", "random_actions": True}, InputError, "not 'paper'"),
    ],
)
def test_settings_without_sense_are_refused_before_any_work(change, kind, text):
    toy = Toy()
    settings = replace(SMALL, **change)
    with pytest.raises(kind, match=text):
        check_settings(settings, toy)
    with pytest.raises(kind, match=text):
        next(identify_body(toy, settings))
    assert toy.acts == 0


def test_a_recording_without_tilts_is_refused():
    recording = Toy().act(0)
    (episode,) = recording.episodes.values()
    vertical = episode.signals["vertical"]
    for values in (None, np.full((1, 3), np.nan), np.ones((1, 2))):
        signals = dict(episode.signals)
        if values is None:
            del signals["vertical"]
        else:
            signals["vertical"] = replace(vertical, values=values)
        bad = Recording({"only": replace(episode, signals=signals)}, file="bad.h5")
        with pytest.raises(RecordingError, match=r"bad\.h5, episode 'only'.*vertical"):
            read_rest_channels(bad, Toy().anatomy)


def test_a_recording_without_clearance_says_nothing_of_it():
    whole = Toy().act(3)
    bare = Toy().act(3)
    del bare.episodes["only"].signals["clearance"]
    bare, whole = (read_rest_channels(r, Toy().anatomy) for r in (bare, whole))
    assert np.isnan(bare[2])
    np.testing.assert_array_equal(bare[:2], whole[:2])


class Changed(Toy):
    """The toy after somebody swapped two of its actions."""

    @property
    def actions(self):
        return super().actions[::-1]


def test_a_run_does_not_go_on_with_another_robot():
    first = next(identify_body(Toy(), SMALL))
    with pytest.raises(InputError, match="'toy' has other parts or actions"):
        next(identify_body(Changed(), SMALL, run=first))


class Moody(Toy):
    """A robot that says it answers from a file, and answers otherwise now."""

    def act(self, action):
        recording = super().act(action)
        recording.episodes["only"].signals["vertical"].values[:] = 0.5
        return recording


def test_a_run_does_not_go_on_with_other_readings():
    settings = replace(SMALL, recordings="toy.h5")
    first = next(identify_body(Toy(), settings))
    with pytest.raises(InputError, match=r"toy\.h5 answers otherwise.*cycle 1"):
        next(identify_body(Moody(), settings, run=first))


@pytest.fixture
def run_file(tmp_path):
    """A run of the toy after one cycle."""
    save_run(next(identify_body(Toy(), SMALL)), tmp_path / "run.h5")
    return tmp_path / "run.h5"


def test_a_run_on_disk_is_the_run(run_file):
    run = next(identify_body(Toy(), SMALL))
    run = replace(run, anatomy=replace(run.anatomy, name="[1, 2]"))
    save_run(run, run_file)
    back = load_run(run_file)
    _same(back, replace(run, truth=back.truth))
    _same(back.truth, replace(run.truth, anatomy=run.anatomy))


def _set_version(file: Path) -> None:
    with h5py.File(file, "r+") as members:
        members.attrs["version"] = 99


def _delete(name: str) -> Callable[[Path], None]:
    def spoil(file: Path) -> None:
        with h5py.File(file, "r+") as members:
            del members[name]

    return spoil


@pytest.mark.parametrize(
    "spoil, said",
    [
        (lambda file: file.write_text("none"), "truncated, or not an HDF5 file"),
        (lambda file: file.write_bytes(file.read_bytes()[:-100]), "truncated"),
        (lambda file: file.write_bytes(file.read_bytes()[:1000]), "truncated"),
        (lambda file: write(Toy().act(0), file), "'selfheal-recording', not a run"),
        (_set_version, "version 99; this program reads version 3"),
        (_delete("cycles/000/genomes"), "damaged"),
        (_delete("actions"), "damaged"),
        (_delete("anatomy/mass"), "damaged"),
    ],
)
def test_what_is_no_whole_run_is_refused(run_file, spoil, said):
    spoil(run_file)
    with pytest.raises(RunFileError, match=said):
        load_run(run_file)


HOLD = """
import sys, h5py
with h5py.File(sys.argv[1], "r+"):
    print("ready", flush=True)
    sys.stdin.read()
"""


def test_a_run_that_another_process_writes_is_refused(run_file):
    pipe, command = subprocess.PIPE, [sys.executable, "-c", HOLD, str(run_file)]
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout.readline() == "ready\n"
        with pytest.raises(RunFileError, match="another process holds it open"):
            load_run(run_file)
        other.communicate()


def test_a_lock_of_a_killed_process_is_no_lock(run_file):
    lock = run_file.with_name("run.h5.lock")
    lock.touch()
    with lock_file(run_file):
        assert lock.exists()
    assert not lock.exists()


def test_a_run_is_not_held_where_nothing_can_be_written(tmp_path):
    path = tmp_path / "nowhere" / "run.h5"
    with pytest.raises(RunFileError, match="cannot write beside"), lock_file(path):
        pass


OPTIONS = ["--robot", "starfish", "--engine", "statics", "--cycles", "5"]
OPTIONS += ["--budget", "4000", "--seed", "3"]


def _identify(*arguments) -> dict:
    result = CliRunner().invoke(app, ["identify", "--json", *map(str, arguments)])
    assert result.exit_code == 0, result.stderr
    told = json.loads(result.stdout)
    return {k: v for k, v in told.items() if k not in ("seconds", "run", "model")}


@pytest.mark.slow
def test_a_killed_process_is_resumed_to_the_same_result(tmp_path):
    """`kill -9` once the first cycle is told, which is after it was saved."""
    program = [sys.executable, "-c", "from selfheal.cli import app; app()"]
    with subprocess.Popen(
        [*program, "identify", *OPTIONS, "--out", tmp_path / "a"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"TERM": "dumb"},
    ) as process:
        for line in process.stderr:
            if "Best error" in line or "disagreement" in line:
                break
        process.send_signal(signal.SIGKILL)
    stopped = load_run(tmp_path / "a" / "run.h5")
    assert stopped.cycles and not stopped.result
    resumed = _identify("--resume", tmp_path / "a" / "run.h5")
    assert resumed == _identify(*OPTIONS, "--out", tmp_path / "b")
    assert len(resumed["actions"]) == 5 and len(resumed["parent"]) == 2 * PARTS
