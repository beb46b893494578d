"""`selfheal.identify(moves=N)`: moves are made once, diagnosed, and told."""

import json
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import selfheal
from selfheal.api import diagnosis
from selfheal.errors import InputError
from selfheal.mjcf.edit import Set
from selfheal.recording import read
from selfheal.robot.open_robot import open_robot
from selfheal.selfmodel.read_run import load_run
from tests.support.paths import ROOT

SMALL = {"engine": "statics", "cycles": 1, "budget": 300, "seed": 5}
DOCUMENT = {
    "verdict": "explained",
    "fit": {"given": 0.2, "patched": 0.1, "floor": 0.05},
}
EDITS = [Set("joint", "left_hip", {"damping": "0.5"})]


class _Diagnosed:
    """Stands for a diagnosis: what was asked, and an answer."""

    def __init__(self, fails: int = 0) -> None:
        self.asked: list[tuple] = []
        self.fails = fails

    def __call__(self, model, recording, **more):
        self.asked.append((model, recording))
        if len(self.asked) <= self.fails:
            raise KeyboardInterrupt
        said = json.dumps({"format": "selfheal-diagnosis", "version": 1, **DOCUMENT})

        def save(folder, force):
            folder.mkdir()
            (folder / "diagnosis.json").write_text(said)

        return SimpleNamespace(document=DOCUMENT, edits=EDITS, save=save)


@pytest.fixture
def diagnosed(monkeypatch):
    """The stand-in of `selfheal.diagnose`."""
    stand_in = _Diagnosed()
    monkeypatch.setattr(diagnosis, "diagnose", stand_in)
    return stand_in


def test_moves_are_diagnosed_and_the_body_gets_what_was_found(diagnosed, tmp_path):
    run = selfheal.identify("starfish", **SMALL, moves=2, out=tmp_path)
    told = run.result["dynamics"]
    ((model, recording),) = diagnosed.asked
    assert list(recording.episodes) == ["move-1", "move-2"]
    files = {p.name for p in tmp_path.iterdir()}
    assert {"moves.h5", "dynamics", "dynamics.xml", "best.xml"} <= files
    kept = {s.kind for e in recording.episodes.values() for s in e.signals.values()}
    assert (kept == {"joint_position"}) == told["held"]
    given = mujoco.MjModel.from_xml_path(str(model))
    assert (given.nv == 8) == told["held"]
    found = mujoco.MjModel.from_xml_path(told["model"])
    assert found.nv == 14 and found.joint("left_hip").damping[0] == 0.5
    assert load_run(tmp_path / "run.h5").result == run.result
    assert "How its joints move" in (tmp_path / "report.html").read_text()


@pytest.mark.slow
def test_a_killed_run_goes_on_with_the_moves_that_were_made(diagnosed, tmp_path):
    diagnosed.fails = 1
    with pytest.raises(KeyboardInterrupt):
        selfheal.identify("starfish", **SMALL, moves=2, out=tmp_path)
    made = (tmp_path / "moves.h5").read_bytes()
    assert "How its joints move" not in (tmp_path / "report.html").read_text()
    run = selfheal.identify(resume=tmp_path / "run.h5")
    assert (tmp_path / "moves.h5").read_bytes() == made
    first, again = (asked[1].episodes["move-1"] for asked in diagnosed.asked)
    np.testing.assert_array_equal(first.ctrl, again.ctrl)
    assert run.result["dynamics"]["verdict"] == "explained"
    assert selfheal.identify(resume=tmp_path / "run.h5").result == run.result
    assert len(diagnosed.asked) == 2


def test_a_robot_that_slides_is_diagnosed_with_its_floor(
    diagnosed, tmp_path, monkeypatch
):
    monkeypatch.setattr("selfheal.gait.excitation.STILL", 1e-9)
    run = selfheal.identify("starfish", **SMALL, moves=1, out=tmp_path)
    assert not run.result["dynamics"]["held"]
    ((model, recording),) = diagnosed.asked
    assert model == tmp_path / "best.xml"
    (episode,) = recording.episodes.values()
    assert "torso_position" in episode.signals
    assert not [name for name in episode.signals if name.endswith("_touch")]
    assert len(read(tmp_path / "moves.h5").episodes["move-1"].signals) > len(
        episode.signals
    )


ARM = str(ROOT / "models" / "described" / "arm.toml")


@pytest.mark.parametrize(
    ("robot", "more", "said"),
    [
        ("starfish", {"moves": -1}, "moves must be 0 to 100; not -1"),
        ("starfish", {"moves": 101}, "moves must be 0 to 100; not 101"),
        ("starfish", {"moves": 4, "out": None}, "need a folder"),
        (ARM, {"moves": 4, "engine": "statics"}, "is bolted down"),
    ],
)
def test_moves_that_cannot_be_made_are_refused_before_anything(
    robot, more, said, tmp_path
):
    options = {"cycles": 1, "budget": 300, "out": tmp_path / "none", **more}
    with pytest.raises(InputError, match=said):
        selfheal.identify(robot, **options)
    assert not (tmp_path / "none" / "run.h5").exists()


def test_a_robot_that_only_takes_poses_is_refused(tmp_path):
    robot = open_robot("starfish", seed=5)
    posing = SimpleNamespace(
        name="posing",
        anatomy=robot.anatomy,
        actions=robot.actions,
        truth=None,
        act=robot.act,
    )
    with pytest.raises(InputError, match=r"'posing' takes poses.*follow\(\)"):
        selfheal.identify(posing, **SMALL, moves=1, out=tmp_path / "none")
