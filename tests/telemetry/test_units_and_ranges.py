"""Units as robots write them, ranges of commands, torques, and robots on the ground."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.recording import Signal
from selfheal.telemetry import check_telemetry
from selfheal.telemetry.checks.ranges import soften
from tests.support.logs.edited_logs import edit


def _scale(recording, factor, offset, *names):
    return edit(recording, lambda t, x: factor * x + offset, *names)


def _limit(model, joint, low, high):
    limited = copy.copy(model)
    limited.jnt_limited[joint] = 1
    limited.jnt_range[joint] = low, high
    return limited


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (100 / 5.0, "percent of the range"),
        (255 / 5.0, "bytes, 0 to 255 over the range"),
        (4096 / (2 * np.pi), "counts of 4096 a turn"),
        (1e3, "thousandths"),
    ],
)
def test_a_servo_tells_the_unit_of_its_joint_by_name(servo_arm, factor, said):
    model, recording = servo_arm
    model = _limit(model, 1, -2.0, 3.0)
    wrong = _scale(recording, factor, 2.0 * factor, "elbow_q")
    wrong = _scale(wrong, factor, 0.0, "elbow_v")
    (fault,) = [f for f in check_telemetry(wrong, model) if "gyro" not in f.columns]
    assert fault.kind == "unit" and fault.is_decisive
    assert said in fault.seen
    if "range" in said:
        assert "to_range = [-2, 3]" in fault.describe()


@pytest.mark.parametrize(
    ("full", "said"), [(100, "percent of the range"), (255, "bytes, 0 to 255")]
)
def test_a_gripper_in_percent_is_told_by_its_range(torque_arm, full, said):
    model, recording = torque_arm
    e = recording.episodes["0"]
    # all that is known of a gripper is its position, from closed to open
    x = e.signals["elbow_q"].values
    x = full * (x - x.min()) / np.ptp(x)
    signals = {"grip": Signal(x, "joint_position", "elbow", "rad")}
    alone = replace(recording, episodes={"0": replace(e, signals=signals)})
    (fault,) = check_telemetry(alone, _limit(model, 1, 0.0, 0.9))
    assert (fault.kind, fault.target) == ("unit", "elbow")
    assert said in fault.seen and fault.is_decisive
    assert f"from_range = [0, {full}], to_range = [0, 0.9]" in fault.describe()


def test_a_range_that_is_too_narrow_is_no_unit(servo_arm):
    model, recording = servo_arm
    (fault,) = check_telemetry(recording, _limit(model, 1, 0.4, 0.45))
    assert fault.kind == "joint_range" and not fault.is_decisive


def _limit_command(model, control, low, high):
    limited = copy.copy(model)
    limited.actuator_ctrllimited[control] = 1
    limited.actuator_ctrlrange[control] = low, high
    return limited


def test_a_command_beyond_its_range_is_told_with_the_range_that_would_hold(servo_arm):
    model, recording = servo_arm
    sent = np.concatenate([e.ctrl[:, 1] for e in recording.episodes.values()])
    assert check_telemetry(recording, _limit_command(model, 1, -9, 9)) == []
    (fault,) = check_telemetry(recording, _limit_command(model, 1, -9, 0.5))
    assert (fault.kind, fault.columns) == ("command_range", ("e",))
    assert f"{sent.max():.4g}" in fault.describe() and not fault.is_decisive


def test_each_control_of_a_pid_has_its_own_range_and_all_one_unit(pid_arm):
    model, recording = pid_arm
    found = check_telemetry(recording, _limit_command(model, 0, -0.01, 0.01))
    assert [(f.kind, f.columns) for f in found] == [("command_range", ("s_pos",))]
    wrong = edit(recording, lambda t, x: x, ctrl=(57.3, 57.3, 1.0))
    found = check_telemetry(wrong, model)
    assert ("unit", ("s_pos", "s_vel")) in [(f.kind, f.columns) for f in found]


def _read_torques(recording, *columns):
    """The recording with the torques of both motors, from some columns of ctrl."""
    rng, episodes = np.random.default_rng(0), {}
    for k, e in recording.episodes.items():
        signals = dict(e.signals)
        for a, c in zip("se", columns, strict=True):
            read = e.ctrl[:, c] + rng.normal(0, 0.01, len(e.time))
            signals[f"tau_{a}"] = Signal(read, "joint_torque", a, "N m")
        episodes[k] = replace(e, signals=signals)
    return replace(recording, episodes=episodes)


def test_exchanged_torques_are_told(torque_arm):
    model, recording = torque_arm
    assert check_telemetry(_read_torques(recording, 0, 1), model) == []
    (fault,) = check_telemetry(_read_torques(recording, 1, 0), model)
    assert (fault.kind, set(fault.columns)) == ("exchange", {"tau_s", "tau_e"})
    assert '"tau_s": targets = ["e"]' in fault.describe()


@pytest.mark.parametrize(("jammed_from", "kinds"), [(1, set()), (0, {"unit"})])
def test_a_joint_that_jams_while_recorded_is_in_no_other_unit(
    servo_arm, jammed_from, kinds
):
    model, recording = servo_arm
    names = list(recording.episodes)[jammed_from:]
    later = {k: recording.episodes[k] for k in names}
    bent = _scale(replace(recording, episodes=later), 0.003, 0.2, "elbow_q", "elbow_v")
    jammed = replace(recording, episodes={**recording.episodes, **bent.episodes})
    found = {f.kind for f in check_telemetry(jammed, model) if f.is_decisive}
    assert found == kinds


KNEE = """<mujoco><worldbody>
  <body><joint name="knee" axis="0 1 0" range="-1 1" limited="true"/>
    <geom size="0.1"/><site name="foot"/></body></worldbody>
  <tendon><fixed name="rope"><joint joint="knee" coef="1"/></fixed></tendon>
  <actuator><motor joint="knee" forcerange="-9 9"/>{}</actuator></mujoco>"""


@pytest.mark.parametrize("place", ['tendon="rope"', 'site="foot"', 'body="world"'])
def test_only_actuators_at_a_joint_push_it_into_its_limit(place):
    kind = "adhesion" if "body" in place else "general"
    limits = 'forcerange="-99 99" ctrlrange="0 1"'
    alone, beside = (
        soften(mujoco.MjModel.from_xml_string(KNEE.format(more)), 0)
        for more in ("", f"<{kind} {place} {limits}/>")
    )
    assert 0 < alone == beside
