"""Effects of the world: the ground, wind and slopes."""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from tests.support.effect_robots import make_effect_bench, make_pendulum
from tests.support.recorded_robots import ROBOTS


def test_what_the_ground_is_like_is_what_its_contact_is_like(stating):
    b = stating["box"]
    for name, field, values in (
        ("ground_friction", "friction", (0.25,)),
        ("ground_compliance", "solref", (0.03, 0.4)),
    ):
        (term,) = find_effect(name).propose_terms(b.robot)
        plant = b.simulator.compiler.compile_variant([term])
        contact = _resting(plant.build_model([term], np.array(values)))
        told = np.atleast_1d(getattr(contact, field))[: len(values)]
        np.testing.assert_allclose(told, values)


@pytest.mark.parametrize("geom", ["floor", "box"])
def test_of_two_geoms_that_with_priority_says_what_the_contact_is_like(tmp_path, geom):
    marked = re.sub(f'name="{geom}" type', 'priority="1" \\g<0>', ROBOTS["box"].xml)
    b = make_effect_bench(replace(ROBOTS["box"], xml=marked), tmp_path)
    for name, field, values in (
        ("ground_friction", "friction", (0.25,)),
        ("ground_compliance", "solref", (0.03, 0.4)),
    ):
        (term,) = find_effect(name).propose_terms(b.robot)
        model = b.simulator.compiler.compile_variant([term]).build_model(
            [term], np.array(values)
        )
        told = np.atleast_1d(getattr(_resting(model), field))[: len(values)]
        np.testing.assert_allclose(told, values)
        changed = getattr(model, f"geom_{field}") != getattr(
            b.simulator.compiler.nominal, f"geom_{field}"
        )
        assert model.geom(int(np.flatnonzero(changed.any(axis=1))[0])).name == geom
        assert changed.any(axis=1).sum() == 1


def _resting(model):
    """A contact of the box that lies on the floor."""
    data = mujoco.MjData(model)
    data.qpos[:3] = 0, 0, 0.039
    mujoco.mj_forward(model, data)
    return data.contact[0]


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


def test_wind_needs_something_that_blows(tmp_path):
    still = make_pendulum(tmp_path)
    assert not find_effect("wind").propose_terms(still.robot)
    thick = make_pendulum(tmp_path, **{"<option": '<option viscosity="0.1"'})
    assert find_effect("wind").propose_terms(thick.robot)


@pytest.mark.parametrize(
    ("axis", "azimuths"),
    [("0 1 0", (0, 180)), ("1 1 0", (-45, 135)), ("1 0 0.5", (0, 90, 180, -90))],
)
def test_a_flat_robot_stands_on_no_slope_across_its_plane(axis, azimuths, tmp_path):
    b = make_pendulum(tmp_path, **{'axis="0 1 0"': f'axis="{axis}"'})
    starts = [
        s for t in find_effect("slope").propose_terms(b.robot) for s in t.initial_values
    ]
    told = np.rad2deg([azimuth for _, azimuth in starts])
    assert np.allclose(told, azimuths)


def test_what_moves_upright_alone_knows_no_slope(tmp_path):
    upright = {'type="hinge" axis="0 1 0"': 'type="slide" axis="0 0 1"'}
    b = make_pendulum(tmp_path, **upright)
    assert not find_effect("slope").propose_terms(b.robot)
