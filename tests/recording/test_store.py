"""Recordings survive the disk to the bit; what breaks the contract is refused."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.errors import ModelError, RecordingError
from selfheal.recording import (
    KINDS,
    Recording,
    check_against_model,
    read,
    read_names,
    validate,
    write,
)


def _bits(values):
    return None if values is None else (values.shape, values.tobytes())


def _facts(recording):
    """All of a recording as nested plain data that compares to the bit."""
    episodes = [
        (
            name,
            [_bits(a) for a in (e.time, e.ctrl, e.qpos0, e.qvel0)],
            (e.ctrl_names, e.motion),
            [
                (key, _bits(s.values), s.kind, s.target, s.unit)
                for key, s in e.signals.items()
            ],
        )
        for name, e in recording.episodes.items()
    ]
    return recording.robot, recording.source, episodes


def _edit(recording, **changes):
    """The recording with fields of its episode `alpha` changed."""
    alpha = replace(recording.episodes["alpha"], **changes)
    return replace(recording, episodes={**recording.episodes, "alpha": alpha})


def _edit_signal(recording, name, **changes):
    signals = recording.episodes["alpha"].signals
    changed = {**signals, name: replace(signals[name], **changes)}
    return _edit(recording, signals=changed)


def test_reading_gives_back_what_was_written(recording, file):
    assert _facts(read(file)) == _facts(recording)


def test_writing_again_gives_the_same_file(file, tmp_path):
    write(read(file), tmp_path / "again.h5")
    assert (tmp_path / "again.h5").read_bytes() == file.read_bytes()


def test_odd_floats_survive(recording, file, tmp_path):
    payload = np.array([0x7FF8_0000_0000_BEEF], dtype=np.uint64).view(float)
    values = np.array([5e-324, -0.0, np.pi, payload[0], -9.999e9])
    write(_edit_signal(recording, "up", values=values), tmp_path / "odd.h5")
    back = read(tmp_path / "odd.h5").episodes["alpha"].signals["up"].values
    assert back.tobytes() == values.tobytes()


def test_a_robot_without_actuators_signals_or_labels(tmp_path, recording):
    bare = {"ctrl": np.empty((5, 0)), "ctrl_names": (), "signals": {}, "motion": None}
    bare = Recording({"alpha": _edit(recording, **bare).episodes["alpha"]})
    write(bare, tmp_path / "bare.h5")
    assert _facts(read(tmp_path / "bare.h5")) == _facts(bare)


def test_the_small_recording_has_every_kind(recording):
    signals = recording.episodes["alpha"].signals.values()
    assert {signal.kind for signal in signals} == set(KINDS)


@pytest.mark.slow
def test_real_recordings_are_read_and_survive(shared_recordings, tmp_path):
    paths = sorted(shared_recordings.rglob("*.h5"))
    assert paths
    for path in paths:
        recording = read(path)
        write(recording, tmp_path / "copy.h5")
        assert _facts(read(tmp_path / "copy.h5")) == _facts(recording)


def test_real_recordings_fit_their_models(shared_recordings):
    for path in sorted(shared_recordings.rglob("model.xml")):
        names = read_names(path)
        for file in path.parent.glob("*.h5"):
            if "released" not in file.name:
                check_against_model(read(file), names)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"time": np.array([0, 1, 2, 2, 3.0])}, "strictly increase.*sample 3"),
        ({"time": np.array([0, 1, np.nan, 2, 3.0])}, "time is nan at sample 2"),
        ({"time": np.zeros((5, 1))}, r"time has shape \(5, 1\)"),
        ({"time": np.empty(0)}, r"time has shape \(0,\)"),
        ({"time": np.arange(4.0)}, r"ctrl has shape \(5, 2\).*\(4, nu\)"),
        ({"ctrl": np.zeros(5)}, r"ctrl has shape \(5,\)"),
        ({"ctrl": np.full((5, 2), np.inf)}, "'motor' is inf at sample 0"),
        ({"ctrl": np.full((5, 2), np.nan)}, "'motor' is nan at sample 0"),
        ({"ctrl_names": ("motor",)}, "2 columns and the names 'motor'"),
        ({"ctrl_names": ("motor", "")}, "would fit: one actuator name a column"),
        ({"qpos0": np.zeros((1, 2))}, "qpos0 has shape"),
        ({"qvel0": np.array([np.nan])}, "qvel0 is not finite"),
        ({"time": np.arange(5) + 1e12}, "time holds 1e.12; would fit: SI units"),
        ({"ctrl": np.full((5, 2), 1e30)}, "ctrl holds 1e.30"),
        ({"qpos0": np.array([-1e11])}, "qpos0 holds -1e.11"),
    ],
)
def test_a_bad_episode_is_refused(recording, changes, said):
    with pytest.raises(RecordingError, match=f"arm.h5, episode 'alpha': .*{said}"):
        validate(_edit(recording, **changes))


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("up", {"kind": "smell"}, "unknown kind 'smell'; valid: joint_position, "),
        ("arm_position", {"unit": "deg"}, "'deg' does not fit.*'rad', 'm'"),
        ("up", {"unit": ""}, "unit '' does not fit"),
        ("up", {"target": ""}, "lacks a target.*sensor"),
        ("arm_position", {"values": np.zeros(6)}, r"\(6,\) does not fit.*\(5,\)"),
        ("arm_position", {"values": np.zeros((5, 1))}, r"would fit: \(5,\)"),
        ("tip_position", {"values": np.zeros((5, 2))}, r"would fit: \(5, 3\)"),
        ("up", {"values": np.zeros((4, 3))}, r"would fit: \(5,\) or \(5, d\)"),
        ("up", {"values": np.zeros((5, 3, 1))}, r"would fit: \(5,\) or \(5, d\)"),
        ("up", {"values": np.full(5, -np.inf)}, "infinite at sample 0"),
        ("up", {"values": np.full(5, 1e307)}, "holds 1e.307; would fit: SI units"),
        ("tip_orientation", {"values": np.ones((5, 4))}, "quaternion of length 2 at"),
    ],
)
def test_a_bad_signal_is_refused(recording, name, changes, said):
    place = f"arm.h5, episode 'alpha', signal '{name}': "
    with pytest.raises(RecordingError, match=f"{place}.*{said}"):
        validate(_edit_signal(recording, name, **changes))


@pytest.mark.parametrize("name", ["", ".", "a/b", "a\0b"])
def test_a_name_that_hdf5_cannot_hold_is_refused(recording, name):
    episodes = {name: recording.episodes["alpha"]}
    with pytest.raises(RecordingError, match="the name must not be"):
        validate(replace(recording, episodes=episodes))


def test_what_is_refused_is_not_written(recording, tmp_path):
    with pytest.raises(RecordingError, match=r"out\.h5.*no episode"):
        write(replace(recording, episodes={}), tmp_path / "out.h5")
    assert not list(tmp_path.iterdir())


def test_the_recording_fits_its_model(recording, model):
    check_against_model(recording, read_names(model))


@pytest.mark.parametrize(
    ("name", "changes", "said"),
    [
        ("arm_position", {"target": "knee"}, "no joint 'knee'.*'cart', 'arm'"),
        ("arm_position", {"unit": "m"}, "'m' does not fit joint 'arm'.*'rad'"),
        ("arm_torque", {"unit": "N"}, "'N' does not fit actuator 'motor'.*'N m'"),
        ("tip_position", {"target": "toe"}, "no body 'toe'.*'base', 'tip'"),
        ("up", {"target": "down"}, "no sensor 'down'.*'up', 'angle'"),
        ("up", {"unit": "deg"}, "'deg' does not fit sensor 'up'.*'1'"),
        ("up", {"values": np.zeros(5)}, r"\(5,\) does not fit.*\(5, 3\)"),
        ("up", {"target": "angle", "unit": "rad"}, r"would fit: \(5,\)"),
        ("heat", {"target": "fan"}, "no actuator 'fan'.*'motor', 'pusher'"),
    ],
)
def test_a_signal_that_the_model_lacks_is_refused(
    recording, model, name, changes, said
):
    place = f"arm.h5, episode 'alpha', signal '{name}': "
    with pytest.raises(RecordingError, match=f"{place}.*{said}"):
        check_against_model(_edit_signal(recording, name, **changes), read_names(model))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"ctrl_names": ("motor", "fan")}, "no actuator 'fan'; would fit: 'motor'"),
        (
            {"ctrl_names": ("motor",), "ctrl": np.zeros((5, 1))},
            "no column for actuator 'pusher'",
        ),
        ({"ctrl_names": ("motor", "motor")}, "no column for actuator 'pusher'"),
        ({"qpos0": np.zeros(3)}, "qpos0 has 3 values; the model has 2"),
        ({"qvel0": np.zeros(1)}, "qvel0 has 1 values; the model has 2"),
    ],
)
def test_an_episode_that_does_not_fit_the_model_is_refused(
    recording, model, changes, said
):
    with pytest.raises(RecordingError, match=f"arm.h5, episode 'alpha': .*{said}"):
        check_against_model(_edit(recording, **changes), read_names(model))


def test_a_model_that_cannot_be_loaded_is_refused(tmp_path):
    (tmp_path / "bad.xml").write_text("<mujoco><worldbody><bdy/></worldbody></mujoco>")
    for path in (tmp_path / "bad.xml", tmp_path / "none.xml"):
        with pytest.raises(ModelError, match=f"{path}: MuJoCo cannot load it"):
            read_names(path)
