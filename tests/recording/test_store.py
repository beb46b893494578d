"""Recordings survive the disk to the bit; what breaks the contract is refused."""

import os
import subprocess
import sys
from dataclasses import replace

import h5py
import numpy as np
import pytest

from selfheal.errors import InputError, ModelError, RecordingError
from selfheal.recording import (
    KINDS,
    Recording,
    check_against_model,
    read,
    read_names,
    store,
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


@pytest.fixture
def file(recording, tmp_path):
    """The recording on disk."""
    path = tmp_path / "arm.h5"
    write(recording, path)
    return path


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
    values = np.array([5e-324, -0.0, np.pi, payload[0], -1.7e308])
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
        ({"ctrl_names": ("motor", "motor")}, "one different actuator name"),
        ({"qpos0": np.zeros((1, 2))}, "qpos0 has shape"),
        ({"qvel0": np.array([np.nan])}, "qvel0 is not finite"),
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


def _no_time(root):
    del root["episodes/alpha/time"]


def _no_signals(root):
    del root["episodes/alpha/signals"]


def _no_names(root):
    del root["episodes/alpha/ctrl"].attrs["names"]


def _no_kind(root):
    del root["episodes/alpha/signals/up"].attrs["kind"]


def _without(name, value=None):
    """A signal without an attribute, or with one that is no text."""

    def damage(root):
        attrs = root["episodes/alpha/signals/up"].attrs
        del attrs[name]
        if value is not None:
            attrs[name] = value

    return damage


def _numbered(root):
    root["episodes/alpha/ctrl"].attrs["names"] = [1, 2]


def _together(root):
    root["episodes/alpha/ctrl"].attrs["names"] = "servo,b"


def _other_version(root):
    root.attrs["version"] = 2


def _other_format(root):
    root.attrs["format"] = "rosbag"


def _typing_error(root):
    root["episodes/alpha"].move("ctrl", "control")


def _text_array(root):
    del root["episodes/alpha/time"]
    root["episodes/alpha/time"] = ["a", "b"]


def _no_space(root):
    del root["episodes/alpha/time"]
    root["episodes/alpha/time"] = h5py.Empty("f8")


def _soft_link(root):
    root["episodes/alpha/signals/copy"] = h5py.SoftLink("/episodes/alpha/time")


def _external_link(root):
    root["episodes/beta"] = h5py.ExternalLink("secret.h5", "/")


def _external_data(root):
    signals = root["episodes/alpha/signals"]
    del signals["voltage"]
    raw = [("/etc/passwd", 0, 40)]
    signals.create_dataset("voltage", (5,), "f8", external=raw)


def _virtual_data(root):
    signals = root["episodes/alpha/signals"]
    del signals["voltage"]
    layout = h5py.VirtualLayout((5,), "f8")
    layout[:] = h5py.VirtualSource("secret.h5", "time", (5,))
    signals.create_virtual_dataset("voltage", layout)


def _huge(root):
    signals = root["episodes/alpha/signals"]
    signals.create_dataset("huge", (10**9,), "f8", chunks=(1000,))


def _huge_chunk(root):
    options = {"maxshape": (None,), "chunks": (store.MAX_VALUES,)}
    root["episodes/alpha/signals"].create_dataset("huge", (5,), "f8", **options)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (_no_time, "episode 'alpha': time is missing; .* holds 'ctrl'"),
        (_no_signals, "episode 'alpha': signals is missing"),
        (_no_names, "episode 'alpha': ctrl lacks the attribute names"),
        (_no_kind, "signal 'up': it lacks the attribute kind; .* 'joint_position', "),
        (_without("unit"), "'up': it lacks the attribute unit; would fit: that of the"),
        (_without("target"), "lacks the attribute target; would fit: the name of a s"),
        (_without("kind", 5), "attribute kind is 5, no text; would fit: 'joint_posi"),
        (_numbered, r"names of ctrl is \[1, 2\]; it must be texts"),
        (_together, "columns and the names 'servo,b'; would fit"),
        (_other_version, "version is .*2.*; this program reads 1"),
        (_other_format, "format is 'rosbag'; would fit: 'selfheal-recording'"),
        (_typing_error, "unknown member 'control'; would fit: time, ctrl"),
        (_text_array, "time has type object; would fit: float64"),
        (_no_space, "time is empty"),
        (_soft_link, "signal 'copy': copy is a link to elsewhere"),
        (_external_link, "episode 'beta': beta is a link to elsewhere"),
        (_external_data, "signal 'voltage': voltage keeps its data elsewhere"),
        (_virtual_data, "signal 'voltage': voltage keeps its data elsewhere"),
        (_huge, "it holds 10.* values; at most 1"),
        (_huge_chunk, "it holds 1.* values; at most 1"),
    ],
)
def test_a_bad_file_is_refused(file, damage, said):
    with h5py.File(file, "r+") as root:
        damage(root)
    with pytest.raises(RecordingError, match=f"arm.h5.*{said}"):
        read(file)


def test_every_truncation_is_refused(file):
    whole = file.read_bytes()
    for size in np.linspace(0, len(whole) - 1, 40, dtype=int):
        file.write_bytes(whole[:size])
        with pytest.raises(RecordingError, match="damaged or not HDF5"):
            read(file)


def test_overwritten_samples_are_refused(file):
    with h5py.File(file) as root:
        chunk = root["episodes/alpha/signals/up"].id.get_chunk_info(0)
    broken = bytearray(file.read_bytes())
    broken[chunk.byte_offset : chunk.byte_offset + chunk.size] = bytes(chunk.size)
    file.write_bytes(broken)
    with pytest.raises(RecordingError, match="damaged"):
        read(file)


def test_a_file_that_is_being_written_is_refused(file):
    with h5py.File(file, "r+"):
        code = "import sys; from selfheal.recording import read; read(sys.argv[1])"
        command = [sys.executable, "-c", code, file]
        result = subprocess.run(command, capture_output=True, text=True)
    assert "another process holds it open" in result.stderr


@pytest.mark.parametrize("text", [b"", b"time,ctrl\n0,1\n"])
def test_what_is_no_hdf5_is_refused(tmp_path, text):
    (tmp_path / "a.h5").write_bytes(text)
    with pytest.raises(RecordingError, match=r"a\.h5: it is damaged or not HDF5"):
        read(tmp_path / "a.h5")


def test_a_missing_file_or_a_folder_is_refused(tmp_path):
    for name, said in (("", "it is a folder"), ("nothing.h5", "no such file")):
        with pytest.raises(RecordingError, match=said):
            read(tmp_path / name)


def test_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe.h5")
    with pytest.raises(RecordingError, match="it is no regular file"):
        read(tmp_path / "pipe.h5")


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


def test_every_refusal_is_an_input_error():
    assert issubclass(RecordingError, InputError)
