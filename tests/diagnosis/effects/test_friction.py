"""Friction of joints: each law becomes the plainer one where it has to."""

from types import SimpleNamespace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.terms import is_distinct
from tests.support.effect_robots import find_elbow_term, largest_change, predict


def test_dry_friction_without_its_peculiarity_is_coulomb_friction(stating):
    b = stating["arm"]
    plain = predict(b, (find_elbow_term(b, "coulomb_friction"), 0.12))
    stribeck = predict(b, (find_elbow_term(b, "stribeck_friction"), (0.12, 0.12, 0.1)))
    asymmetric = predict(b, (find_elbow_term(b, "asymmetric_friction"), (0.12, 0.12)))
    np.testing.assert_allclose(stribeck, plain, atol=1e-9)
    np.testing.assert_allclose(asymmetric, plain, atol=1e-9)


@pytest.mark.parametrize("name", ["stribeck_friction", "asymmetric_friction"])
def test_dry_friction_adds_to_that_of_the_load_in_any_order(name, stating):
    b = stating["arm"]
    load = find_elbow_term(b, "load_dependent_friction"), 0.2
    own = (
        find_elbow_term(b, name),
        (0.1, 0.2, 0.1)[: len(find_elbow_term(b, name).parameters)],
    )
    both = predict(b, load, own)
    np.testing.assert_allclose(both, predict(b, own, load), atol=1e-9)
    assert np.abs(both - predict(b, own)).max() > 1e-4


def test_a_load_rubs_in_a_gear_whose_motor_gives_nothing(benches):
    """The load is then the mean of both sides of the gear, not the motor's torque."""
    b = benches["arm"]
    motor = find_elbow_term(b, "load_dependent_friction")
    both = find_elbow_term(b, "load_dependent_friction", side="both")
    assert motor.key != both.key and not is_distinct(both, [motor])
    still = SimpleNamespace(
        actuator_torque=np.array([[0.0, 0.0], [0.3, 0.4], [0.0, -0.4]]),
        bias_torque=np.array([[0.5, -0.6], [0.3, 0.4], [0.0, 0.4]]),
    )
    for term, torque in (motor, [0.0, 0.4, 0.4]), (both, [0.3, 0.4, 0.0]):
        still.frictionloss = np.full((3, 2), 0.1)
        term.effect.apply_forces(still, term.places[0], np.full((3, 1), 0.2))
        rubs = np.stack([np.full(3, 0.1), 0.1 + 0.2 * np.array(torque)], axis=1)
        np.testing.assert_allclose(still.frictionloss, rubs)
    assert largest_change(b, (both,), (0.2,)) > 1e-3


def test_friction_may_be_as_large_as_what_motors_were_asked_for(benches):
    b = benches["cart_pole"]  # without gravity on its rail, and a motor
    (push,) = b.robot.actuators
    for name in ("coulomb_friction", "stribeck_friction", "asymmetric_friction"):
        rail, _ = find_effect(name).propose_terms(b.robot)
        assert (rail.high[:2] >= 0.99 * push.max_force).all()
