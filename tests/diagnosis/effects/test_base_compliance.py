"""A base that rocks on its mount."""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.base_compliance import make_base_place
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.problem import Problem
from tests.support.effect_robots import make_effect_bench
from tests.support.patched_models import compile_patch
from tests.support.recorded_robots import ROBOTS

EFFECT = find_effect("base_compliance")
BOTH = {
    "shoulder": ("joint_position", "shoulder", "rad"),
    "elbow": ("joint_position", "elbow", "rad"),
    "tip": ("body_position", "lower", "m"),
}


@pytest.fixture(scope="module")
def standing(tmp_path_factory):
    robot = replace(ROBOTS["half_seen_arm"], signals=BOTH)
    return make_effect_bench(robot, tmp_path_factory.mktemp("standing"))


def test_a_base_that_is_bolted_down_has_a_term_about_each_horizontal_axis(standing):
    terms = EFFECT.propose_terms(standing.robot)
    assert [t.targets for t in terms] == 2 * [("body:stand",)]
    assert [t.finding_fields["axis"] for t in terms] == ["x", "y"]


@pytest.mark.parametrize("name", ["arm", "cart_pole", "box"])
def test_a_robot_without_a_body_at_its_base_has_no_mount_that_gives(name, benches):
    assert EFFECT.propose_terms(benches[name].robot) == []


def test_inertia_is_that_of_all_that_rocks():
    xml = """<mujoco><worldbody><body name="base"><geom size="0.01" mass="1"/>
      <body pos="0 0 0.5"><joint name="a" axis="0 1 0"/>
      <geom type="sphere" size="0.01" mass="2"/></body></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    for axis in ("x", "y"):
        inertia = make_base_place(model, 1, axis).inertia
        assert inertia == pytest.approx(2 * 0.5**2, rel=0.01)


def test_a_mount_that_gives_is_found_with_its_stiffness(standing):
    (_, term) = EFFECT.propose_terms(standing.robot)
    hidden = term.initial_values[0][0] * 1.7, term.initial_values[0][1]
    segments = cut_segments(standing.simulator.episodes, 150)
    readings = standing.simulator.leapfrog.simulate(
        (term,), np.array([hidden]), segments
    )[0]
    problem = Problem(
        standing.simulator, replace(segments, readings=readings), np.full(5, 1e-3)
    )
    fits = (
        fit_parameters(problem, (term,), np.array(start), iterations=12)
        for start in term.initial_values
    )
    best = min(fits, key=lambda fit: fit.cost)
    assert best.values == pytest.approx(hidden, rel=0.02)


def test_the_patch_has_a_hinge_at_the_base(standing, tmp_path):
    (_, term) = EFFECT.propose_terms(standing.robot)
    case = SimpleNamespace(
        compiler=standing.simulator.compiler,
        training=standing.simulator,
        robot=standing.robot,
    )
    new = compile_patch(case, [term], np.array([500.0, 2.0]), tmp_path)
    hinge = new.joint("stand_rocks_y")
    assert new.jnt_bodyid[hinge.id] == new.body("stand").id
    np.testing.assert_allclose(hinge.axis, (0, 1, 0))
    np.testing.assert_allclose((hinge.stiffness[0], hinge.damping[0]), (500, 2))
