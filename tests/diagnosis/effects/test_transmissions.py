"""Effects of actuators that drive a tendon or a site, and not one joint."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from tests.support.effect_robots import compile_patched, make_effect_bench
from tests.support.problems import make_problem
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
NAMES = (
    "command_delay",
    "actuator_lag",
    "torque_saturation",
    "servo_gain",
    "rate_limit",
    "dead_band",
)


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


@pytest.mark.parametrize(
    ("make", "absent"), [(_finger, ()), (_pushed, ("rate_limit",))]
)
def test_what_drives_no_joint_has_the_effects_of_actuators(make, absent, tmp_path):
    """A tendon's those of servos, a site's those of motors."""
    robot = make(tmp_path).robot
    found = {n: [t.targets for t in find_effect(n).propose_terms(robot)] for n in NAMES}
    each = [("actuator:servo",)]
    assert found == {n: [] if n in absent else each for n in NAMES}


def test_what_a_tendons_actuator_gives_follows_from_its_length(tmp_path):
    (a,) = _finger(tmp_path).robot.actuators
    assert (a.unit, a.dof, a.servo) == ("rad", -1, False)
    assert 0.5 < a.max_force < 12  # and not 0.05 times 215


def test_a_rate_limit_is_found_in_the_units_of_the_command(tmp_path):
    b = _finger(tmp_path)
    (term,) = find_effect("rate_limit").propose_terms(b.robot)
    assert term.parameters[0].unit == "ctrl/s"
    problem = make_problem(b, (term,), [232.0], noise=0.0)
    starts = (np.array(start) for start in term.initial_values)
    fits = [fit_parameters(problem, (term,), start) for start in starts]
    best = min(fits, key=lambda fit: fit.cost)
    assert best.values == pytest.approx([232], rel=1e-3)


def test_a_gain_of_another_unit_changes_command_and_length_alike(tmp_path):
    b = _finger(tmp_path)
    (term,) = find_effect("servo_gain").propose_terms(b.robot)
    new = compile_patched(b, [term], [24.0, 0.8])
    np.testing.assert_allclose(new.actuator_gainprm[0, 0], 0.1)
    np.testing.assert_allclose(new.actuator_biasprm[0, :3], (-6, -24, -0.8))
