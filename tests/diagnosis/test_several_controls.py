"""Actuators with several controls, or none: simulated, patched and replayed."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.data.robot_summary import min_stable_inertia
from selfheal.diagnosis.diagnose import diagnose
from selfheal.diagnosis.effects import find_effect, load_catalogue
from selfheal.diagnosis.effects.commands import CommandGrid
from selfheal.diagnosis.effects.nominal import build_nominal_terms
from selfheal.diagnosis.effects.places import ControlsPlace, locate_target
from selfheal.diagnosis.output.replay import replay_recording
from selfheal.diagnosis.simulation.batch import center_damping
from selfheal.diagnosis.simulation.build import build_simulator
from selfheal.diagnosis.simulation.dataset import cut_readable_segments
from selfheal.diagnosis.simulation.model_variants import (
    ModelCompiler,
    compute_inverse_inertias,
)
from selfheal.diagnosis.simulation.score import cut_replay_segments
from tests.support.diagnosis_folder import write_empty_diagnosis
from tests.support.effect_robots import (
    absent_values,
    check_replay,
    largest_change,
    make_effect_bench,
    present_values,
)
from tests.support.recorded_robots import ROBOTS, Robot, bench, record

SHOULDER = '<position name="shoulder_servo" joint="shoulder" kp="20" kv="0.8"/>'
# whose output is not at its id: that of a ball joint before it has three
WRIST_SERVO = '<orientation name="wrist_servo" joint="wrist" kp="3" kv="0.2"/>'
TURNED = f"""<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody>
  <body name="palm" pos="0 0 1"><joint name="wrist" type="ball" damping="0.02"/>
    <geom type="box" size="0.05 0.02 0.03" pos="0.01 0 -0.1" mass="0.3"/>
    <body name="tip" pos="0 0 -0.2"><joint name="bend" axis="0 1 0" damping="0.01"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.1" size="0.01" mass="0.1"/>
    </body></body></worldbody>
  <actuator>
    {WRIST_SERVO}
    <position name="bend_servo" joint="bend" kp="0.5" kv="0.01" gear="-2"/>
  </actuator></mujoco>"""
ANGLES = {n: ROBOTS["arm"].signals[n] for n in ("shoulder", "elbow")}


def _draw_commands(columns: int):
    """Slow sines, each control its own; they begin at 0, as MuJoCo's past commands."""

    def command(t, rng):
        f, p = rng.uniform(0.3, 1.2, columns), rng.uniform(0, 6, columns)
        waves = np.sin(2 * np.pi * f * t[:, None] + p)
        return np.minimum(1, 4 * t)[:, None] * waves

    return command


def _make_arm(shoulder: str, columns: int) -> Robot:
    """The arm with another servo, after which it has so many controls."""
    arm = ROBOTS["arm"]
    return replace(
        arm,
        xml=arm.xml.replace(SHOULDER, shoulder),
        signals={**arm.signals, "torque": ("joint_torque", "shoulder_servo", "N m")},
        command=_draw_commands(columns),
    )


def _make_pid(states: str = "") -> str:
    servo = '<pid name="shoulder_servo" joint="shoulder" kp="20" kv="0.8"'
    return f"{servo} {states}/>"


PID_ARM = _make_arm(_make_pid(), 3)
MOTOR = '<dcmotor name="shoulder_servo" joint="shoulder" motorconst="0.5" '
SERVO = "actuator:shoulder_servo"
KINDS = {
    "pid": PID_ARM,
    "pid of three": _make_arm(_make_pid('input="pos vel ff" gear="2"'), 4),
    "late pid": _make_arm(_make_pid('delay="0.01" nsample="8"'), 3),
    "idle motor": _make_arm(f'{MOTOR} resistance="1" input="none"/>', 1),
    "wrist": Robot(
        TURNED,
        {
            "turn": ("body_orientation", "palm", "quaternion"),
            "bend": ("joint_position", "bend", "rad"),
            "bend_torque": ("joint_torque", "bend_servo", "N m"),
        },
        _draw_commands(4),
        lambda rng: (np.array([1.0, 0, 0, 0, 0]), np.zeros(4)),
    ),
}


@pytest.fixture(scope="module")
def pid_arm(tmp_path_factory):
    return make_effect_bench(PID_ARM, tmp_path_factory.mktemp("pid_arm"))


@pytest.fixture(scope="module")
def wrist(tmp_path_factory):
    return make_effect_bench(KINDS["wrist"], tmp_path_factory.mktemp("wrist"))


