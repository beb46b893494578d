"""Limits and friction that a model states and the robot does not have."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.limits import find_nominal_limit
from selfheal.diagnosis.output.document import list_parameters
from tests.support.effect_robots import (
    compile_patched,
    find_elbow_term,
    make_pendulum,
)
from tests.support.recorded_robots import ROBOTS, bench


def _edit(b, term, *values) -> mujoco.MjModel:
    variant = b.simulator.compiler.compile_variant([term])
    return variant.build_model([term], np.array(values))


@pytest.mark.parametrize(("side", "stop"), [(1, 0.9), (1, 0.2), (-1, -1.0), (-1, -0.1)])
def test_a_stop_takes_the_place_of_the_one_that_is_stated(side, stop, stating):
    b = stating["arm"]  # the elbow's range is -0.6 to 0.5
    term = find_elbow_term(b, "hard_stop", side=side)
    assert term.parameters[0].nominal == (0.5 if side > 0 else -0.6)
    new = _edit(b, term, stop, 0.01).joint("elbow").range
    np.testing.assert_allclose(new, (-0.6, stop) if side > 0 else (stop, 0.5))


def test_where_readings_pass_a_stated_stop_none_is_tried_too(tmp_path):
    """The robot's shoulder goes on where the model says that it stops."""
    old = 'name="shoulder"'
    xml = ROBOTS["arm"].xml.replace(old, f'{old} limited="true" range="-0.1 0.1"')

    def free(model):
        model.jnt_limited[0] = 0

    b = bench(replace(ROBOTS["arm"], xml=xml), tmp_path, change=free)
    terms = find_effect("hard_stop").propose_terms(b.robot)[:2]
    for term, side in zip(terms, (-1, 1), strict=True):
        joint = b.robot.joints[0]
        seen = joint.range_center + side * joint.range / 2
        assert any(side * (start[0] - seen) > 0 for start in term.initial_values)


def test_a_limit_beyond_the_stated_one_widens_it(stating):
    b = stating["arm"]  # the elbow's forcerange is -1 to 1.2
    term = find_elbow_term(b, "torque_saturation")
    assert term.parameters[0].nominal == 1.2
    for limit, expected in ((2.4, (-2, 2.4)), (1.2, (-1, 1.2)), (0.5, (-0.5, 0.5))):
        np.testing.assert_allclose(
            _edit(b, term, limit).actuator("elbow_servo").forcerange, expected
        )


@pytest.mark.parametrize(
    ("stated", "field"),
    [
        ('ctrlrange="-2 2" ctrllimited="true"', "actuator_ctrlrange"),
        ('forcerange="-3 3" forcelimited="true"', "actuator_forcerange"),
    ],
)
def test_a_motor_may_give_more_than_its_ranges_say(stated, field, tmp_path):
    """In the compiled model, and in the text of the patch."""
    servo = '<position name="servo" joint="hinge" kp="3" kv="0.1"/>'
    motor = f'<motor name="servo" joint="hinge" gear="2" {stated}/>'
    b = make_pendulum(tmp_path, **{servo: motor})
    (term,) = find_effect("torque_saturation").propose_terms(b.robot)
    now = find_nominal_limit(b.robot.model, 0)
    assert term.parameters[0].nominal == now == (4 if "ctrl" in field else 6)
    for new in (_edit(b, term, 2 * now), compile_patched(b, [term], [2 * now])):
        np.testing.assert_allclose(getattr(new, field)[0, 1], now)


def test_stated_friction_may_not_be_there(stating):
    b = stating["arm"]
    for name in ("coulomb_friction", "viscous_friction"):
        assert (0.0,) in find_elbow_term(b, name).initial_values


def test_a_finding_says_what_the_model_states(stating, benches):
    term = find_elbow_term(stating["arm"], "hard_stop", side=1)
    stop, soft = list_parameters(term, np.array([0.9, 0.01]), np.zeros(2))
    assert stop["given"] == 0.5 and "given" not in soft
    none = find_elbow_term(benches["arm"], "hard_stop", side=1)
    assert "given" not in list_parameters(none, np.array([0.9, 0.01]), np.zeros(2))[0]


def test_the_patch_states_the_new_limits(stating):
    b = stating["arm"]
    terms = (
        find_elbow_term(b, "hard_stop", side=1),
        find_elbow_term(b, "torque_saturation"),
        find_elbow_term(b, "coulomb_friction"),
    )
    new = compile_patched(b, terms, [0.9, 0.01, 2.4, 0.0])
    np.testing.assert_allclose(new.joint("elbow").range, (-0.6, 0.9))
    np.testing.assert_allclose(new.actuator("elbow_servo").forcerange, (-2, 2.4))
    assert new.dof_frictionloss[1] == 0
