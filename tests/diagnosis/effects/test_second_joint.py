"""A joint that an effect adds behind a joint of the model."""

import re
from dataclasses import replace

import pytest

from selfheal.diagnosis.effects import find_effect
from tests.support.effect_robots import (
    check_replay,
    find_elbow_term,
    make_effect_bench,
    make_pendulum,
)
from tests.support.recorded_robots import ROBOTS


@pytest.mark.parametrize("name", ["backlash", "compliance"])
def test_a_second_joint_inherits_nothing_and_counts_in_the_models_unit(name, tmp_path):
    b = make_pendulum(tmp_path, **HEIRS)
    for n, term in enumerate(find_effect(name).propose_terms(b.robot)):
        check_replay(b, [term], tmp_path / str(n), 3e-6)


# a joint in degrees, in a frame, with defaults that a second one must not take over
HEIRS = {
    "<worldbody>": '<default><joint damping="0.02 0.01" armature="0.002" margin="0.1" '
    'stiffness="0.3 0.1" springref="20" frictionloss="0.01" range="-200 200" '
    'solimplimit="0.5 0.6 0.01"/></default>\n  <worldbody>',
    '<joint name="hinge" type="hinge" axis="0 1 0"': '<frame euler="0 0 90">'
    '<joint name="hinge" axis="1 0 0" stiffness="0"',
    'armature="0.002"/>\n': 'armature="0.002"/></frame>\n',
}


def test_a_second_joint_stands_behind_the_last_of_a_body(tmp_path):
    xml = ROBOTS["arm"].xml
    shoulder, elbow = re.findall("<joint name=.*?/>", xml)
    xml = xml.replace(elbow, "").replace(shoulder, shoulder + elbow)
    b = make_effect_bench(replace(ROBOTS["arm"], xml=xml), tmp_path)
    for name in ("backlash", "compliance"):
        found = {t.targets for t in find_effect(name).propose_terms(b.robot)}
        assert found == {("joint:elbow",)}


def test_two_joints_with_play_are_one_each(benches, tmp_path):
    b = benches["arm"]
    found = find_effect("backlash").propose_terms(b.robot)
    terms = [t for t in found if t.finding_fields["measured"] == "motor"]
    assert len(terms) == 2
    check_replay(b, terms, tmp_path / "both", 3e-6)


def test_a_joint_with_play_may_bend_too(benches, tmp_path):
    """What lies between has some inertia: MuJoCo warns where it has none."""
    b = benches["arm"]
    own = [find_elbow_term(b, n, measured="motor") for n in ("compliance", "backlash")]
    plant = b.simulator.compiler.compile_variant(own)
    assert (plant.model.dof_armature > 0).sum() == plant.model.nv - 1
    check_replay(b, own, tmp_path / "both", 3e-5)


def test_a_joints_own_name_may_end_as_an_added_ones(tmp_path):
    """As a robot's elbow_flex; what a patch adds to it is known all the same."""
    text, robot = ROBOTS["arm"].xml, ROBOTS["arm"]
    for old, name in (("shoulder", "shoulder_play"), ("elbow", "elbow_flex")):
        text = text.replace(f'name="{old}" type', f'name="{name}" type')
        text = text.replace(f'joint="{old}"', f'joint="{name}"')
    signals = {"elbow": ("joint_position", "elbow_flex", "rad")}
    b = make_effect_bench(replace(robot, xml=text, signals=signals), tmp_path)
    terms = [
        find_effect(name).propose_terms(b.robot) for name in ("backlash", "compliance")
    ]
    assert len(terms[0]) == len(terms[1]) == 3
    for n, own in enumerate(terms):
        check_replay(b, [own[0], own[1]], tmp_path / str(n), 3e-6)


def test_a_second_joint_takes_no_name_that_the_model_has(tmp_path):
    text = ROBOTS["arm"].xml.replace('"shoulder"', '"elbow_flex"')
    signals = {"elbow": ("joint_position", "elbow", "rad")}
    b = make_effect_bench(replace(ROBOTS["arm"], xml=text, signals=signals), tmp_path)
    found = {t.targets for t in find_effect("compliance").propose_terms(b.robot)}
    assert found == {("joint:elbow_flex",)}
