"""Actuators with several controls are checked as those with one."""

import copy

from selfheal.telemetry import examine_telemetry
from tests.support.logs.edited_logs import edit


def _find(model, recording, signals=1.0, ctrl=1.0):
    """Kinds and columns of the faults where columns of the shoulder are scaled."""
    columns = "shoulder_q", "shoulder_v"
    scaled = edit(recording, lambda t, x: signals * x, *columns, ctrl=ctrl)
    found = examine_telemetry(scaled, model)
    assert not found.unchecked
    return {(f.kind, *f.columns) for f in found.faults}


def test_a_right_log_of_a_pid_gives_no_alarm(pid_arm):
    assert _find(*pid_arm) == set()


def test_a_pid_tells_the_sign_of_its_joint(pid_arm):
    assert _find(*pid_arm, signals=-1.0) == {("sign", "shoulder_q", "shoulder_v")}


def test_all_commands_of_a_pid_are_in_another_unit_together(pid_arm):
    found = _find(*pid_arm, ctrl=(57.3, 57.3, 1.0))
    assert ("unit", "s_pos", "s_vel") in found


def test_a_command_beyond_the_range_of_its_control_is_told_by_its_name(pid_arm):
    model, recording = pid_arm
    narrow = copy.copy(model)
    narrow.actuator_ctrlrange[0] = -0.01, 0.01
    assert ("command_range", "s_pos") in _find(narrow, recording)
