"""`selfheal recording export`: a file for another program, or one message."""

import json
from functools import partial

import numpy as np
import pandas as pd
import pytest

from selfheal.recording import Recording
from tests.support.commands.run import refuse, run_well
from tests.support.diagnosis_folder import write_empty_diagnosis

HINGE = """<mujoco><worldbody><body><joint name="hinge" damping="0.1"/>
<geom size="0.1" pos="0 0 1" mass="1"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A folder with a recording, a model, and a diagnosis that found nothing."""
    monkeypatch.chdir(tmp_path)
    time = np.arange(0, 1, 0.01)
    made = Recording.from_arrays(
        time,
        {"motor": np.sin(9 * time)},
        {"joint_position": {"hinge": 0 * time}},
        qpos0=[0.2],
        qvel0=[0.0],
    )
    made.write("log.h5")
    (tmp_path / "model.xml").write_text(HINGE)
    write_empty_diagnosis(tmp_path / "diagnosis", tmp_path / "model.xml")
    return tmp_path


_export = partial(run_well, "recording", "export")


def test_a_file_has_the_recording_s_name_and_is_not_overwritten(home):
    assert _export("log.h5", "--to", "csv") == "log.csv: 1 episode\n"
    before = (home / "log.csv").read_bytes()
    again = "recording", "export", "log.h5", "--to", "csv"
    assert "--force replaces it" in refuse(*again)
    run_well(*again, "--force")
    assert (home / "log.csv").read_bytes() == before


def test_predictions_stand_beside_readings(home):
    words = "--to parquet --diagnosis diagnosis --out both.parquet --json"
    told = json.loads(_export("log.h5", *words.split()))
    assert (told["exported"], told["episodes"]) == ("both.parquet", 1)
    run_well("replay", "diagnosis", "log.h5")
    _export("predicted.h5", "--to", "parquet", "--out", "replayed.parquet")
    both, alone = pd.read_parquet("both.parquet"), pd.read_parquet("replayed.parquet")
    column = "hinge_position"
    np.testing.assert_array_equal(
        both[f"predicted/{column}"], alone[f"signals/{column}"]
    )
    assert both[f"predicted/{column}"].std() > 0.1
    assert (both[f"signals/{column}"] == 0).all()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("log.h5 --to xlsx", "valid: csv, mcap, parquet, rrd"),
        ("none.h5 --to csv", "none.h5"),
        ("log.h5 --to csv --out log.h5 --force", "would overwrite what it"),
        ("log.h5 --to csv --out missing/x.csv", "missing/x.csv"),
        ("log.h5 --to csv --diagnosis .", "diagnosis"),
    ],
)
def test_what_does_not_fit_is_refused_and_leaves_nothing(home, words, said):
    before = sorted(home.rglob("*"))
    assert said in refuse("recording", "export", *words.split())
    assert sorted(home.rglob("*")) == before
