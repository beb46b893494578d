"""Faults of the set-up are told with the line that mends them, and nothing else is."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.recording import Recording, Signal
from selfheal.telemetry import check_telemetry, examine_telemetry
from tests.support.logs.edited_logs import RATE, drive

LEG = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body name="trunk" pos="0 0 1">
      BASE
      <geom type="box" size=".1 .1 .05" mass="3"/>
      <body name="thigh" pos="0 0 -.05">
        <joint name="hip" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".03" mass="1"/>
        <body name="shank" pos="0 0 -.25">
          <joint name="knee" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 -.02 0 0 -.2" size=".02" mass=".4"/>
        </body>
      </body>
    </body>
  </worldbody>
  MORE
  <actuator>
    <position name="h" joint="hip" kp="40" kv="2"/>
    <position name="k" joint="knee" kp="25" kv="1"/>
  </actuator>
</mujoco>"""
APART = '<contact><exclude body1="trunk" body2="thigh"/></contact>'
GROUND = '<geom type="plane" size="2 2 .1" pos="0 0 -1"/>'


def _compile(base="", more=""):
    xml = LEG.replace("BASE", base).replace("MORE", more)
    return mujoco.MjModel.from_xml_string(xml)


@pytest.fixture(scope="module")
def leg():
    """What a leg that hangs from a stand did."""
    model, rng = _compile(more=APART), np.random.default_rng(1)
    time = np.arange(800) / RATE
    goals = np.stack([0.7 * np.sin(2 * time), 0.5 * np.sin(5 * time)], axis=1)
    rows = drive(model, goals) + rng.normal(0, 3e-4, goals.shape)
    ctrl = dict(zip("hk", goals.T, strict=True))
    read = dict(zip(("hip", "knee"), rows.T, strict=True))
    return Recording.from_arrays(time, ctrl, {"joint_position": read})


def test_goals_that_are_sent_to_motors_are_told_with_the_servos(servo_arm, make_arm):
    motors = '<motor name="s" joint="shoulder"/><motor name="e" joint="elbow"/>'
    model = make_arm(motors)
    found = check_telemetry(servo_arm[1], model)
    assert [(f.kind, f.columns, f.target) for f in found] == [
        ("actuator_type", ("s",), "shoulder"),
        ("actuator_type", ("e",), "elbow"),
    ]
    assert all(f.is_decisive for f in found)
    assert '<position name="e" joint="elbow" kp="KP" kv="KV"/>' in map(
        str, found[1].corrections
    )
    assert "selfheal model prepare" in found[1].corrections[1]


def test_torques_that_hold_a_weight_are_no_goals():
    """They move as the joint does, with a factor near 1."""
    xml = """<mujoco><worldbody><body><joint name="j" axis="0 1 0" damping=".02"/>
    <inertial pos="0 0 -.2" mass=".5" diaginertia="1e-3 1e-3 1e-3"/></body></worldbody>
    <actuator><motor name="m" joint="j"/></actuator></mujoco>"""
    time, rng = np.arange(3000) / 100, np.random.default_rng(0)
    angle = 0.4 * np.sin(0.5 * time) + 0.1 * np.sin(1.3 * time)
    torque = 0.5 * 9.81 * 0.2 * np.sin(angle)
    read = {"joint_position": {"j": angle + rng.normal(0, 1e-3, 3000)}}
    recording = Recording.from_arrays(time, {"m": torque}, read)
    assert check_telemetry(recording, mujoco.MjModel.from_xml_string(xml)) == []


def test_a_driven_robot_without_actuators_is_told(servo_arm, make_arm):
    episodes = {
        k: replace(e, ctrl=e.ctrl[:, :0], ctrl_names=())
        for k, e in servo_arm[1].episodes.items()
    }
    (fault,) = check_telemetry(Recording(episodes), make_arm(""))
    assert fault.kind == "no_actuator" and fault.is_decisive
    assert "selfheal model prepare" in fault.corrections[0]


