"""Replays of a diagnosis: what plain MuJoCo does, and what they refuse."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.output.replay import replay_recording
from selfheal.diagnosis.simulation.build import build_simulator
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from selfheal.errors import RecordingError
from selfheal.mjcf.edit import apply_edits
from selfheal.recording import Signal, list_model_names, load_model
from tests.support.diagnosis_folder import write_empty_diagnosis, write_finding
from tests.support.recorded_robots import ROBOTS, record


def _with(recording, **more):
    episodes = {k: replace(e, **more) for k, e in recording.episodes.items()}
    return replace(recording, episodes=episodes)


def _emptied(recording):
    """The recording without a single reading."""
    episodes = {}
    for key, episode in recording.episodes.items():
        signals = {
            name: replace(s, values=np.full_like(s.values, np.nan))
            for name, s in episode.signals.items()
        }
        episodes[key] = replace(episode, signals=signals)
    return replace(recording, episodes=episodes)


def test_a_replay_needs_no_reading_and_fills_in_every_row(empty_diagnosis):
    out, recording = empty_diagnosis
    inputs = _emptied(recording), recording
    played, again = (replay_recording(out, each) for each in inputs)
    for key, episode in played.episodes.items():
        assert set(episode.signals) == set(recording.episodes[key].signals)
        for name, signal in episode.signals.items():
            given = recording.episodes[key].signals[name]
            assert signal.values.shape == given.values.shape
            assert np.isfinite(signal.values).all(), name
            other = again.episodes[key].signals[name].values
            np.testing.assert_allclose(signal.values, other, atol=1e-12)


def test_a_replay_is_what_plain_mujoco_does(empty_diagnosis):
    out, recording = empty_diagnosis
    played = replay_recording(out, recording)
    model = mujoco.MjModel.from_xml_string(ROBOTS["arm"].xml)
    every = round(0.01 / model.opt.timestep)
    for key, episode in recording.episodes.items():
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = episode.qpos0, episode.qvel0
        predicted = []
        for u in episode.ctrl:
            predicted.append(data.qpos.copy())
            data.ctrl[:] = u
            mujoco.mj_step(model, data, every)
        signals = played.episodes[key].signals
        both = np.stack([signals[n].values for n in ("shoulder", "elbow")], axis=1)
        np.testing.assert_allclose(both, predicted, atol=1e-9)


def test_a_motor_torque_is_predicted_at_the_joint(tmp_path):
    xml = ROBOTS["arm"].xml.replace('kv="0.4"', 'kv="0.4" gear="-3"')
    path = tmp_path / "model.xml"
    path.write_text(xml)
    recording = record(replace(ROBOTS["arm"], xml=xml), seconds=0.2, finer=1, noise=0)
    played = replay_recording(write_empty_diagnosis(tmp_path / "out", path), recording)
    for key, episode in recording.episodes.items():
        both = [
            e.signals["elbow_torque"].values for e in (episode, played.episodes[key])
        ]
        np.testing.assert_allclose(*both, atol=1e-6)


@pytest.mark.parametrize("end", [".mjcf", ".XML", ".txt", ""])
def test_a_model_may_have_any_name(end, empty_diagnosis, tmp_path):
    """Files that it speaks of are found from where it lies."""
    out, recording = empty_diagnosis
    (tmp_path / "more").mkdir()
    still = '<mujoco><option gravity="0 0 0"/></mujoco>'
    (tmp_path / "more" / "still.xml").write_text(still)
    include = '<include file="more/still.xml"/></mujoco>'
    texts, predicted = [], []
    for path in (tmp_path / f"other{end}", tmp_path / "usual.xml"):
        path.write_text(ROBOTS["arm"].xml.replace("</mujoco>", include))
        played = replay_recording(out, recording, model=path)
        predicted.append(played.episodes["000"].signals["elbow"].values)
        texts.append(apply_edits(path, (), tmp_path))
        assert list_model_names(load_model(path))
    np.testing.assert_array_equal(*predicted)
    assert texts[0] == texts[1]


def test_supply_voltage_and_temperature_stay_unread(empty_diagnosis):
    out, recording = empty_diagnosis
    (first, *_) = recording.episodes
    episode = recording.episodes[first]
    nan = np.full(episode.time.size, np.nan)
    some = episode.signals["elbow"]
    more = {
        "heat": replace(some, kind="temperature", target="", unit="degC"),
        "supply": replace(some, kind="supply_voltage", target="", unit="V"),
    }
    more = {k: replace(s, values=nan) for k, s in more.items()}
    inputs = replace(
        recording,
        episodes={first: replace(episode, signals={**episode.signals, **more})},
    )
    signals = replay_recording(out, inputs).episodes[first].signals
    assert np.isnan(signals["heat"].values).all()
    assert np.isnan(signals["supply"].values).all()
    assert np.isfinite(signals["elbow"].values).all()


@pytest.mark.parametrize("lost", [("qpos0",), ("qvel0",), ("qpos0", "qvel0")])
def test_a_start_that_is_not_given_is_read_as_a_diagnosis_reads_it(
    lost, empty_diagnosis
):
    out, recording = empty_diagnosis
    inputs = _with(recording, **dict.fromkeys(lost))
    simulator = build_simulator(ModelCompiler(str(out / "patched.xml")), [inputs])
    episodes = {}
    for i, (key, episode) in enumerate(inputs.episodes.items()):
        state = simulator.complete_state(i, np.zeros(1, int))
        q, v = state.qpos, state.qvel
        episodes[key] = replace(episode, qpos0=q[0], qvel0=v[0])
    given = replay_recording(out, replace(inputs, episodes=episodes))
    for key, episode in replay_recording(out, inputs).episodes.items():
        for name in ("shoulder", "elbow"):
            both = [e.signals[name].values for e in (episode, given.episodes[key])]
            np.testing.assert_allclose(*both, atol=1e-6)


def test_a_bias_that_was_found_is_taken_off_the_start(empty_diagnosis):
    out, recording = empty_diagnosis
    inputs = _with(recording, qpos0=None, qvel0=None)
    unbiased = replay_recording(out, inputs)
    bias = {"name": "bias", "value": 0.3}
    write_finding(out, effect="sensor_bias", target="sensor:elbow", parameters=[bias])
    biased = replay_recording(out, inputs)
    for key, episode in biased.episodes.items():
        first = [
            e.signals["elbow"].values[0] for e in (episode, unbiased.episodes[key])
        ]
        np.testing.assert_allclose(*first, atol=1e-6)
        last = [e.signals["shoulder"].values for e in (episode, unbiased.episodes[key])]
        assert abs(last[0][-1] - last[1][-1]) > 1e-3


def test_a_qvel0_that_nothing_tells_is_rest(empty_diagnosis):
    out, recording = empty_diagnosis
    bare = replay_recording(out, _with(_emptied(recording), qvel0=None))
    rest = replay_recording(out, _with(recording, qvel0=np.zeros(2)))
    for key, episode in bare.episodes.items():
        other = rest.episodes[key].signals["elbow"].values
        np.testing.assert_array_equal(episode.signals["elbow"].values, other)


KNEE = Signal(np.zeros(30), "joint_position", "knee", "rad")


@pytest.mark.parametrize(
    "change, said",
    [
        ({"qpos0": None}, "'000': it has no qpos0 and no reading"),
        ({"qpos0": np.zeros(1)}, "qpos0 has 1 values"),
        ({"qpos0": np.zeros(3)}, "qpos0 has 3 values"),
        ({"qvel0": np.ones(3)}, "qvel0"),
        ({"ctrl_names": ("a", "b")}, "no actuator 'a', 'b'; would fit: 'shoulder_serv"),
        ({"signals": {"x": KNEE}}, "no joint 'knee'"),
    ],
)
def test_inputs_of_no_start_or_another_robot_are_refused(change, said, empty_diagnosis):
    out, recording = empty_diagnosis
    with pytest.raises(RecordingError, match=said):
        replay_recording(out, _with(_emptied(recording), **change))


def test_a_diverging_model_is_reported_with_episode_and_time(empty_diagnosis):
    out, recording = empty_diagnosis
    stiff = {"name": "stiffness", "value": 1e9}, {"name": "springref", "value": 0.0}
    write_finding(out, effect="joint_spring", native=False, parameters=list(stiff))
    with pytest.raises(RecordingError, match=r"'000': the model diverges at 0\.\d+ s$"):
        replay_recording(out, recording)


def test_another_version_of_the_model_gets_values_as_ratios(empty_diagnosis, tmp_path):
    """A firmware gain four times as high, re-fitted 10 % lower, is still 10 % lower."""
    out, recording = empty_diagnosis
    document = json.loads((out / "diagnosis.json").read_text())
    entry = {"parameter": "actuator:elbow_servo/kp", "given": 10.0, "value": 9.0}
    document["refit"] = [entry]
    (out / "diagnosis.json").write_text(json.dumps(document))
    texts = [ROBOTS["arm"].xml.replace('kp="10"', f'kp="{kp}"') for kp in (40, 36)]
    for name, text in zip(("other.xml", "right.xml"), texts, strict=True):
        (tmp_path / name).write_text(text)
    played = replay_recording(out, recording, model=tmp_path / "other.xml")
    true = replay_recording(
        write_empty_diagnosis(tmp_path / "none", tmp_path / "right.xml"), recording
    )
    for key, episode in played.episodes.items():
        other = true.episodes[key].signals["elbow"].values
        np.testing.assert_allclose(episode.signals["elbow"].values, other, atol=1e-9)