@pytest.mark.parametrize("kind", KINDS)
def test_a_replay_is_what_plain_mujoco_does_with_the_same_ctrl(kind, tmp_path):
    robot = KINDS[kind]
    (tmp_path / "model.xml").write_text(robot.xml)
    truth = record(robot, episodes=1, seconds=0.5, finer=1, noise=0)
    out = write_empty_diagnosis(tmp_path / "out", tmp_path / "model.xml")
    (played,) = replay_recording(out, truth).episodes.values()
    for name, signal in truth.episodes["000"].signals.items():
        if name != "coarse":
            both = played.signals[name].values, signal.values
            np.testing.assert_allclose(*both, atol=1e-8, err_msg=name)


def test_a_replay_reads_columns_in_any_order_under_either_name(tmp_path):
    (tmp_path / "model.xml").write_text(PID_ARM.xml)
    truth = record(PID_ARM, episodes=1, seconds=0.3, finer=1, noise=0)
    out = write_empty_diagnosis(tmp_path / "out", tmp_path / "model.xml")
    names = ("elbow_servo", "shoulder_servo_vel", "shoulder_servo_pos")
    (episode,) = truth.episodes.values()
    turned = replace(episode, ctrl=episode.ctrl[:, [2, 1, 0]], ctrl_names=names)
    (played,) = replay_recording(
        out, replace(truth, episodes={"000": turned})
    ).episodes.values()
    assert played.ctrl_names == names
    for name in ANGLES:
        both = played.signals[name].values, episode.signals[name].values
        np.testing.assert_allclose(*both, atol=1e-8)


def test_a_torque_follows_a_step_of_any_control_at_once(tmp_path):
    """Though a simulation by leapfrog has the mean command around each step."""
    size = 0.5  # [rad/s] of the second control, whose gain is kv
    robot = replace(
        PID_ARM,
        command=lambda t, rng: size * np.sign(np.sin(20 * t[:, None])) * [0, 1, 0],
    )
    b = bench(robot, tmp_path, episodes=1, seconds=1.0, noise=1e-9)
    segments = cut_replay_segments(b.simulator)
    (c,) = (c for c in b.simulator.channels if c.name == "torque")
    plain = b.simulator.leapfrog.simulate([], np.zeros((1, 0)), segments)[0]
    apart = plain[:, c.columns] - segments.readings[:, c.columns]
    assert np.abs(apart).max() < 0.25 * 0.8 * size


def _terms_at(b, target):
    terms = [t for n in load_catalogue() for t in find_effect(n).propose_terms(b.robot)]
    return [t for t in terms if t.targets == (target,)]


AT_PID = {"command_delay", "rate_limit", "torque_saturation", "speed_torque_limit",
          "servo_gain", "integral_action"}  # fmt: skip


def test_all_effects_that_can_be_are_at_a_pid(pid_arm):
    """No lag: the text of a <pid> cannot say it."""
    found = {t.effect.name for t in _terms_at(pid_arm, SERVO)}
    assert found == AT_PID


def test_only_a_delay_is_at_a_servo_of_a_ball_joint(wrist):
    found = {t.effect.name for t in _terms_at(wrist, "actuator:wrist_servo")}
    assert found == {"command_delay"}


def test_what_is_known_of_an_actuator_is_the_same_behind_another():
    """Its number is that of neither its control nor its force."""
    servo, known = "actuator:bend_servo", []
    for xml in TURNED, TURNED.replace(WRIST_SERVO, ""):
        model = mujoco.MjModel.from_xml_string(xml)
        place, joint = locate_target(model, servo), model.joint("bend").id
        inertia = min_stable_inertia(model, joint)
        center_damping(model, 1e-4, compute_inverse_inertias(model))
        known.append((place.gear, inertia, model.dof_armature[place.dof]))
        assert place.controls == (place.goal,) == (model.nu - 1,)
        find_effect("torque_saturation").edit_model(model, place, np.array([3.0]))
        assert model.actuator_forcerange[place.actuator].tolist() == [-1.5, 1.5]
    assert known[0] == pytest.approx(known[1])


def test_an_actuator_without_controls_has_no_commands_to_change(tmp_path):
    b = make_effect_bench(KINDS["idle motor"], tmp_path)
    found = {t.effect.name for t in _terms_at(b, SERVO)}
    assert not found & {"command_delay", "actuator_lag", "rate_limit"}


@pytest.mark.parametrize("name", sorted(AT_PID))
def test_an_effect_at_a_pid_is_patched_and_replayed(name, pid_arm, tmp_path):
    """Absent it is not there, present it shows; the gains are re-fitted, too."""
    for n, term in enumerate(_terms_at(pid_arm, SERVO)):
        if term.effect.name == name:
            assert largest_change(pid_arm, (term,), absent_values(term)) < 1e-7
            assert largest_change(pid_arm, (term,), present_values(term)) > 1e-4
            check_replay(pid_arm, [term], tmp_path / str(n), 3e-6)


