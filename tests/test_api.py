"""From Python: `selfheal.diagnose`, and what a Diagnosis is asked to do."""

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

import selfheal
from selfheal.diagnosis import diagnose as module
from selfheal.diagnosis.effects import load_catalogue
from selfheal.diagnosis.output.replay import replay_recording
from selfheal.errors import InputError, ModelError, RecordingError
from selfheal.recording import read, write
from tests.support.paths import DOCS
from tests.support.recorded_robots import ROBOTS, record

PENDULUM = ROBOTS["pendulum"]
BIAS = 0.08  # [rad]


@pytest.fixture(scope="module")
def few():
    """A catalogue of four: what MuJoCo can express, and what it cannot."""
    names = ("coulomb_friction", "sensor_bias", "sensor_gain", "joint_spring")
    small = {n: load_catalogue()[n] for n in names}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "load_catalogue", lambda: small)
        yield


def _dry(model) -> None:
    model.dof_frictionloss[0] = 0.1


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A folder with a model, which includes its robot, and a recording.

    The robot has dry friction and a sensor that is off.
    """
    folder = tmp_path_factory.mktemp("robot")
    (world,) = re.findall(r"<worldbody>.*</worldbody>", PENDULUM.xml, flags=re.S)
    (folder / "robot.xml").write_text(f"<mujoco>{world}</mujoco>")
    main = PENDULUM.xml.replace(world, '<include file="robot.xml"/>')
    (folder / "model.xml").write_text(main)
    made = record(
        PENDULUM, episodes=4, seconds=1.5, noise=4e-3, seed=3, change=_dry, finer=1
    )
    episodes = {}
    for key, episode in made.episodes.items():
        angle = episode.signals["angle"]
        signals = {"angle": replace(angle, values=angle.values + BIAS)}
        episodes[key] = replace(episode, signals=signals)
    write(replace(made, episodes=episodes), folder / "recording.h5")
    return folder


@pytest.fixture(scope="module")
def found(few, home):
    """The diagnosis of this robot; its checkpoints stay beside the folder."""
    files = home / "model.xml", home / "recording.h5"
    return selfheal.diagnose(*files, memory=home.with_name("memory"))


def test_what_is_missing_is_found(found):
    names = {f["effect"] for f in found.document["findings"]}
    assert names == {"coulomb_friction", "sensor_bias"}
    assert "Diagnosis of model.xml" in found.page


def test_a_simulation_is_the_replay_of_the_folder(found, home, tmp_path):
    found.save(tmp_path / "out")
    recording = read(home / "recording.h5")
    played = replay_recording(tmp_path / "out", recording)
    for given in (recording, home / "recording.h5"):
        told = found.simulate(given)
        for key, episode in told.episodes.items():
            other = played.episodes[key].signals["angle"].values
            np.testing.assert_array_equal(episode.signals["angle"].values, other)


def test_a_simulation_has_what_mujoco_cannot_express(found, home, tmp_path):
    """Plain MuJoCo with patched.xml is off by the bias, a simulation is not."""
    found.save(tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "patched.xml"))
    data = mujoco.MjData(model)
    told = found.simulate(home / "recording.h5").episodes["000"]
    data.qpos[:], data.qvel[:] = told.qpos0, told.qvel0
    plain = []
    for u in told.ctrl:
        plain.append(float(data.qpos[0]))
        data.ctrl[:] = u
        mujoco.mj_step(model, data, round(0.01 / model.opt.timestep))
    (bias,) = (
        f["parameters"][0]["value"]
        for f in found.document["findings"]
        if f["effect"] == "sensor_bias"
    )
    assert bias == pytest.approx(BIAS, abs=0.01)
    apart = told.signals["angle"].values - plain
    np.testing.assert_allclose(apart, bias, atol=1e-4)


def test_another_version_of_the_model_can_be_simulated(found, home):
    stiff = home / "stiff.xml"
    stiff.write_text((home / "model.xml").read_text().replace('kp="3"', 'kp="30"'))
    both = [
        found.simulate(home / "recording.h5", model=m).episodes["000"].signals["angle"]
        for m in (None, stiff)
    ]
    assert np.abs(both[0].values - both[1].values).max() > 0.05


def test_what_a_model_includes_is_found_from_any_folder(found, tmp_path):
    for folder in ("out", "a/b/out"):
        found.save(tmp_path / folder)
        path = tmp_path / folder / "patched.xml"
        model = mujoco.MjModel.from_xml_path(str(path))
        assert model.joint("hinge").frictionloss[0] > 0.05


def test_a_model_that_was_changed_since_is_not_saved(found, home, tmp_path):
    other = home / "other.xml"
    text = (home / "model.xml").read_text()
    other.write_text(text.replace('timestep="0.002"', 'timestep="0.001"'))
    with pytest.raises(InputError, match="no longer the model"):
        replace(found, model=str(other)).save(tmp_path / "out")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("page", ["quickstart.md", "../README.md"])
def test_the_examples_of_the_pages_run(
    page, found, home, tmp_path, monkeypatch, capsys
):
    """Each example resumes the finished diagnosis of the same robot."""
    for name in ("model.xml", "robot.xml", "recording.h5"):
        (tmp_path / name).write_bytes((home / name).read_bytes())
    monkeypatch.chdir(tmp_path)
    diagnose = module.diagnose

    def remembering(*args, **more):
        return diagnose(*args, **more | {"memory": home.with_name("memory")})

    monkeypatch.setattr(module, "diagnose", remembering)
    blocks = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(), flags=re.S)
    (code,) = (b for b in blocks if "selfheal.diagnose(" in b)
    exec(compile(code, page, "exec"), {})
    told = capsys.readouterr().out
    assert "explained" in told and "coulomb_friction joint:hinge" in told
    assert (tmp_path / "diagnosis" / "report.html").is_file()


# what is given


class Asked(Exception):
    """The diagnoser was asked."""


@pytest.fixture
def asked(monkeypatch):
    """The arguments of each call of the diagnoser, which raises."""
    questions: list[dict] = []

    def ask(model, recordings, **more):
        questions.append({"recordings": recordings, **more})
        raise Asked

    monkeypatch.setattr(module, "diagnose", ask)
    return questions


def test_recordings_may_be_paths_or_recordings_one_or_several(asked, home, tmp_path):
    recording = read(home / "recording.h5")
    other = replace(recording, file="other")
    path = str(home / "recording.h5")
    for given in (path, Path(path), recording, [path], [recording, other]):
        with pytest.raises(Asked):
            selfheal.diagnose(home / "model.xml", given)
    files = [[r.file for r in one["recordings"]] for one in asked]
    assert files == [[path]] * 4 + [[path, "other"]]


def test_what_is_held_out_may_be_a_name_or_several(asked, home):
    for held_out in ("001", ["001"], home / "recording.h5"):
        with pytest.raises(Asked):
            selfheal.diagnose(
                home / "model.xml", home / "recording.h5", held_out=held_out
            )
    path = home / "recording.h5"
    everything = [f"{path}:{k:03d}" for k in range(4)]
    held = [one["held_out"] for one in asked]
    assert held == [[f"{path}:001"], [f"{path}:001"], everything]


def test_a_recording_made_in_python_is_checked(asked, home):
    recording = read(home / "recording.h5")
    first = recording.episodes["000"]
    bad = replace(recording, episodes={"000": replace(first, time=-first.time)})
    with pytest.raises(RecordingError, match="strictly increase"):
        selfheal.diagnose(home / "model.xml", bad)
    with pytest.raises(InputError, match=r"given twice.*`file` of its own"):
        selfheal.diagnose(home / "model.xml", [recording, recording])
    assert asked == []


def test_no_recording_at_all_is_refused(home):
    with pytest.raises(InputError, match="no recording"):
        selfheal.diagnose(home / "model.xml", [])


def test_a_model_that_is_none_is_refused(home, tmp_path):
    with pytest.raises(InputError, match="no such file"):
        selfheal.diagnose(tmp_path / "none.xml", home / "recording.h5")
    with pytest.raises(InputError, match="it is a folder"):
        selfheal.diagnose(tmp_path, home / "recording.h5")
    (tmp_path / "bad.xml").write_text("<mujoco>\n<worldbdy/>\n</mujoco>")
    with pytest.raises(ModelError, match=r"bad\.xml.*worldbdy.*line 2"):
        selfheal.diagnose(tmp_path / "bad.xml", home / "recording.h5")
