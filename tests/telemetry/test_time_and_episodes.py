"""Faults along a log: repeated readings, clocks that drift, an episode that is odd."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.example.make import make_example
from selfheal.example.simulate import simulate_runs
from selfheal.recording import Recording, read
from selfheal.telemetry import check_telemetry
from selfheal.telemetry.residuals import Residuals
from tests.support.logs import newcomer_robots as robots
from tests.support.logs.edited_logs import edit, to_degrees

JOINTS = ("shoulder", "elbow")


def _delay(slope, constant):
    def change(time, x):
        late = time - constant - slope * time
        rows = x.reshape(len(time), -1).T
        return np.stack([np.interp(late, time, r) for r in rows], 1).reshape(x.shape)

    return change


READINGS = ("shoulder_q", "shoulder_v", "elbow_q", "elbow_v", "gyro")


@pytest.mark.parametrize("samples", [2, 7])
def test_readings_that_are_repeated_are_told(servo_arm, samples):
    model, recording = servo_arm
    held = edit(
        recording, lambda t, x: x[np.arange(len(x)) // samples * samples], "elbow_q"
    )
    (fault,) = [f for f in check_telemetry(held, model) if f.kind == "stale"]
    assert fault.columns == ("elbow_q",) and f"{samples} samples" in fault.seen
    assert not fault.is_decisive and "repeated cells" in fault.describe()


@pytest.mark.parametrize("quantum", [1e-3, 0.02, 0.2])
def test_a_coarse_encoder_repeats_nothing(servo_arm, quantum):
    model, recording = servo_arm
    coarse = edit(recording, lambda t, x: np.round(x / quantum) * quantum, "elbow_q")
    assert "stale" not in {f.kind for f in check_telemetry(coarse, model)}


@pytest.mark.parametrize("names", [READINGS, ("shoulder_v", "elbow_v")])
def test_a_clock_that_drifts_is_told(servo_arm, names):
    model, recording = servo_arm
    drifting = edit(recording, _delay(0.04, 0.0), *names)
    (fault,) = [f for f in check_telemetry(drifting, model) if f.kind == "clock_drift"]
    assert set(fault.columns) <= set(names) and "later" in fault.seen
    stretch = float(fault.corrections[0].split("stretch = ")[1])
    assert stretch == pytest.approx(0.96, abs=0.003)


def test_a_delay_that_stays_is_no_drift(servo_arm):
    model, recording = servo_arm
    late = edit(recording, _delay(0.0, 0.1), *READINGS)
    assert "clock_drift" not in {f.kind for f in check_telemetry(late, model)}


@pytest.mark.parametrize("factor", [-1.0, 180 / np.pi])
def test_a_column_that_is_wrong_in_one_episode_is_told_of_it(servo_arm, factor):
    model, recording = servo_arm
    odd = edit(recording, lambda t, x: factor * x, "elbow_q", "elbow_v", episodes="1")
    faults = check_telemetry(odd, model)
    assert {(f.kind, f.episodes) for f in faults} == {("odd_episode", ("1",))}
    assert not any(f.is_decisive for f in faults)


def test_a_unit_that_is_wrong_everywhere_makes_no_episode_odd(tmp_path):
    """Though torques, of angles 57 times as large, balance in none."""
    example = make_example("pendulum", tmp_path)
    recording = read(example.recording)
    wrong = edit(recording, to_degrees, "hinge_position", ctrl=np.rad2deg(1.0))
    model = mujoco.MjModel.from_xml_path(str(example.model))
    faults = check_telemetry(wrong, model)
    assert {f.kind for f in faults} == {"unit"}
    assert {f.episodes for f in faults} == {tuple(recording.episodes)}


def test_an_episode_with_a_load_is_told(arm_with_a_load):
    model, recording = arm_with_a_load
    (fault,) = check_telemetry(recording, model)
    assert (fault.kind, fault.episodes) == ("odd_episode", ("2",))
    assert not fault.is_decisive


def test_an_episode_with_another_zero_is_told(arm_with_a_load):
    model, recording = arm_with_a_load
    usual = {k: e for k, e in recording.episodes.items() if k != "2"}
    recording = replace(recording, episodes=usual)
    odd = edit(recording, lambda t, x: x + 0.6, "elbow_q", episodes="4")
    (fault,) = check_telemetry(odd, model)
    assert (fault.kind, fault.episodes) == ("odd_episode", ("4",))
    assert check_telemetry(recording, model) == []


def test_a_late_command_makes_an_episode_of_steps_no_odd_one():
    """It is seen where commands jump alone, as no sign and no load is."""
    servo = '<position name="{}" joint="{}" kp="15" kv="0.6"/>'
    text = robots.make_chain(dict.fromkeys(JOINTS, (-1.5, 1.5)), servo)
    model, episodes = mujoco.MjModel.from_xml_string(text), {}
    for k, run in enumerate(simulate_runs(text, lambda m: None, rate=100, seconds=6)):
        read = {
            "joint_position": run.position[:-4],
            "joint_velocity": run.velocity[:-4],
        }
        signals = {
            kind: dict(zip(JOINTS, values.T, strict=True))
            for kind, values in read.items()
        }
        ctrl = dict(zip(JOINTS, run.goal[4:].T, strict=True))
        made = Recording.from_arrays(run.time[:-4], ctrl, signals)
        episodes[str(k)] = made.episodes["000"]
    assert not check_telemetry(Recording(episodes), model)


def test_blocks_at_rest_do_not_hide_what_a_correction_explains():
    moving, rest = np.full((12, 1), 0.5), np.full((18, 1), 1e-6)
    share, left = np.array([0.2]), np.array([1e-3])
    given, explained = (
        Residuals(each, each, np.concatenate(blocks), each, np.ones(1))
        for each, blocks in ((share, (moving, rest)), (left, (moving / 500, 2 * rest)))
    )
    gain, p = explained.gain_over(given)
    assert gain > 2 and p < 1e-3
    assert given.gain_over(explained)[1] > 0.9
