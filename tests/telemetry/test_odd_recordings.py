"""Recordings that hold little, or nothing of sense, are examined without harm."""

import itertools
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.recording import Episode, Recording, Signal
from selfheal.telemetry import examine_telemetry
from tests.support.recorded_robots import ROBOTS, record

ARM = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
<body pos="0 0 1"><joint name="a" axis="0 1 0" range="-1 1" limited="true"/>
<geom size=".1" pos=".3 0 0"/><body pos=".5 0 0"><joint name="b" type="slide"/>
<geom size=".1"/><site name="s"/></body></body></worldbody>
<actuator><position name="a" joint="a" kp="5" ctrlrange="-1 1" ctrllimited="true"/>
<motor name="b" joint="b"/></actuator><sensor><gyro name="g" site="s"/></sensor>
</mujoco>"""
FREE = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
<body name="b" pos="0 0 1"><freejoint/><geom size=".1"/></body></worldbody></mujoco>"""
SIGNALS = {
    ARM: [
        ("joint_position", "a", "rad", 1),
        ("joint_velocity", "a", "rad/s", 1),
        ("joint_position", "b", "m", 1),
        ("joint_torque", "a", "N m", 1),
        ("sensor", "g", "rad/s", 3),
    ],
    FREE: [
        ("body_position", "b", "m", 3),
        ("body_orientation", "b", "1", 4),
        ("body_angular_velocity", "b", "rad/s", 3),
    ],
}
CHANGES = {
    "noise": lambda values, rng: values,
    "zeros": lambda values, rng: 0 * values,
    "missing": lambda values, rng: values * np.nan,
    "gaps": lambda values, rng: values * rng.choice([1, np.nan], values.shape),
    "huge": lambda values, rng: 1e8 * values,
}


def _make_signal(change, rows, rng, what):
    kind, target, unit, width = what
    values = CHANGES[change](rng.normal(size=(rows, width)), rng)
    if kind == "body_orientation":
        values = values / np.linalg.norm(values, axis=1, keepdims=True)
        values = np.tile([1.0, 0, 0, 0], (rows, 1)) if change == "zeros" else values
    return Signal(values[:, 0] if width == 1 else values, kind, target, unit)


@pytest.mark.filterwarnings("ignore:invalid value encountered in divide")  # of zeros
@pytest.mark.parametrize("model", [ARM, FREE], ids=["arm", "free body"])
@pytest.mark.parametrize("change", CHANGES)
def test_odd_recordings_do_no_harm(model, change):
    compiled, rng = mujoco.MjModel.from_xml_string(model), np.random.default_rng(0)
    for rows, count in itertools.product((1, 2, 3, 20), (1, 2)):
        episodes = {}
        for number in range(count):
            time = np.cumsum(rng.random(rows) * 0.02 + 1e-4)
            ctrl, names = rng.normal(size=(rows, compiled.nu)), "ab"[: compiled.nu]
            signals = {
                f"{what[0]} {what[1]}": _make_signal(change, rows, rng, what)
                for what in SIGNALS[model]
            }
            episodes[str(number)] = Episode(time, ctrl, tuple(names), signals)
        examine_telemetry(Recording(episodes), compiled)


def test_poses_without_encoders_have_no_balance_of_torques(tmp_path):
    robot = ROBOTS["arm"]
    signals = {
        f"{body}_{kind}": (f"body_{kind}", body, unit)
        for body in ("upper", "lower")
        for kind, unit in (("position", "m"), ("orientation", "quaternion"))
    }
    recording = record(replace(robot, signals=signals), episodes=3, seconds=2.0)
    model = mujoco.MjModel.from_xml_string(robot.xml)
    telemetry = examine_telemetry(recording, model)
    assert not telemetry.faults
    assert any("is not read" in line for line in telemetry.unchecked)


def _shorten(recording, lengths, rate):
    """The first rows of episodes, as if they had been read at another rate."""
    episodes = {}
    for (key, e), rows in zip(recording.episodes.items(), lengths, strict=False):
        signals = {n: replace(s, values=s.values[:rows]) for n, s in e.signals.items()}
        episodes[key] = replace(
            e, time=np.arange(rows) / rate, ctrl=e.ctrl[:rows], signals=signals
        )
    return replace(recording, episodes=episodes)


@pytest.mark.parametrize("robot", ["servo_arm", "rover"])
def test_logs_of_any_length_are_examined(robot, request):
    model, recording = request.getfixturevalue(robot)
    for rows, rate in itertools.product((1, 3, 11, 13, 41, 56), (30, 100, 1000)):
        examine_telemetry(_shorten(recording, (rows,), rate), model)


@pytest.mark.parametrize("rows", [1, 12, 41])
def test_short_episodes_beside_a_long_one_are_examined(servo_arm, rows):
    model, recording = servo_arm
    examine_telemetry(_shorten(recording, (300, rows, rows), 100), model)
