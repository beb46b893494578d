"""Offsets of clocks are found, with intervals; none is where none can be."""

import mujoco
import numpy as np
import pytest

from selfheal.logs.offsets import estimate_offsets
from selfheal.recording import Episode, Signal

ARM = """<mujoco><worldbody>
  <body><joint name="a" axis="0 1 0"/><geom size=".1"/>
    <body name="hand" pos=".3 0 0"><joint name="b" axis="0 0 1"/>
      <geom size=".1" pos=".2 0 0"/><site name="imu"/></body></body>
</worldbody>
<sensor><gyro name="gyro" site="imu"/><accelerometer name="acc" site="imu"/></sensor>
</mujoco>"""


@pytest.fixture(scope="module")
def model():
    return mujoco.MjModel.from_xml_string(ARM)


def _make_episode(model, late):
    """Joints at 100 Hz; gyroscope, pose and speed at 73 Hz by a clock that is late."""
    rng = np.random.default_rng(0)
    joints, others = np.arange(0, 20, 0.01), np.arange(0.2, 19.7, 1 / 73)

    def move(t):
        q = np.stack([0.7 * np.sin(1.3 * t) + 0.2 * np.sin(5 * t), np.cos(2.1 * t)], -1)
        rates = 0.91 * np.cos(1.3 * t) + np.cos(5 * t), -2.1 * np.sin(2.1 * t)
        return q, np.stack(rates, -1)

    data, gyro, quat = mujoco.MjData(model), [], []
    for t in others:
        data.qpos[:], data.qvel[:] = move(t)
        mujoco.mj_forward(model, data)
        gyro.append(data.sensor("gyro").data.copy())
        quat.append(data.body("hand").xquat * rng.choice([-1, 1]))
    time = np.union1d(joints, others + late)

    def spread(at, values):
        found = np.full((time.size, *values.shape[1:]), np.nan)
        found[np.searchsorted(time, at)] = values
        return found

    q = move(joints)[0] + rng.normal(size=(joints.size, 2)) * 1e-3
    gyro = np.array(gyro) + rng.normal(size=(others.size, 3)) * 0.01
    signals = {
        "a": Signal(spread(joints, q[:, 0]), "joint_position", "a", "rad"),
        "b": Signal(spread(joints, q[:, 1]), "joint_position", "b", "rad"),
        "gyro": Signal(spread(others + late, gyro), "sensor", "gyro", "rad/s"),
        "pose": Signal(
            spread(others + late, np.array(quat)), "body_orientation", "hand", "1"
        ),
        "speed": Signal(
            spread(others + late, move(others)[1][:, 0]), "joint_velocity", "a", "rad/s"
        ),
        "acc": Signal(spread(others + late, gyro), "sensor", "acc", "m/s^2"),
    }
    streams = {n: "/joints" if n in "ab" else f"/{n}" for n in signals}
    return Episode(time, np.empty((time.size, 0)), (), signals), streams


@pytest.mark.parametrize(
    "late", [0.0323, *(pytest.param(t, marks=pytest.mark.slow) for t in (0.0, -0.12))]
)
def test_the_offset_of_each_clock_is_found(model, late):
    episode, streams = _make_episode(model, late)
    found = {o.stream: o for o in estimate_offsets(episode, streams, model)}
    assert found.keys() == {"/gyro", "/pose", "/speed"}
    for offset in found.values():
        assert offset.reference == "/joints"
        assert offset.seconds == pytest.approx(late, abs=1e-3)
        assert offset.low <= late + 5e-4 and offset.high >= late - 5e-4
        assert offset.high - offset.low < 0.01


def test_what_does_not_follow_the_joints_has_no_offset(model):
    episode, streams = _make_episode(model, 0.0)
    rng = np.random.default_rng(1)
    noise = rng.normal(size=episode.signals["gyro"].values.shape)
    signals = dict(episode.signals)
    signals["gyro"] = Signal(noise, "sensor", "gyro", "rad/s")
    changed = Episode(episode.time, episode.ctrl, (), signals)
    found = [o.stream for o in estimate_offsets(changed, streams, model)]
    assert found == ["/pose", "/speed"]


def test_without_all_joints_nothing_is_estimated(model):
    episode, streams = _make_episode(model, 0.0)
    signals = {n: s for n, s in episode.signals.items() if n != "b"}
    changed = Episode(episode.time, episode.ctrl, (), signals)
    assert estimate_offsets(changed, streams, model) == []
