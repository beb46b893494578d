"""A candidate beside stated values: planted ones are found, diverging ones are not."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.base import Term
from selfheal.diagnosis.effects.terms import find_overridden
from selfheal.diagnosis.estimation.covariance import standard_errors
from selfheal.diagnosis.estimation.least_squares import fit_one_more, fit_parameters
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.estimation.settings import FIT
from selfheal.diagnosis.linear.fit import LinearFit, add_terms, refine, start_fit
from selfheal.diagnosis.linear.ranking import propose_directions, rank
from selfheal.diagnosis.linear.search import Search
from selfheal.diagnosis.linear.segment_errors import SegmentErrors
from tests.support.problems import Explosion, list_nominal_terms, make_problem

PLANTED = [
    ("arm", "coulomb_friction", 1, (0.1,)),
    ("arm", "command_delay", 1, (0.025,)),
    ("arm", "payload", 1, (0.1, 0.2, 0.0, 0.0)),
    ("pendulum", "coulomb_friction", 0, (0.05,)),
    ("pendulum", "sensor_delay", 0, (0.012,)),
]
PLANTED_TOO = [
    ("arm", "viscous_friction", 0, (0.8,)),
    ("arm", "armature", 1, (0.02,)),
    ("arm", "torque_saturation", 0, (2.0,)),
    ("arm", "gravity_compensation", 0, (0.7,)),
    ("arm", "clock_shift", 0, (0.02,)),
    ("arm", "torque_constant", 0, (0.6,)),
    ("arm", "velocity_feedforward", 1, (0.05,)),
    ("arm", "dead_band", 1, (0.3,)),
    ("arm", "sensor_bias", 1, (0.05,)),
    ("arm", "asymmetric_friction", 1, (0.05, 0.15)),
    ("arm", "cogging", 1, (0.02, 11.0, 4.0)),
    ("pendulum", "actuator_lag", 0, (0.05,)),
    ("pendulum", "cogging", 0, (0.2, 7.0, 1.0)),
    ("cart_pole", "dead_band", 0, (0.4,)),
    ("cart_pole", "thermal_derating", 0, (0.02, 1.5)),
    ("cart_pole", "cogging", 0, (1.0, 30.0, 1.0)),
]
PLANTED += [pytest.param(case, marks=pytest.mark.slow) for case in PLANTED_TOO]


def add_likeliest(fit: LinearFit, term: Term) -> LinearFit:
    """The fit with a term, begun in the direction that gains most."""
    found = propose_directions(fit, term)
    _, move, coordinates = rank(fit, [(d,) for d in found])[0]
    return refine(add_terms(fit, move, coordinates))


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
    before = start_fit(SegmentErrors(rough), stated)
    tried = add_likeliest(before, term)
    assert tried.cost < before.cost
    at = tried.values[: tried.count]
    found = fit_parameters(rough, tried.terms, at, iterations=6)
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


def test_a_diverging_candidate_never_wins_and_never_raises(pendulum):
    (boom,) = Explosion().propose_terms(pendulum.robot)
    dry = find_effect("coulomb_friction").propose_terms(pendulum.robot)[0]
    problem = make_problem(pendulum, (dry,), (0.05,))
    with np.errstate(all="ignore"):
        r = problem.compute_residuals((boom,), np.array([[25.0]]))
        assert np.abs(r).max() == FIT.max_residual
        fit = Search(start_fit(SegmentErrors(problem), ()), [boom, dry]).run()
    assert [t.key for t in fit.named] == [dry.key]


def test_a_nominal_value_that_an_effect_overrides_changes_no_residual(arm):
    stated = list_nominal_terms(arm)
    rotor = find_effect("armature").propose_terms(arm.robot)[1]
    base = fit_parameters(make_problem(arm), stated, np.ones(len(stated)))
    idle = find_overridden(rotor, stated)
    assert [stated[i].targets for i in idle] == [("joint:elbow/armature",)]
    start = np.array(rotor.initial_values[0])
    tried = fit_one_more(base, rotor, start, iterations=1)
    moved = tried.values.copy()
    moved[idle] *= 1.1
    a, b = (base.problem.residuals_at(tried.terms, v) for v in (tried.values, moved))
    np.testing.assert_array_equal(a, b)
    sizes = np.linalg.norm(tried.jacobian, axis=0)
    assert (sizes[idle] < 1e-3 * np.median(sizes)).all()
