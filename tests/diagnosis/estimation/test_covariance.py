"""Standard errors hold the truth as often as they say; what is unknown adds to them."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.covariance import (
    effective_sample_size,
    standard_errors,
)
from selfheal.diagnosis.estimation.least_squares import (
    fit_parameters,
    refine_jacobian,
    refine_undamped,
)
from selfheal.diagnosis.estimation.quadratic_model import prior_precision, stack_bounds
from selfheal.diagnosis.estimation.settings import FIT
from selfheal.diagnosis.simulation.simulator import COMMAND_LATENESS
from tests.support.problems import (
    ExactClockProblem,
    as_type,
    list_nominal_terms,
    make_problem,
)


@pytest.mark.slow
def test_intervals_hold_the_truth_where_only_the_prior_fixes_the_scale(pendulum):
    """Without torques all masses, gains and frictions are known up to one factor."""
    stated, term = (
        list_nominal_terms(pendulum),
        find_effect("coulomb_friction").propose_terms(pendulum.robot)[0],
    )
    terms, (low, high, _) = (*stated, term), stack_bounds(stated)
    rng, inside = np.random.default_rng(0), []
    for _ in range(12):
        drawn = 1 + (high - low) / 4 * rng.normal(size=len(stated))
        truth = np.append(np.clip(drawn, low, high), 0.05)
        problem = make_problem(pendulum, terms, truth)
        found = refine_undamped(fit_parameters(problem, terms, np.append(low, 0.03)))
        error = FIT.interval_standard_errors * standard_errors(found)
        inside.append(np.abs(found.values - truth) < error)
    assert np.mean(inside) > 0.75  # 0.9 is meant; of 96 that hang together


@pytest.mark.parametrize("noise", [1e-3, 1e-5])
def test_many_readings_make_no_nominal_value_less_certain(noise, pendulum):
    """Masses, gains and frictions are known up to one factor, which the prior fixes."""
    stated = list_nominal_terms(pendulum)
    problem = make_problem(pendulum, stated, np.ones(len(stated)), noise=noise)
    problem = replace(problem, sigma=np.full_like(problem.sigma, noise))
    found = refine_undamped(fit_parameters(problem, stated, np.ones(len(stated))))
    assert (standard_errors(found) < 2 / np.sqrt(prior_precision(stated))).all()


def test_the_scale_of_torques_is_no_more_certain_than_its_prior(pendulum):
    """Slopes over a search's moves bend, and their bend would pass for knowledge."""
    stated = list_nominal_terms(pendulum)
    problem = make_problem(pendulum, stated, np.ones(len(stated)), noise=1e-5)
    problem = replace(problem, sigma=np.full_like(problem.sigma, 1e-5))
    found = refine_jacobian(fit_parameters(problem, stated, np.full(len(stated), 1.01)))
    of_torque = np.array([not t.label.endswith("length") for t in stated])
    least = 1 / np.sqrt(prior_precision(stated)[of_torque].sum())
    assert (standard_errors(found)[of_torque] > 0.9 * least).all()


def test_intervals_consider_that_the_clock_is_not_known(arm):
    term = find_effect("command_delay").propose_terms(arm.robot)[0]
    problem = make_problem(arm, (term,), (0.01,))
    found = fit_parameters(problem, (term,), (0.01,))
    assert np.linalg.norm(found.clock_error()) > 0
    late = standard_errors(found)[0]
    on_time = replace(found, problem=as_type(problem, ExactClockProblem))
    exact = standard_errors(on_time)[0]
    clock = np.sqrt(late**2 - exact**2)
    assert 0.3 < clock / (COMMAND_LATENESS * arm.simulator.timestep) < 1.5


def test_errors_shrink_with_more_readings(arm):
    term = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    problem = make_problem(arm, (term,), (0.1,))
    few = problem.select(np.arange(0, len(problem.segments), 4))
    errors = [
        standard_errors(fit_parameters(p, (term,), (0.1,)))[0] for p in (few, problem)
    ]
    assert errors[1] < errors[0]


def test_what_data_do_not_answer_has_no_bound_on_its_error(arm):
    term = find_effect("sensor_bias").propose_terms(arm.robot)[0]
    problem = make_problem(arm)
    found = fit_parameters(problem, (term,), (0.0,))
    idle = replace(found, jacobian=np.hstack([found.jacobian, 0 * found.jacobian]),
                   terms=(term, term), values=np.zeros(2))  # fmt: skip
    assert np.isfinite(standard_errors(idle)).tolist() == [True, False]


def test_autocorrelated_samples_count_for_less(arm):
    problem = make_problem(arm)
    rng = np.random.default_rng(0)
    white = rng.normal(size=problem.segments.readings.size)
    width = problem.segments.readings.shape[1]
    smooth = white.reshape(-1, width).copy()
    for k in range(1, len(smooth)):
        smooth[k] = 0.9 * smooth[k - 1] + np.sqrt(1 - 0.81) * smooth[k]
    many, few = (
        effective_sample_size(problem, white),
        effective_sample_size(problem, smooth.ravel()),
    )
    assert 0.3 * white.size < many <= white.size
    assert few < 0.4 * many
