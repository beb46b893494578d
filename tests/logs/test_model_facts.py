"""What a model says of the columns that a log of its robot may have."""

import mujoco
import pytest

from selfheal.logs.model_facts import list_places

XML = """<mujoco><worldbody>
  <body><joint name="knee" axis="0 1 0"/><geom size="0.1"/></body>
  <body><joint name="rail" type="slide"/><geom size="0.1"/></body></worldbody>
  <actuator>
    <pid name="leg" joint="knee" kp="2" kv="1" input="pos vel ff" posrange="-1 2"/>
    <position name="cart" joint="rail" kp="3" ctrlrange="0 4"/>
  </actuator></mujoco>"""


def test_every_control_has_its_own_name_unit_and_range():
    places = list_places(mujoco.MjModel.from_xml_string(XML))
    inf = float("inf")
    assert [
        (p.name, p.aliases, p.unit, p.low, p.high)
        for p in places
        if p.kind == "command"
    ] == [
        ("leg_pos", ("knee",), "rad", -1, 2),
        ("leg_vel", ("knee",), "rad/s", -inf, inf),
        ("leg_ff", ("knee",), "", -inf, inf),
        ("cart", ("rail",), "m", 0, 4),
    ]


SERVOS = """<mujoco><worldbody>
  <body><joint name="knee" axis="0 1 0"/><geom size="0.1"/>
    <site name="foot"/></body></worldbody>
  <tendon><fixed name="rope"><joint joint="knee" coef="1"/></fixed></tendon>
  <actuator>{}</actuator></mujoco>"""


@pytest.mark.parametrize(
    ("actuator", "unit"),
    [
        ('<motor joint="knee"/>', ""),
        ('<position joint="knee" kp="3" kv="1"/>', "rad"),
        ('<velocity joint="knee" kv="3"/>', "rad/s"),
        ('<damper joint="knee" kv="3" ctrlrange="0 1"/>', ""),
        ('<intvelocity joint="knee" kp="3" actrange="0 1"/>', "rad/s"),
        ('<pid joint="knee" kp="2" kv="1" input="pos"/>', "rad"),
        ('<pid joint="knee" kp="2" kv="1" input="vel"/>', "rad/s"),
        # a goal in encoder counts
        ('<general joint="knee" gainprm="2" biastype="affine" biasprm="0 -9 0"/>', ""),
        ('<position tendon="rope" kp="3"/>', ""),
        ('<general site="foot" gainprm="3"/>', ""),
    ],
)
def test_the_unit_of_a_command_is_that_of_what_a_servo_holds(actuator, unit):
    xml = SERVOS.format(actuator.replace(" ", ' name="a" ', 1))
    places = list_places(mujoco.MjModel.from_xml_string(xml))
    (command,) = (p for p in places if p.kind == "command")
    at_joint = "joint=" in actuator
    assert (command.unit, command.joint) == (unit, 0 if at_joint else -1)
    assert ("joint_torque" in {p.kind for p in places}) == at_joint
