"""A sensor board that is turned against its site is told, with the site to write."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from selfheal.recording import Episode, Recording, Signal
from selfheal.telemetry import check_telemetry
from selfheal.telemetry.boards import find_turn

HEAD = """<mujoco><compiler angle="radian"/><worldbody><body>
<joint name="yaw" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body><joint name="pitch" axis="0 1 0"/>
<inertial pos="0 0 .1" mass="1" diaginertia="1 1 1"/>
<site name="board" pos=".05 0 .1" quat="1 0 0 0"/></body></body></worldbody>
<actuator><motor name="y" joint="yaw"/><motor name="p" joint="pitch"/></actuator>
<sensor><gyro name="gyro" site="board"/><accelerometer name="acc" site="board"/>
</sensor></mujoco>"""
FRAMES = Rotation.create_group("O")


def _sum_waves(waves, order, time):
    """The derivative of an order of a sum of sines, in each of some times (T)."""
    return sum(
        a * w**order * np.sin(w * time + p + order * np.pi / 2) for a, w, p in waves
    )


@pytest.fixture(scope="module")
def recording():
    """What the head reads as its motors move it."""
    model = mujoco.MjModel.from_xml_string(HEAD)
    data, rng = mujoco.MjData(model), np.random.default_rng(2)
    time = np.arange(800) / 100
    waves = rng.uniform((0.2, 1, 0), (0.5, 5, 6), (6, 3))
    q, v, acc = (
        np.stack([_sum_waves(part, n, time) for part in (waves[:3], waves[3:])], axis=1)
        for n in range(3)
    )
    read, ctrl = np.empty((len(time), 6)), np.empty((len(time), 2))
    for k in range(len(time)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], acc[k]
        mujoco.mj_inverse(model, data)
        read[k], ctrl[k] = data.sensordata, data.qfrc_inverse
    read += rng.normal(0, 0.01, read.shape)
    signals = {
        "yaw_q": Signal(q[:, 0], "joint_position", "yaw", "rad"),
        "pitch_q": Signal(q[:, 1], "joint_position", "pitch", "rad"),
        "gyro": Signal(read[:, :3], "sensor", "gyro", "rad/s"),
        "acc": Signal(read[:, 3:], "sensor", "acc", "m/s^2"),
    }
    return Recording({"0": Episode(time, ctrl, ("y", "p"), signals)})


def _turn(recording, rotation):
    e = recording.episodes["0"]
    turned = {
        n: replace(e.signals[n], values=rotation.apply(e.signals[n].values))
        for n in ("gyro", "acc")
    }
    return Recording({"0": replace(e, signals={**e.signals, **turned})})


@pytest.mark.parametrize(
    "rotation",
    [*(FRAMES[k] for k in (1, 5, 9, 14, 22)), *Rotation.random(3, random_state=4)],
)
def test_the_site_that_is_told_explains_the_readings(recording, rotation):
    turned = _turn(recording, rotation)
    (fault,) = check_telemetry(turned, mujoco.MjModel.from_xml_string(HEAD))
    assert fault.kind == "sensor_frame" and fault.is_decisive
    assert set(fault.columns) == {"gyro", "acc"} and fault.target == "board"
    quat = re.search('quat="[^"]*"', str(fault.corrections[0]))[0]
    corrected = mujoco.MjModel.from_xml_string(HEAD.replace('quat="1 0 0 0"', quat))
    assert check_telemetry(turned, corrected) == []


def test_a_board_that_stands_as_its_site_does_is_no_fault(recording):
    model = mujoco.MjModel.from_xml_string(HEAD)
    assert check_telemetry(recording, model) == []
    little = Rotation.from_euler("z", 2, degrees=True)
    assert check_telemetry(_turn(recording, little), model) == []


def test_vectors_along_one_line_leave_a_rotation_open():
    rng = np.random.default_rng(0)
    line = rng.normal(size=(200, 1)) * np.array([0, 1.0, 0])
    noise = rng.normal(0, 0.01, line.shape)
    assert find_turn([(line, -line + noise)]) is None
    assert find_turn([(np.full((200, 3), np.nan), line)]) is None


def test_columns_that_are_no_rotation_are_no_turned_board():
    rng = np.random.default_rng(1)
    vectors = rng.normal(size=(300, 3))
    assert find_turn([(vectors, vectors * (-1, 1, 1))]) is None
    assert find_turn([(vectors, rng.normal(size=(300, 3)))]) is None
