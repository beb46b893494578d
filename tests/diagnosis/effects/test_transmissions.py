"""Effects of actuators that drive a tendon or a site, and not one joint."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.problem import Problem
from tests.support.effect_robots import make_effect_bench
from tests.support.patched_models import compile_patch
from tests.support.recorded_robots import ROBOTS

SERVO = '<position name="servo" joint="hinge" kp="3" kv="0.1"/>'
# a goal of 0 to 255 for an angle of about -1.2 to 1.2
TENDON = (
    '<tendon><fixed name="cable"><joint joint="hinge" coef="0.5"/></fixed></tendon>'
)
FINGER = (
    '<general name="servo" tendon="cable" gainprm="0.05" biastype="affine" '
    'biasprm="-6 -12 -0.4"/>'
)
SITE = '<site name="tip" pos="0 0 -0.2"/>'
PUSH = '<motor name="servo" site="tip" gear="1 0 0 0 0 0"/>'
NAMES = ("command_delay", "actuator_lag", "torque_saturation")


def _steps(t, rng):
    """Goals that jump every 0.4 s."""
    jumps = rng.uniform(40, 215, 99)
    return jumps[(t / 0.4).astype(int)][:, None]


def _finger(folder):
    xml = ROBOTS["pendulum"].xml.replace("<actuator>", f"{TENDON}<actuator>")
    robot = replace(ROBOTS["pendulum"], xml=xml.replace(SERVO, FINGER), command=_steps)
    return make_effect_bench(robot, folder)


def _pushed(folder):
    xml = ROBOTS["pendulum"].xml.replace("</body>", f"{SITE}</body>")
    robot = replace(ROBOTS["pendulum"], xml=xml.replace(SERVO, PUSH))
    return make_effect_bench(robot, folder)


@pytest.mark.parametrize("name", [*NAMES, "servo_gain", "rate_limit", "dead_band"])
def test_a_tendons_actuator_has_the_effects_of_actuators(name, tmp_path):
    b = _finger(tmp_path)
    assert [t.targets for t in find_effect(name).propose_terms(b.robot)] == [
        ("actuator:servo",)
    ]


@pytest.mark.parametrize("name", [*NAMES, "servo_gain", "dead_band"])
def test_a_sites_actuator_has_the_effects_of_motors(name, tmp_path):
    b = _pushed(tmp_path)
    assert [t.targets for t in find_effect(name).propose_terms(b.robot)] == [
        ("actuator:servo",)
    ]
    assert not find_effect("rate_limit").propose_terms(b.robot)


def test_what_a_tendons_actuator_gives_is_told_by_its_length(tmp_path):
    (a,) = _finger(tmp_path).robot.actuators
    assert (a.unit, a.dof, a.servo) == ("rad", -1, False)
    assert 0.5 < a.max_force < 12  # and not 0.05 times 215


def test_a_rate_limit_is_found_in_the_units_of_the_command(tmp_path):
    b = _finger(tmp_path)
    (term,) = find_effect("rate_limit").propose_terms(b.robot)
    assert term.parameters[0].unit == "ctrl/s"
    segments = cut_segments(b.simulator.episodes, 150)
    hidden = np.array([[232.0]])
    readings = b.simulator.leapfrog.simulate((term,), hidden, segments)[0]
    problem = Problem(
        b.simulator, replace(segments, readings=readings), np.full(1, 1e-3)
    )
    starts = (np.array(start) for start in term.initial_values)
    fits = [fit_parameters(problem, (term,), start) for start in starts]
    best = min(fits, key=lambda fit: fit.cost)
    assert best.values == pytest.approx([232], rel=1e-3)


def test_a_gain_of_another_unit_changes_command_and_length_alike(tmp_path):
    b = _finger(tmp_path)
    (term,) = find_effect("servo_gain").propose_terms(b.robot)
    case = SimpleNamespace(
        compiler=b.simulator.compiler, training=b.simulator, robot=b.robot
    )
    new = compile_patch(case, [term], np.array([24.0, 0.8]), tmp_path)
    np.testing.assert_allclose(new.actuator_gainprm[0, 0], 0.1)
    np.testing.assert_allclose(new.actuator_biasprm[0, :3], (-6, -24, -0.8))
