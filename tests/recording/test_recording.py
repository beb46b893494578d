"""Recordings of arrays and of tables: what is written is what was given."""

import numpy as np
import pytest

import selfheal
from selfheal.errors import InputError, RecordingError
from selfheal.recording import read

MODEL = """<mujoco>
  <worldbody>
    <body name="cart"><joint name="rail" type="slide" axis="1 0 0"/><geom size="0.1"/>
      <body name="pole"><joint name="pivot" axis="0 1 0"/>
        <geom size="0.1" pos="0 0 1"/><site name="tip"/></body></body>
  </worldbody>
  <actuator><motor name="push" joint="rail"/></actuator>
  <sensor><gyro name="gyro" site="tip"/></sensor>
</mujoco>"""
TIME = np.arange(0, 1, 0.01)
SIGNALS = {
    "joint_position": {"rail": np.sin(TIME), "pivot": np.cos(TIME)},
    "joint_torque": {"push": 2 * TIME},
    "sensor": {"gyro": np.ones((TIME.size, 3))},
}


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "model.xml"
    path.write_text(MODEL)
    return path


def test_arrays_come_back_from_the_file(model, tmp_path):
    more = {"motion": "swing", "episode": "first", "robot": "cartpole"}
    recording = selfheal.Recording.from_arrays(
        TIME, {"push": TIME}, SIGNALS, model=model, qpos0=[0, 1], **more
    )
    recording.write(tmp_path / "rec.h5")
    found = read(tmp_path / "rec.h5")
    episode = found.episodes["first"]
    assert (found.robot, episode.motion) == ("cartpole", "swing")
    assert (episode.ctrl[:, 0] == TIME).all() and episode.ctrl_names == ("push",)
    assert episode.qpos0.tolist() == [0, 1] and episode.qvel0 is None
    signals = {k: (s.kind, s.unit) for k, s in episode.signals.items()}
    assert signals == {
        "rail_position": ("joint_position", "m"),
        "pivot_position": ("joint_position", "rad"),
        "push_torque": ("joint_torque", "N"),
        "gyro": ("sensor", "rad/s"),
    }
    assert (episode.signals["pivot_position"].values == np.cos(TIME)).all()


class _Frame(dict):
    columns = property(list)


@pytest.mark.parametrize("make", [_Frame, "pandas"])
def test_a_table_makes_the_recording_that_its_columns_make(make, model):
    if isinstance(make, str):
        make = pytest.importorskip(make).DataFrame
    frame = make({"t": TIME, "u": TIME**2, "x": np.sin(TIME), "wx": TIME, "wy": -TIME})
    signals = {"joint_position": {"rail": "x"}, "sensor": {"gyro": ["wx", "wy", "x"]}}
    found = selfheal.Recording.from_dataframe(
        frame, "t", {"push": "u"}, signals, model=model
    )
    episode = found.episodes["000"]
    assert (episode.ctrl[:, 0] == TIME**2).all()
    expected = np.stack([TIME, -TIME, np.sin(TIME)], axis=1)
    assert (episode.signals["gyro"].values == expected).all()


@pytest.mark.parametrize(
    "time, ctrl, signals, said",
    [
        (TIME[::-1], {"push": TIME}, {}, "time must strictly increase"),
        (TIME, {"push": TIME[1:]}, {}, r"'push' has shape \(99,\).*\(100,\)"),
        (TIME, {"push": TIME}, {"angle": {}}, "unknown kind of signal 'angle'"),
        (TIME, {"pull": TIME}, {}, "no actuator 'pull'; would fit: 'push'"),
        (TIME, {"push": ["a"] * 100}, {}, "ctrl of 'push' is no array of numbers"),
        (TIME, {"push": TIME}, {"joint_position": {"hip": TIME}}, "no joint 'hip'"),
        (TIME, {"push": TIME}, {"sensor": {"gyro": TIME}}, r"would fit: \(100, 3\)"),
    ],
)
def test_what_breaks_the_contract_is_refused(time, ctrl, signals, said, model):
    with pytest.raises((InputError, RecordingError), match=said):
        selfheal.Recording.from_arrays(time, ctrl, signals, model=model)


def test_a_keyword_that_is_none_is_refused():
    with pytest.raises(TypeError, match="moton"):
        selfheal.Recording.from_arrays(TIME, {"push": TIME}, {}, moton="swing")


def test_a_column_that_is_not_there_is_named(model):
    with pytest.raises(InputError, match="unknown column 'z'; valid: t, u"):
        selfheal.Recording.from_dataframe(
            _Frame(t=TIME, u=TIME), "t", {"push": "z"}, {}
        )
