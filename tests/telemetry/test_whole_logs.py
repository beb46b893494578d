"""What is wrong with many columns of a log, or with an episode, is one fault."""

import copy
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.logs.log_map import ColumnRule, LogMap
from selfheal.telemetry import check_telemetry
from selfheal.telemetry.map_corrections import correct_rules
from tests.support.logs.edited_logs import DEGREES, edit, flip

MAP = LogMap(
    [
        ColumnRule("command", ["u0", "u1"], ["s", "e"], unit="rad"),
        ColumnRule("joint_position", "*_angle", ["shoulder", "elbow"], unit="rad"),
        ColumnRule("joint_velocity", "*_speed", unit="rad/s"),
    ]
)


POSITIONS = ("shoulder_q", "elbow_q")
COLUMNS = (*POSITIONS, "shoulder_v", "elbow_v")


@pytest.fixture
def limited(servo_arm):
    model, recording = servo_arm
    model = copy.copy(model)
    model.jnt_limited[:], model.jnt_range[:] = 1, (-2.0, 2.0)
    return model, recording


@pytest.mark.parametrize(
    ("read", "sent", "columns"),
    [
        (DEGREES, 1, {*COLUMNS}),
        (1, DEGREES, {"s", "e"}),
        (DEGREES, DEGREES, {*COLUMNS, "s", "e"}),
    ],
)
def test_a_unit_of_all_columns_is_one_fault(limited, read, sent, columns):
    model, recording = limited
    wrong = edit(recording, lambda t, x: read * x, *COLUMNS, ctrl=sent)
    (fault,) = check_telemetry(wrong, model)
    assert (fault.kind, set(fault.columns)) == ("unit", columns)
    rules = correct_rules(MAP, [fault], wrong)
    of_map = {"s": 0, "elbow_q": 1, "elbow_v": 2}
    assert set(rules) == {n for name, n in of_map.items() if name in columns}
    for (rule,) in rules.values():
        assert rule.scale == pytest.approx(1 / DEGREES)


def test_shares_of_ranges_that_are_read_as_degrees_are_told(limited):
    model, recording = limited
    model.jnt_range[:] = (-0.7, 0.9), (-0.6, 1.1)
    span, middle = np.ptp(model.jnt_range, axis=1), model.jnt_range.mean(axis=1)

    def share(values, joint=slice(None)):
        shares = (values - middle[joint]) * 200 / span[joint]
        return np.deg2rad(np.clip(shares, -100, 100))

    episodes = {
        k: replace(e, ctrl=share(e.ctrl)) for k, e in recording.episodes.items()
    }
    wrong = replace(recording, episodes=episodes)
    for j, name in enumerate(("shoulder", "elbow")):
        wrong = edit(wrong, lambda t, x, j=j: share(x, j), f"{name}_q")
        speed = np.deg2rad(200 / span[j])
        wrong = edit(wrong, lambda t, x, factor=speed: factor * x, f"{name}_v")
    faults = [f for f in check_telemetry(wrong, model) if f.kind == "unit"]
    (fault,) = faults
    assert "LeRobot" in fault.seen and "from_range = [-100, 100]" in fault.describe()
    rules = correct_rules(MAP, faults, wrong)
    assert {rule.from_range for (rule,) in rules.values()} == {(-100, 100)}
    assert {rule.unit for (rule,) in rules.values()} == {""}


def test_rows_of_zeros_are_told_and_mended_by_the_map(servo_arm):
    model, recording = servo_arm
    rows, others = np.arange(500) % 6 == 2, ("shoulder_v", "elbow_v", "gyro")
    wrong = edit(recording, lambda t, x: np.where(rows, 0, x), *POSITIONS)
    wrong = edit(wrong, lambda t, x: np.where(rows, np.nan, x.T).T, *others)
    (fault,) = check_telemetry(wrong, model)
    assert fault.kind == "zeros" and fault.is_decisive and "249 of 1500" in fault.seen
    ((rule,),) = correct_rules(MAP, [fault], wrong).values()
    assert rule == replace(MAP.signals[1], missing=0.0)


def test_a_joint_that_passes_zero_has_no_rows_of_zeros(servo_arm):
    model, recording = servo_arm
    coarse = edit(recording, lambda t, x: np.round(x / 0.02) * 0.02, *POSITIONS)
    assert "zeros" not in {f.kind for f in check_telemetry(coarse, model)}


@pytest.mark.parametrize("aborted", ["0", "1", "2"])
def test_a_short_episode_whose_drives_were_off_is_told_alone(servo_arm, aborted):
    model, recording = servo_arm
    e, rng, signals = recording.episodes[aborted], np.random.default_rng(0), {}
    for n, s in e.signals.items():
        read = s.values[:250].copy()
        still = read[80] if s.kind == "joint_position" else 0 * read[80]
        read[80:] = still + rng.normal(0, 3e-4, read[80:].shape)
        signals[n] = replace(s, values=read)
    e = replace(e, time=e.time[:250], ctrl=e.ctrl[:250], signals=signals)
    wrong = replace(recording, episodes={**recording.episodes, aborted: e})
    faults = check_telemetry(wrong, model)
    assert {(f.kind, f.episodes) for f in faults} == {("odd_episode", (aborted,))}


def test_an_episode_in_whose_end_no_motor_acts_is_told(torque_arm):
    """What is commanded goes on; nothing that the arm lacks explains such an end."""
    model, recording = torque_arm
    assert check_telemetry(recording, model) == []
    e = recording.episodes["1"]
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    data.qpos[:] = [e.signals[f"{j}_q"].values[250] for j in ("shoulder", "elbow")]
    signals = {n: s.values.copy() for n, s in e.signals.items()}
    for k in range(250, 500):
        mujoco.mj_forward(model, data)
        for j, name in enumerate(("shoulder", "elbow")):
            signals[f"{name}_q"][k] = data.qpos[j] + rng.normal(0, 3e-4)
        signals["gyro"][k] = data.sensordata + rng.normal(0, 1e-2, 3)
        mujoco.mj_step(model, data, 5)
    read = {n: replace(s, values=signals[n]) for n, s in e.signals.items()}
    e = replace(e, signals=read)
    wrong = replace(recording, episodes={**recording.episodes, "1": e})
    faults = check_telemetry(wrong, model)
    assert {(f.kind, f.episodes) for f in faults} == {("odd_episode", ("1",))}
    assert "nothing seems to drive" in faults[0].seen


def test_a_correction_parts_a_rule_where_one_column_differs(servo_arm):
    model, recording = servo_arm
    turned = edit(recording, flip, "elbow_q", "elbow_v")
    (fault,) = [f for f in check_telemetry(turned, model) if f.kind == "sign"]
    rules = correct_rules(MAP, [fault], turned)
    assert set(rules) <= {1, 2}
    assert rules[1][0].sign == [1, -1]
