"""Runs with a member replaced are refused by one error that names it, or read."""

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from selfheal import files
from selfheal.errors import RunFileError
from selfheal.recovery.phased_run import load_phased_run, save_phased_run
from selfheal.recovery.recover import recover_robot
from selfheal.recovery.recover_run import RecoverRun, RecoverSettings
from selfheal.report.identify import make_identify_page
from selfheal.robot.simulated_legs import SimulatedLegs
from selfheal.schema import ArraySchema
from selfheal.selfmodel.loop import identify_body
from selfheal.selfmodel.read_run import load_run
from selfheal.selfmodel.run import Settings, save_run
from tests.support import short_recover
from tests.support.browser import draw_nothing
from tests.support.damaged.members import NEVER_FIT, find_faults, replace_member
from tests.support.short_recover import LOWER
from tests.support.stick_robot import Toy

SMALL = Settings("toy", engine="statics", cycles=2, budget=40)


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    """Files are not read on trial by another process, which takes time."""
    monkeypatch.setattr(files, "explain_dangerous", lambda *what: "")


@pytest.fixture(scope="module")
def identified(tmp_path_factory) -> Path:
    """A run after its first cycle, which has a state to go on from."""
    path = tmp_path_factory.mktemp("run") / "run.h5"
    save_run(next(identify_body(Toy(), SMALL)), path)
    return path


@pytest.fixture(scope="module")
def recovered(tmp_path_factory) -> Path:
    """A recovery that is finished."""
    path = tmp_path_factory.mktemp("recovery") / "recover.h5"
    settings = RecoverSettings(
        "quadruped", 1, (LOWER,), seed=2, generations=2, trials=1
    )
    with pytest.MonkeyPatch.context() as patch:
        short_recover.shorten(patch.setattr)
        *_, run = recover_robot(SimulatedLegs(settings.legged_robot, 2), settings)
    save_phased_run(run, path)
    return path


def _load_run(path: Path, member: str) -> None:
    run = load_run(path)
    if member.startswith("state/"):
        next(identify_body(Toy(), run.settings, run=run))


def _load_recovery(path: Path, member: str) -> None:
    load_phased_run(path, RecoverRun)


@pytest.mark.parametrize(
    "kind, read",
    [
        pytest.param("identified", _load_run, marks=pytest.mark.slow),
        ("recovered", _load_recovery),
    ],
)
def test_a_run_with_a_member_replaced_is_refused_or_gone_on_from(kind, read, request):
    faults, passed = find_faults(request.getfixturevalue(kind), read)
    assert not faults
    assert passed and not {each for each in passed if each[1] in NEVER_FIT}


MISFITS: list[tuple[str, object, str]] = [
    ("@result", "null", "attribute result is None; would fit: an object"),
    (
        "@settings",
        '{"robot": "toy", "cycles": 2.5}',
        r"settings\.cycles is 2\.5; would fit: a valid integer",
    ),
    ("@counts", "{}", "counts is without choice, failed, statics"),
    ("actions", np.zeros((6, 3)), r"actions is of shape \(6, 3\); .*\(A.*, P = 4\)"),
    ("cycles/000/felt", np.full(3, 1e300), r"felt is 1e\+300 somewhere"),
    ("anatomy/joints", '["a"]', "joints is of 1 names; would fit: 4, one each part"),
    ("anatomy/mass", np.zeros(4), "mass is 0 somewhere; would fit: .*from 1e-09"),
    ("cycles/000/action", 99, "action is 99; would fit: 0 to"),
    ("cycles/000/losses", np.zeros(1), r"losses is of shape \(1,\); .*\(K = "),
    ("cycles/000/why", 3, "why is of type int64 and shape"),
    ("state/random", "{}", "random is no state of a random generator"),
    ("state/hardness", h5py.SoftLink("/actions"), "hardness is a link to elsewhere"),
    ("state/hardness", h5py.ExternalLink("x.h5", "/x"), "is a link to elsewhere"),
]


@pytest.fixture
def run_file(identified, tmp_path) -> Path:
    """A copy of that run, to damage."""
    (tmp_path / "run.h5").write_bytes(identified.read_bytes())
    return tmp_path / "run.h5"


@pytest.mark.parametrize("member, value, said", MISFITS)
def test_the_error_says_what_would_fit(member, value, said, run_file):
    replace_member(run_file, member, value)
    with pytest.raises(RunFileError, match=rf"run.h5: a damaged run file: .*{said}"):
        load_run(run_file)


@pytest.mark.parametrize(
    "column, parent, said",
    [(0, 1, "hangs on itself"), (3, 5, "is 5 somewhere"), (2, -1, "is -1 somewhere")],
)
def test_a_part_hangs_on_the_torso_in_the_end(column, parent, said, run_file):
    with h5py.File(run_file, "r+") as file:
        file["cycles/000/genomes/parent"][0, column] = parent
    with pytest.raises(RunFileError, match=said):
        load_run(run_file)


def test_a_size_is_refused_before_any_of_it_is_read(run_file):
    with h5py.File(run_file, "r+") as file:
        del file["cycles/000/tables"]
        file.create_dataset("cycles/000/tables", (2**36, 6, 3), "f8")
    with pytest.raises(RunFileError, match="at most 200,000,000 values in the file"):
        load_run(run_file)


def test_a_run_whose_sensors_gave_nothing_is_shown(identified):
    run = load_run(identified)
    cycle, nan = run.cycles[0], np.nan
    gaps = {
        k: np.full_like(getattr(cycle, k), nan)
        for k in ("felt", "tables", "losses", "sureness")
    }
    cycle = replace(cycle, **gaps, tilt_error=nan, disagreement=nan)
    with draw_nothing():
        page = make_identify_page(replace(run, cycles=(cycle,)))
    assert "Inferred body" in page


@pytest.mark.parametrize(
    "damage",
    [
        {"kind": "gremlins"},
        {"target": "body:nose"},
        {"target": "world"},
        {"value": float("inf")},
        {"value": None},
    ],
)
def test_a_recovery_is_of_damages_that_its_robot_can_have(damage, recovered, tmp_path):
    path = tmp_path / "recover.h5"
    path.write_bytes(recovered.read_bytes())
    with h5py.File(path) as file:
        settings = json.loads(file.attrs["settings"])
    settings["damage"][0] |= damage
    replace_member(path, "@settings", json.dumps(settings))
    with pytest.raises(RunFileError, match=r"damage.* of |damage\[0\]\.value is"):
        load_phased_run(path, RecoverRun)


@pytest.mark.parametrize("dtype", ["f2", "f4", "f8"])
@pytest.mark.parametrize("value, said", [(1.0, ""), (9.0, "9 somewhere")])
def test_a_narrow_number_may_be_bound_by_a_large_one(dtype, value, said):
    kind = ArraySchema(("n",), low=2.0 if said else -1e6, high=8.0 if said else 1e6)
    assert kind.find_wrong_value(np.full(3, value, dtype)) == said
