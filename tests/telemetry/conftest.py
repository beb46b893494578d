"""An arm on servos that was recorded, as it is and with missing physics."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.recording import Episode, Recording, Signal
from tests.support.logs.edited_logs import RATE, drive

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default><joint damping="0.1" armature="0.01"/></default>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" range="-2 2" limited="true"/>
      <inertial pos="0 0 -0.12" mass="0.8" diaginertia="4e-3 4e-3 2e-4"/>
      <body name="lower" pos="0 0 -0.25">
        <joint name="elbow" axis="0 1 0"/>
        <inertial pos="0.01 0 -0.1" mass="0.4" diaginertia="2e-3 2e-3 1e-4"/>
        <site name="hand" pos="0 0 -0.2"/>
      </body>
    </body>
  </worldbody>
  <actuator>ACTUATORS</actuator>
  <sensor><gyro name="gyro" site="hand"/></sensor>
</mujoco>"""
SERVOS = """
    <position name="s" joint="shoulder" kp="30" kv="1.5"/>
    <position name="e" joint="elbow" kp="15" kv="0.8"/>"""
MOTORS = '<motor name="s" joint="shoulder"/><motor name="e" joint="elbow"/>'
JOINTS = ("shoulder", "elbow")
SECONDS, EPISODES = 5.0, 3


def _draw_goals(rng, time):
    waves = [
        rng.uniform(0.2, 0.5) * np.sin(2 * np.pi * f * time + rng.uniform(0, 6))
        for f in rng.uniform(0.2, 1.5, 6)
    ]
    return np.stack([sum(waves[:3]), 0.4 + sum(waves[3:])], axis=1)


def record(
    given: str, real: str | None = None, *, velocities: bool, count: int = EPISODES
) -> Recording:
    """What the arm `real` does; what is read has the noise of encoders."""
    rng = np.random.default_rng(3)
    model = mujoco.MjModel.from_xml_string(real or given)
    with_motors = "<motor" in given
    episodes = {}
    for k in range(count):
        data = mujoco.MjData(model)
        time = np.arange(int(SECONDS * RATE)) / RATE
        goals, rows = _draw_goals(rng, time), []
        for goal in goals:
            state = data.qpos.copy(), data.qvel.copy()
            torque = (20, 8) * (goal - state[0]) - (1, 0.5) * state[1]
            data.ctrl[:] = torque if with_motors else goal
            rows.append((*state, data.ctrl.copy(), data.sensordata.copy()))
            mujoco.mj_step(model, data, 5)
        q, v, u, gyro = map(np.array, zip(*rows, strict=True))
        signals = {}
        for j, name in enumerate(JOINTS):
            read = q[:, j] + rng.normal(0, 3e-4, len(time))
            signals[f"{name}_q"] = Signal(read, "joint_position", name, "rad")
            read = v[:, j] + rng.normal(0, 1e-2, len(time))
            if velocities:
                signals[f"{name}_v"] = Signal(read, "joint_velocity", name, "rad/s")
        gyro = gyro + rng.normal(0, 1e-2, gyro.shape)
        signals["gyro"] = Signal(gyro, "sensor", "gyro", "rad/s")
        episodes[str(k)] = Episode(time, u, ("s", "e"), signals)
    return Recording(episodes)


@pytest.fixture(scope="session")
def make_arm():
    """Compiles the arm with some actuators."""
    return lambda text: mujoco.MjModel.from_xml_string(ARM.replace("ACTUATORS", text))


@pytest.fixture(scope="session")
def servo_arm():
    """The servo arm: model and recording."""
    xml = ARM.replace("ACTUATORS", SERVOS)
    return mujoco.MjModel.from_xml_string(xml), record(xml, velocities=True)


@pytest.fixture(scope="session")
def pid_arm(servo_arm):
    """The servo arm with a <pid>, whose goal of velocity stays 0: the same law."""
    _, recording = servo_arm
    xml = ARM.replace("ACTUATORS", SERVOS)
    xml = xml.replace('<position name="s"', '<pid name="s" posrange="-1.5 1.5"')
    episodes = {
        k: replace(e, ctrl=np.insert(e.ctrl, 1, 0, axis=1), ctrl_names=("s", "s", "e"))
        for k, e in recording.episodes.items()
    }
    return mujoco.MjModel.from_xml_string(xml), replace(recording, episodes=episodes)


@pytest.fixture(scope="session")
def torque_arm():
    """The arm on motors, without velocities: model and recording."""
    xml = ARM.replace("ACTUATORS", MOTORS)
    return mujoco.MjModel.from_xml_string(xml), record(xml, velocities=False)


@pytest.fixture(scope="session")
def missing_physics():
    """The model of the servo arm, and a recording of one with more friction."""
    xml = ARM.replace("ACTUATORS", SERVOS)
    real = xml.replace('damping="0.1"', 'damping="0.4" frictionloss="0.3"')
    real = real.replace('mass="0.4"', 'mass="0.7"').replace('kp="15"', 'kp="9"')
    return mujoco.MjModel.from_xml_string(xml), record(xml, real, velocities=True)


@pytest.fixture(scope="session")
def arm_with_a_load():
    """The arm on motors, and a recording in which it has a load in episode 2 alone."""
    xml = ARM.replace("ACTUATORS", MOTORS)
    heavy = xml.replace('mass="0.4"', 'mass="1.2"')
    usual = record(xml, velocities=False, count=6)
    odd = record(xml, heavy, velocities=False, count=6).episodes["2"]
    both = replace(usual, episodes={**usual.episodes, "2": odd})
    return mujoco.MjModel.from_xml_string(xml), both


ROVER = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="20 20 .1"/>
    <body name="chassis" pos="0 0 .05">
      <freejoint/>
      <geom type="box" size=".15 .1 .02" mass="2" contype="0" conaffinity="0"/>
      <geom type="sphere" size=".02" pos=".12 0 -.03" mass=".05" friction=".01"/>
      <body name="lw" pos="-.05 .12 0">
        <joint name="left" axis="0 1 0" damping=".002" armature=".001"/>
        <geom type="cylinder" size=".05 .01" zaxis="0 1 0" mass=".15"/>
      </body>
      <body name="rw" pos="-.05 -.12 0">
        <joint name="right" axis="0 1 0" damping=".002" armature=".001"/>
        <geom type="cylinder" size=".05 .01" zaxis="0 1 0" mass=".15"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <velocity name="l" joint="left" kv=".05"/>
    <velocity name="r" joint="right" kv=".05"/>
  </actuator>
</mujoco>"""


@pytest.fixture(scope="session")
def rover():
    """A robot on two wheels and a caster: model and recording."""
    model = mujoco.MjModel.from_xml_string(ROVER)
    rng, episodes = np.random.default_rng(5), {}
    for k in range(EPISODES):
        time = np.arange(int(SECONDS * RATE)) / RATE
        goals = 12 * _draw_goals(rng, time)
        q = drive(model, goals) + rng.normal(0, 5e-4, (len(goals), model.nq))
        signals = {
            "place": Signal(q[:, :3], "body_position", "chassis", "m"),
            "turn": Signal(q[:, 3:7], "body_orientation", "chassis", "quaternion"),
            "left": Signal(q[:, 7], "joint_position", "left", "rad"),
            "right": Signal(q[:, 8], "joint_position", "right", "rad"),
        }
        episodes[str(k)] = Episode(time, goals, ("l", "r"), signals)
    return model, Recording(episodes)
