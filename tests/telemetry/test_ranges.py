"""How far a joint may be beyond its range."""

import mujoco
import pytest

from selfheal.telemetry.ranges import soften

XML = """<mujoco><worldbody>
  <body><joint name="knee" axis="0 1 0" range="-1 1" limited="true"/>
    <geom size="0.1"/><site name="foot"/></body></worldbody>
  <tendon><fixed name="rope"><joint joint="knee" coef="1"/></fixed></tendon>
  <actuator><motor joint="knee" forcerange="-9 9"/>{}</actuator></mujoco>"""


@pytest.mark.parametrize("place", ['tendon="rope"', 'site="foot"', 'body="world"'])
def test_only_actuators_at_a_joint_push_it_into_its_limit(place):
    kind = "adhesion" if "body" in place else "general"
    limits = 'forcerange="-99 99" ctrlrange="0 1"'
    alone, beside = (
        soften(mujoco.MjModel.from_xml_string(XML.format(more)), 0)
        for more in ("", f"<{kind} {place} {limits}/>")
    )
    assert 0 < alone == beside
