"""The telemetry check: each fault is found and located, physics gives no alarm."""

import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from selfheal.errors import RecordingError, UnknownNameError
from selfheal.telemetry import (
    KINDS,
    check_telemetry,
    checks,
    examine_telemetry,
    refuse_faulty,
)
from selfheal.telemetry.registry import CHECKS
from tests.support.logs.edited_logs import edit, flip, to_degrees

BOTH = ("elbow_q", "elbow_v")


def _exchange(recording, *pairs):
    episodes = {}
    for k, e in recording.episodes.items():
        signals = dict(e.signals)
        for a, b in pairs:
            one, other = e.signals[a], e.signals[b]
            signals[a] = replace(one, values=other.values)
            signals[b] = replace(other, values=one.values)
        episodes[k] = replace(e, signals=signals)
    return replace(recording, episodes=episodes)


def _find(recording, model):
    return {(f.kind, *sorted(f.columns)) for f in check_telemetry(recording, model)}


def test_every_check_is_registered():
    modules = {path.stem for path in Path(checks.__file__).parent.glob("*.py")}
    assert modules - {"__init__"} == {check.name for check in CHECKS}


@pytest.mark.parametrize(
    "robot", ["servo_arm", "torque_arm", "pid_arm", "rover", "missing_physics"]
)
def test_neither_a_right_log_nor_missing_physics_gives_an_alarm(robot, request):
    model, recording = request.getfixturevalue(robot)
    found = examine_telemetry(recording, model)
    assert found.faults == ()
    assert found.unchecked == () or robot == "rover"  # on the ground


@pytest.mark.parametrize(
    ("robot", "change", "columns", "kind"),
    [
        *(("servo_arm", flip, c, "sign") for c in (BOTH, ("elbow_v",), ("gyro",))),
        *(("servo_arm", to_degrees, c, "unit") for c in (BOTH, ("elbow_v",))),
        ("servo_arm", lambda t, x: 0 * x + x[0], ("elbow_q",), "frozen"),
        ("pid_arm", flip, ("shoulder_q", "shoulder_v"), "sign"),
        ("rover", flip, ("left",), "sign"),
        ("rover", lambda t, x: np.roll(x, -1, axis=1), ("turn",), "quaternion_order"),
    ],
)
def test_a_wrong_column_is_the_only_fault(robot, change, columns, kind, request):
    model, recording = request.getfixturevalue(robot)
    assert _find(edit(recording, change, *columns), model) == {(kind, *columns)}


@pytest.mark.parametrize(("change", "kind"), [(flip, "sign"), (to_degrees, "unit")])
def test_torques_tell_what_no_other_column_does(torque_arm, change, kind):
    model, recording = torque_arm
    wrong = edit(recording, change, "elbow_q")
    found = [f for f in check_telemetry(wrong, model) if "gyro" not in f.columns]
    assert [f.kind for f in found] == [kind]
    assert "elbow_q" in {*found[0].columns, *found[0].alternatives}


def test_exchanged_columns_are_found(servo_arm):
    model, recording = servo_arm
    wrong = _exchange(recording, ("elbow_q", "shoulder_q"), ("elbow_v", "shoulder_v"))
    columns = ("elbow_q", "elbow_v", "shoulder_q", "shoulder_v")
    assert _find(wrong, model) == {("exchange", *columns)}


def test_a_clipped_column_is_found(servo_arm):
    model, recording = servo_arm
    wrong = edit(recording, lambda t, x: np.minimum(x, 0.5), "elbow_q")
    assert ("saturated", "elbow_q") in _find(wrong, model)


@pytest.mark.parametrize("seconds", [0.2, 0.02])
def test_only_a_delay_that_no_physics_has_is_found(servo_arm, seconds):
    model, recording = servo_arm
    wrong = edit(recording, lambda t, x: np.interp(t - seconds, t, x), "elbow_q")
    expected = {("delay", "elbow_q")} if seconds > 0.12 else set()
    assert {t for t in _find(wrong, model) if t[0] == "delay"} == expected


def test_readings_beyond_the_range_of_the_model_are_found(servo_arm):
    model, recording = servo_arm
    narrow = copy.copy(model)
    narrow.jnt_range[0] = (-0.3, 0.3)
    (fault,) = check_telemetry(recording, narrow)
    assert (fault.kind, fault.target) == ("joint_range", "shoulder")
    assert not fault.is_decisive


def test_a_gap_and_a_duplicate_are_found(servo_arm):
    model, recording = servo_arm
    e = recording.episodes["0"]
    time = e.time.copy()
    time[100:] += 1.0
    time[50::20] = time[49::20][: len(time[50::20])] + 1e-6
    torn = replace(recording, episodes={"0": replace(e, time=time)})
    assert {f.kind for f in check_telemetry(torn, model)} >= {"gap", "duplicate"}


@pytest.mark.parametrize("stamps_are_wrong", [True, False])
def test_jitter_is_told_where_readings_were_even(servo_arm, stamps_are_wrong):
    model, recording = servo_arm
    e = recording.episodes["0"]
    rng = np.random.default_rng(0)
    time = e.time + rng.uniform(-0.0049, 0.0049, e.time.size)
    real = replace(recording, episodes={"0": e})
    real = edit(real, lambda t, x: np.interp(time, t, np.sin(3 * t)), "elbow_q")
    even = edit(real, lambda t, x: np.sin(3 * t), "elbow_q")
    read = (even if stamps_are_wrong else real).episodes["0"].signals["elbow_q"]
    odd = replace(e, time=time, signals={"elbow_q": read})
    told = {f.kind for f in check_telemetry(replace(real, episodes={"0": odd}), model)}
    assert ("jitter" in told) == stamps_are_wrong


def test_a_torque_that_repeats_the_command_is_found(torque_arm):
    model, recording = torque_arm
    e = recording.episodes["0"]
    copied = type(e.signals["elbow_q"])(e.ctrl[:, 1] * 1.0, "joint_torque", "e", "N m")
    episodes = {"0": replace(e, signals={**e.signals, "tau": copied})}
    told = _find(replace(recording, episodes=episodes), model)
    assert ("torque_is_command", "tau") in told


def test_decisive_faults_refuse_unless_they_are_let_pass(servo_arm):
    model, recording = servo_arm
    faults = check_telemetry(edit(recording, flip, "elbow_v"), model)
    with pytest.raises(RecordingError, match=r'"elbow_v": sign = -1.*--no-check sign'):
        refuse_faulty("a.h5", faults)
    assert all(fault.is_decisive for fault in faults)
    assert refuse_faulty("a.h5", faults, ["sign"]) == []
    with pytest.raises(UnknownNameError, match=next(iter(KINDS))):
        refuse_faulty("a.h5", faults, ["sings"])


def test_what_cannot_be_checked_is_said(servo_arm):
    model, recording = servo_arm
    episodes = {
        k: replace(e, signals={"shoulder_q": e.signals["shoulder_q"]})
        for k, e in recording.episodes.items()
    }
    found = examine_telemetry(replace(recording, episodes=episodes), model)
    assert found.faults == () and "'elbow'" in found.unchecked[0]
