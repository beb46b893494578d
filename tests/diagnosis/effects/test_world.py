"""Effects of the world: the ground, wind and slopes."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from tests.support.effect_robots import make_effect_bench, make_pendulum
from tests.support.recorded_robots import ROBOTS


def _change_ground(b) -> set[str]:
    """Change the ground, check the contact of a box on it; geoms that were changed."""
    changed = set()
    for name, field, values in (
        ("ground_friction", "friction", (0.25,)),
        ("ground_compliance", "solref", (0.03, 0.4)),
    ):
        (term,) = find_effect(name).propose_terms(b.robot)
        variant = b.simulator.compiler.compile_variant([term])
        model = variant.build_model([term], np.array(values))
        data = mujoco.MjData(model)
        data.qpos[:3] = 0, 0, 0.039
        mujoco.mj_forward(model, data)
        predicted = np.atleast_1d(getattr(data.contact[0], field))[: len(values)]
        np.testing.assert_allclose(predicted, values)
        both = [getattr(m, f"geom_{field}") for m in (model, variant.model)]
        differ = np.flatnonzero((both[0] != both[1]).any(axis=1))
        changed |= {model.geom(int(g)).name for g in differ}
    return changed


def test_what_the_ground_is_like_is_what_its_contact_is_like(stating):
    assert _change_ground(stating["box"]) == {"floor", "box"}


@pytest.mark.parametrize("geom", ["floor", "box"])
def test_of_two_geoms_that_with_priority_says_what_the_contact_is_like(tmp_path, geom):
    marked = re.sub(f'name="{geom}" type', 'priority="1" \\g<0>', ROBOTS["box"].xml)
    b = make_effect_bench(replace(ROBOTS["box"], xml=marked), tmp_path)
    assert _change_ground(b) == {geom}


def test_a_robot_that_touches_itself_needs_no_ground(tmp_path):
    signals = {"pole": ("joint_position", "pivot", "rad")}
    robot = replace(ROBOTS["cart_pole"], xml=CLAPPER, signals=signals)
    b = make_effect_bench(robot, tmp_path)
    assert b.robot.has_contact
    for name in ("ground_friction", "ground_compliance"):
        assert find_effect(name).propose_terms(b.robot) == []


CLAPPER = """<mujoco><option timestep="0.002"/><worldbody>
  <body name="left" pos="-0.02 0 1"><joint name="pivot" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.2"/></body>
  <body name="right" pos="0.02 0 1"><joint name="other" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.2"/></body>
  </worldbody><actuator><motor name="push" joint="pivot"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("axis", "azimuths"),
    [("0 1 0", (0, 180)), ("1 1 0", (-45, 135)), ("1 0 0.5", (0, 90, 180, -90))],
)
def test_a_flat_robot_stands_on_no_slope_across_its_plane(axis, azimuths, tmp_path):
    b = make_pendulum(tmp_path, **{'axis="0 1 0"': f'axis="{axis}"'})
    starts = [
        s for t in find_effect("slope").propose_terms(b.robot) for s in t.initial_values
    ]
    found = np.rad2deg([azimuth for _, azimuth in starts])
    assert np.allclose(found, azimuths)
