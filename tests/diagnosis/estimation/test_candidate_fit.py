"""A candidate effect beside fitted values: planted ones are found; some diverge."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.terms import find_overridden
from selfheal.diagnosis.estimation.candidate_fit import fit_candidate
from selfheal.diagnosis.estimation.covariance import standard_errors
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.linearized_fit import LinearizedFit
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.estimation.settings import FIT
from tests.support.problems import Explosion, list_nominal_terms, make_problem

PLANTED = [
    ("arm", "coulomb_friction", 1, (0.1,)),
    pytest.param(("arm", "viscous_friction", 0, (0.8,)), marks=pytest.mark.slow),
    ("arm", "command_delay", 1, (0.025,)),
    pytest.param(("arm", "armature", 1, (0.02,)), marks=pytest.mark.slow),
    ("arm", "payload", 1, (0.1, 0.2, 0.0, 0.0)),
    ("arm", "torque_saturation", 0, (2.0,)),
    ("arm", "gravity_compensation", 0, (0.7,)),
    pytest.param(("arm", "clock_shift", 0, (0.02,)), marks=pytest.mark.slow),
    pytest.param(("arm", "torque_constant", 0, (0.6,)), marks=pytest.mark.slow),
    ("arm", "velocity_feedforward", 1, (0.05,)),
    pytest.param(("arm", "dead_band", 1, (0.3,)), marks=pytest.mark.slow),
    pytest.param(("cart_pole", "dead_band", 0, (0.4,)), marks=pytest.mark.slow),
    pytest.param(("arm", "sensor_bias", 1, (0.05,)), marks=pytest.mark.slow),
    ("pendulum", "coulomb_friction", 0, (0.05,)),
    pytest.param(("pendulum", "actuator_lag", 0, (0.05,)), marks=pytest.mark.slow),
    ("arm", "asymmetric_friction", 1, (0.05, 0.15)),
    ("pendulum", "sensor_delay", 0, (0.012,)),
    ("arm", "cogging", 1, (0.02, 11.0, 4.0)),
    pytest.param(("pendulum", "cogging", 0, (0.2, 7.0, 1.0)), marks=pytest.mark.slow),
    pytest.param(("cart_pole", "cogging", 0, (1.0, 30.0, 1.0)), marks=pytest.mark.slow),
]


@pytest.mark.parametrize("case", PLANTED, ids=lambda c: f"{c[0]}-{c[1]}")
def test_a_planted_effect_is_found_with_its_value(case, request):
    robot, name, place, values = case
    b = request.getfixturevalue(robot)
    stated, term = (
        list_nominal_terms(b),
        find_effect(name).propose_terms(b.robot)[place],
    )
    ones = np.ones(len(stated))
    problem = make_problem(b, (*stated, term), (*ones, *values))
    rough = replace(problem, sigma=_error_of(problem))
    base = LinearizedFit.from_fit(fit_parameters(rough, stated, ones, iterations=4))
    tried = fit_candidate(base, term)
    assert tried.cost < base.fit.cost
    found = fit_parameters(rough, tried.terms, tried.values, iterations=6)
    found = fit_parameters(problem, found.terms, found.values, iterations=6)
    error = FIT.interval_standard_errors * standard_errors(found)[-len(values) :]
    apart = np.abs(found.values[-len(values) :] - values)
    # twice a 90 % interval: never by chance
    assert apart[0] < 2 * error[0] + 0.02 * values[0]
    assert found.cost < 1.1 * np.isfinite(problem.segments.readings).sum()


def _error_of(problem: Problem) -> np.ndarray:
    """Error (C) of the given model, by which a search begins to weigh."""
    r = problem.compute_residuals((), np.zeros((1, 0)))[0].reshape(
        -1, len(problem.sigma)
    )
    return problem.sigma * np.sqrt((r**2).mean(axis=0))


def test_a_stiff_spring_and_its_reference_are_found_at_once(pendulum):
    (spring,) = find_effect("joint_spring").propose_terms(pendulum.robot)
    terms = (*list_nominal_terms(pendulum), spring)
    truth = np.append(np.full(len(terms) - 1, 1.05), (0.2, 0.3))
    problem = make_problem(pendulum, terms, truth)
    base = LinearizedFit.from_fit(fit_parameters(problem, terms[:-1], truth[:-2]))
    tried = fit_candidate(base, spring)
    np.testing.assert_allclose(tried.values[-2:], truth[-2:], rtol=0.25)
    assert tried.cost < 0.01 * base.fit.cost


def test_a_limit_that_is_never_met_is_lowered_until_it_acts(arm):
    (limit, *_), truth = find_effect("torque_saturation").propose_terms(arm.robot), 2.0
    problem = make_problem(arm, (limit,), np.array([truth]))
    base = LinearizedFit.from_fit(fit_parameters(problem, (), np.zeros(0)))
    unmet = replace(limit, initial_values=((30 * truth,),))
    begun = problem.residuals_at((unmet,), np.array([30 * truth]))
    np.testing.assert_allclose(begun, base.fit.residuals, atol=1e-9)
    tried = fit_candidate(base, unmet)
    assert tried.values[-1] == pytest.approx(truth, rel=0.1)
    assert tried.cost < 0.1 * base.fit.cost


def test_where_all_initial_values_diverge_nothing_more_is_simulated(pendulum):
    (boom,) = Explosion().propose_terms(pendulum.robot)
    problem = make_problem(pendulum)
    base = LinearizedFit.from_fit(fit_parameters(problem, (), np.zeros(0)))
    before = pendulum.simulator.counter.count
    with np.errstate(all="ignore"):
        fit_candidate(base, boom)
    asked = pendulum.simulator.counter.count - before
    assert asked == len(boom.initial_values) * len(problem.segments)


def test_a_nominal_value_that_an_effect_overrides_changes_no_residual(arm):
    stated = list_nominal_terms(arm)
    rotor = find_effect("armature").propose_terms(arm.robot)[1]
    ones = np.ones(len(stated))
    base = LinearizedFit.from_fit(fit_parameters(make_problem(arm), stated, ones))
    idle = find_overridden(rotor, stated)
    assert [stated[i].targets for i in idle] == [("joint:elbow/armature",)]
    tried = fit_candidate(base, rotor, iterations=1)
    moved = tried.values.copy()
    moved[idle] *= 1.1
    a, b = (base.problem.residuals_at(tried.terms, v) for v in (tried.values, moved))
    np.testing.assert_array_equal(a, b)
    assert not tried.jacobian[:, idle].any()
