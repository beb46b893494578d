"""A common scale of position and command: told by gravity, never by a linear joint."""

import mujoco
import numpy as np
import pytest

from selfheal.recording import Recording
from selfheal.telemetry import check_telemetry
from tests.support.logs.edited_logs import DEGREES, RATE, drive

ROBOT = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast" gravity="GRAVITY"/>
  <worldbody>
    <body>
      <joint name="j" axis="0 1 0"JOINT/>
      <inertial pos="0.1 0 -0.2" mass="1" diaginertia="1e-3 1e-3 1e-3"/>
    </body>
  </worldbody>
  <actuator><position name="s" joint="j" kp="12" kv="1"/></actuator>
</mujoco>"""
DOWN, NONE = "0 0 -9.81", "0 0 0"


def _make(gravity, joint=""):
    xml = ROBOT.replace("GRAVITY", gravity).replace("JOINT", joint)
    return mujoco.MjModel.from_xml_string(xml)


def _record(model, scale):
    """What the joint does, with position and command written times `scale`."""
    rng, episodes = np.random.default_rng(1), {}
    for k in range(3):
        time = np.arange(600) / RATE
        goal = sum(
            rng.uniform(0.3, 0.6) * np.sin(2 * np.pi * f * time + rng.uniform(0, 6))
            for f in rng.uniform(0.2, 1.5, 3)
        )
        q = drive(model, goal[:, None])[:, 0] + rng.normal(0, 1e-4, len(goal))
        read = {"joint_position": {"j": scale * q}}
        made = Recording.from_arrays(time, {"s": scale * goal}, read)
        episodes[str(k)] = made.episodes["000"]
    return Recording(episodes)


def _units(recording, model):
    return [f.columns for f in check_telemetry(recording, model) if f.kind == "unit"]


def test_a_pendulum_under_gravity_tells_degrees_of_position_and_command():
    model = _make(DOWN)
    assert _units(_record(model, DEGREES), model) == [("j_position", "s")]
    assert _units(_record(model, 1.0), model) == []


@pytest.mark.parametrize("scale", [1.0, DEGREES, 1 / DEGREES])
def test_a_common_scale_of_a_linear_joint_is_not_claimed(scale):
    model = _make(NONE)
    assert _units(_record(model, scale), model) == []


@pytest.mark.parametrize("gravity", [DOWN, NONE])
def test_a_rotor_and_friction_that_the_model_lacks_are_no_unit(gravity):
    drive = ' armature="0.5" damping="0.6" frictionloss="1"'
    recording = _record(_make(gravity, drive), 1.0)
    assert _units(recording, _make(gravity)) == []
    model = _make(gravity)
    model.body_ipos[1] = 0.6, 0.0, -0.2
    assert _units(recording, model) == []
