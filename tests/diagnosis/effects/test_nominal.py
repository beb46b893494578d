"""Which of a model's own numbers are fitted, and that a body stays possible."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.quadratic_model import stack_bounds
from tests.support.problems import list_nominal_terms
from tests.support.recorded_robots import ROBOTS, Robot, bench


@pytest.mark.parametrize("seed", range(5))
def test_a_body_that_tumbles_keeps_a_possible_inertia(seed, tmp_path):
    box = bench("box", tmp_path, episodes=1, seconds=0.3)
    terms = tuple(t for t in list_nominal_terms(box) if "second_moment" in t.targets[0])
    rng = np.random.default_rng(seed)
    low, high, _ = stack_bounds(terms)
    factors = rng.choice([low[0], high[0]], 3)
    before = box.simulator.compiler.nominal.body_inertia[-1]
    after = (
        box.simulator.compiler.compile_variant(terms)
        .build_model(terms, factors)
        .body_inertia[-1]
    )
    assert 2 * after.max() <= after.sum() * (1 + 1e-12)
    assert (np.abs(after / before - 1) <= 0.15 + 1e-12).all()
    moments = (x.sum() / 2 - x for x in (before, after))
    np.testing.assert_allclose(factors * next(moments), next(moments))


def test_a_box_in_contact_has_three_nominal_sizes_and_a_link_one_length(arm, tmp_path):
    box = bench("box", tmp_path, episodes=2, seconds=0.3)
    each = {
        b: [t.targets[0].split("/") for t in list_nominal_terms(b)] for b in (box, arm)
    }
    assert [w for _, w in each[box] if "size" in w] == ["size_x", "size_y", "size_z"]
    assert [b for b, w in each[arm] if w == "length"] == ["body:upper", "body:lower"]
    assert {w for b, w in each[arm] if w.startswith(("inertia", "second"))} == {
        "inertia"
    }
    term = next(t for t in list_nominal_terms(box) if t.targets[0].endswith("size_y"))
    model = box.simulator.compiler.compile_variant((term,)).build_model(
        (term,), np.array([1.02])
    )
    before = box.robot.model.geom_size[-1]
    np.testing.assert_allclose(model.geom_size[-1], before * [1, 1.02, 1])


@pytest.mark.parametrize(
    ("part", "shows"),
    [
        ('<geom size=".02" mass="0"/>', False),
        ('<geom size=".02" mass="0"/><site name="marker"/>', True),
        ('<geom size=".02" mass="0.01"/>', True),
    ],
)
def test_a_body_that_shows_in_no_reading_states_nothing(part, shows, tmp_path):
    foot = f'<body name="foot" pos="0 0 -.3">{part}</body>'
    xml = f"""<mujoco><option><flag contact="disable"/></option><worldbody>
      <body name="leg"><joint name="hip" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass=".2"/>{foot}
      </body></worldbody></mujoco>"""
    robot = Robot(
        xml,
        {"hip": ("joint_position", "hip", "rad")},
        lambda t, rng: np.zeros((len(t), 0)),
        lambda rng: (np.array([1.0]), np.zeros(1)),
    )
    b = bench(robot, tmp_path, episodes=1, seconds=0.3)
    terms = [*list_nominal_terms(b), *find_effect("mount_shift").propose_terms(b.robot)]
    assert any("body:foot" in t.targets[0] for t in terms) == shows


def test_a_servo_in_other_units_than_its_command_has_two_nominal_gains(tmp_path):
    own = '<position name="shoulder_servo" joint="shoulder" kp="20" kv="0.8"/>'
    geared = """<general name="shoulder_servo" joint="shoulder" gear="20" gainprm="2"
      biastype="affine" biasprm="0 -0.1 -0.002"/>"""
    robot = replace(ROBOTS["arm"], xml=ROBOTS["arm"].xml.replace(own, geared))
    b = bench(robot, tmp_path, episodes=1, seconds=0.3)
    words = [
        t.targets[0].split("/")
        for t in list_nominal_terms(b)
        if "servo" in t.targets[0]
    ]
    each = {name: [w for n, w in words if n == name] for name, _ in words}
    assert each["actuator:shoulder_servo"] == ["gain", "bias", "kv"]
    assert each["actuator:elbow_servo"] == ["kp", "kv"]
    assert (
        len(find_effect("rate_limit").propose_terms(b.robot)) == 2
    )  # both hold a position