def test_a_delay_at_a_ball_joint_is_patched_and_replayed(wrist, tmp_path):
    (term,) = _terms_at(wrist, "actuator:wrist_servo")
    check_replay(wrist, [term], tmp_path / "out", 3e-6)


def test_a_delay_delays_all_controls_of_its_actuator_and_no_other():
    ctrl = np.random.default_rng(0).normal(size=(1, 9, 4))
    place, steps = ControlsPlace(controls=(1, 2)), 3
    late = find_effect("command_delay").transform_command(
        ctrl, CommandGrid(0.01), place, np.array([[steps * 0.01]])
    )
    np.testing.assert_array_equal(late[..., [0, 3]], ctrl[..., [0, 3]])
    np.testing.assert_allclose(late[:, steps:, 1:3], ctrl[:, :-steps, 1:3])


def test_a_pid_states_its_gains(tmp_path):
    b = bench(_make_arm(_make_pid('ki="5" imax="0.3"'), 3), tmp_path)
    stated = {t.targets[0]: t for t in build_nominal_terms(b.robot)}
    for field, value in {"kp": 20, "kv": 0.8, "ki": 5}.items():
        term = stated[f"actuator:shoulder_servo/{field}"]
        assert term.effect.value == value
    check = make_effect_bench(PID_ARM, tmp_path)
    assert "actuator:shoulder_servo/ki" not in {
        t.targets[0] for t in build_nominal_terms(check.robot)
    }


def test_gains_that_a_pid_states_are_patched(tmp_path):
    b = make_effect_bench(_make_arm(_make_pid('ki="5" imax="0.3"'), 3), tmp_path)
    check_replay(b, [], tmp_path / "out", 3e-6)


LATE = 'delay="0.04" nsample="80" interp="linear"'


@pytest.mark.parametrize("late", ["on time", "stated late", "found late"])
@pytest.mark.parametrize("states", ['ki="30"', 'slewmax="0.8"', 'ki="30" slewmax="2"'])
def test_the_state_of_a_pid_goes_on_where_a_segment_begins(states, late, tmp_path):
    own = states if late == "on time" else f"{states} {LATE}"
    robot = replace(
        _make_arm(_make_pid(own), 3),
        signals=ANGLES,
        command=lambda t, rng: np.sin(6 * t[:, None] + [0, 0, 2]) * [1, 0.2, 0.5],
        begin=lambda rng: (np.zeros(2), np.zeros(2)),
    )
    how = {"episodes": 1, "seconds": 3.0, "noise": 1e-6, "finer": 1}
    b, terms, values = bench(robot, tmp_path, **how), [], np.zeros((1, 0))
    if late == "found late":
        text = robot.xml.replace(LATE, "")
        (tmp_path / "model.xml").write_text(text)
        compiler = ModelCompiler(str(tmp_path / "model.xml"))
        b = replace(b, simulator=build_simulator(compiler, [b.recording]))
        terms = [t for t in _terms_at(b, SERVO) if t.effect.name == "command_delay"]
        values = np.array([[0.04]])
    segments = cut_readable_segments(b.simulator, 0.5)
    predicted = b.simulator.simulate(terms, values, segments)[0]
    assert np.ptp(segments.readings) > 0.3
    np.testing.assert_allclose(predicted, segments.readings, atol=5e-3)


@pytest.mark.slow
def test_a_late_pid_is_named(tmp_path):
    servo = '<position name="servo" joint="hinge" kp="3" kv="0.1"/>'
    pid = '<pid name="servo" joint="hinge" kp="3" kv="0.1"/>'
    robot = replace(
        ROBOTS["pendulum"],
        xml=ROBOTS["pendulum"].xml.replace(servo, pid),
        command=_draw_commands(2),
    )
    (tmp_path / "model.xml").write_text(robot.xml)
    late = pid.replace("/>", ' delay="0.03" nsample="80"/>')
    true = replace(robot, xml=robot.xml.replace(pid, late))
    recording = record(true, episodes=4, seconds=2.0)
    found = diagnose(tmp_path / "model.xml", [recording])
    (finding,) = found.document["findings"]
    assert finding["effect"] == "command_delay"
    assert finding["target"] == "actuator:servo"
    assert finding["parameters"][0]["value"] == pytest.approx(0.03, abs=0.003)
    model = mujoco.MjModel.from_xml_string(found.patched)
    assert model.actuator_delay[0] == pytest.approx(0.03, abs=0.003)
