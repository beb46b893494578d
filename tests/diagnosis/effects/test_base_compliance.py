"""A base that rocks on its mount."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.base_compliance import make_base_place
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from tests.support.effect_robots import compile_patched, make_effect_bench
from tests.support.problems import make_problem
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
    problem = make_problem(standing, (term,), hidden, noise=0.0)
    fits = (
        fit_parameters(problem, (term,), np.array(start), iterations=12)
        for start in term.initial_values
    )
    best = min(fits, key=lambda fit: fit.cost)
    assert best.values == pytest.approx(hidden, rel=0.02)


def test_the_patch_has_a_hinge_at_the_base(standing):
    (_, term) = EFFECT.propose_terms(standing.robot)
    new = compile_patched(standing, [term], [500.0, 2.0])
    hinge = new.joint("stand_rocks_y")
    assert new.jnt_bodyid[hinge.id] == new.body("stand").id
    np.testing.assert_allclose(hinge.axis, (0, 1, 0))
    np.testing.assert_allclose((hinge.stiffness[0], hinge.damping[0]), (500, 2))
