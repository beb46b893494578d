"""What a model says of the columns that a log of its robot may have."""

import mujoco

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