def test_a_robot_that_nothing_drives_needs_no_actuators(make_arm):
    real, rng = make_arm(""), np.random.default_rng(2)
    real.dof_damping[:] = 0.02  # a fifth of the model's
    data, time, rows = mujoco.MjData(real), np.arange(1000) / 100, []
    data.qpos[:] = 1.2, -0.8
    for _ in time:
        rows.append(data.qpos + rng.normal(0, 3e-4, 2))
        mujoco.mj_step(real, data, 5)
    read = dict(zip(("shoulder", "elbow"), np.array(rows).T, strict=True))
    swing = Recording.from_arrays(time, {}, {"joint_position": read})
    found = examine_telemetry(swing, make_arm(""))
    assert found.faults == () and found.unchecked == ()


def test_a_base_that_falls_unread_is_told_by_its_body(leg):
    (fault,) = check_telemetry(leg, _compile("<freejoint/>", APART))
    assert (fault.kind, fault.target) == ("free_base", "trunk") and fault.is_decisive
    assert "leave out the free joint of trunk" in fault.corrections[0]
    assert '"body_orientation", targets = ["trunk"]' in fault.corrections[1]


def test_a_base_that_is_read_or_stands_is_no_fault(leg):
    model, (episode,) = _compile("<freejoint/>"), leg.episodes.values()
    still = np.tile(model.qpos0[:7], (episode.time.size, 1))
    pose = {
        "place": Signal(still[:, :3], "body_position", "trunk", "m"),
        "turn": Signal(still[:, 3:], "body_orientation", "trunk", "quaternion"),
    }
    read = replace(episode, signals={**episode.signals, **pose})
    found = check_telemetry(replace(leg, episodes={"0": read}), model)
    assert "free_base" not in {f.kind for f in found}
    on_ground = LEG.replace("BASE", "<freejoint/>").replace("MORE", "")
    on_ground = on_ground.replace("<worldbody>", f"<worldbody>{GROUND}")
    found = examine_telemetry(leg, mujoco.MjModel.from_xml_string(on_ground))
    assert found.faults == () and "'trunk'" in found.unchecked[0]


def test_a_loose_body_that_nobody_asks_about_is_no_base(leg):
    loose = '<body name="ball" pos="1 0 0"><freejoint/><geom size=".01"/></body>'
    xml = LEG.replace("BASE", "").replace("MORE", APART)
    model = mujoco.MjModel.from_xml_string(
        xml.replace("</worldbody>", f"{loose}</worldbody>")
    )
    assert check_telemetry(leg, model) == []


def test_bodies_that_always_touch_are_told_with_the_line_that_parts_them(leg):
    (fault,) = check_telemetry(leg, _compile())
    assert fault.kind == "permanent_contact" and not fault.is_decisive
    assert f"<contact>{fault.corrections[0]}</contact>" == APART
    assert check_telemetry(leg, _compile(more=APART)) == []


def test_the_world_itself_is_parted_from_what_hangs_in_it(leg):
    xml = LEG.replace('<geom type="box" size=".1 .1 .05" mass="3"/>', "")
    box = '<geom type="box" size=".1 .1 .05" pos="0 0 1"/>'
    xml = xml.replace("<worldbody>", f"<worldbody>{box}").replace("BASE", "")
    (fault,) = check_telemetry(
        leg, mujoco.MjModel.from_xml_string(xml.replace("MORE", ""))
    )
    parted = mujoco.MjModel.from_xml_string(
        xml.replace("MORE", f"<contact>{fault.corrections[0]}</contact>")
    )
    assert check_telemetry(leg, parted) == []


def test_a_wheel_on_its_ground_and_a_touch_that_ends_are_no_fault(rover, leg):
    assert check_telemetry(rover[1], rover[0]) == []
    stop = '<geom type="box" size=".02 .1 .02" pos=".12 0 .85"/>'
    xml = LEG.replace("BASE", "").replace("MORE", APART)
    model = mujoco.MjModel.from_xml_string(
        xml.replace("<worldbody>", f"<worldbody>{stop}")
    )
    assert check_telemetry(leg, model) == []
