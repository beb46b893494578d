"""Backward steps: what costs nothing to take away, and exchanges."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.data.robot_summary import repeat_by_column
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.linearized_fit import LinearizedFit
from selfheal.diagnosis.selection.backward import (
    compute_removal_costs,
    eliminate_backward,
    exchange_term,
    fit_without,
)
from selfheal.diagnosis.selection.cross_validation import fit_and_score
from selfheal.diagnosis.selection.settings import SELECTION
from tests.support.problems import list_nominal_terms, make_problem

MORE_OIL = 8e-4  # [N m s/rad]; one column of readings just shows it


@pytest.mark.parametrize("hidden", [0.0, 0.05])
def test_a_rare_effect_takes_a_usual_ones_place_only_where_little_is_left(arm, hidden):
    dry = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    rare = find_effect("com_shift").propose_terms(arm.robot)[1]
    bias = find_effect("sensor_bias").propose_terms(arm.robot)[0]
    problem = make_problem(arm, (rare, bias), (0.01, 0.0, 0.0, hidden))
    now = fit_and_score(problem, (dry,), np.array([0.01]), iterations=4)
    rival = fit_and_score(problem, (rare,), np.zeros(3), iterations=4)
    assert rival.error < 0.9 * now.error
    new = exchange_term(now, dry, [rare])
    assert new.candidate is (dry if hidden else rare)
    assert exchange_term(rival, rare, [dry]) is rival


def test_a_limit_that_is_never_met_costs_nothing_to_take_away(arm):
    """A limit is exactly absent at infinity only."""
    problem, limit = (
        make_problem(arm),
        find_effect("torque_saturation").propose_terms(arm.robot)[0],
    )
    prices = []
    for value in (limit.high, 0.05 * limit.high):
        found = fit_parameters(problem, (limit,), value, iterations=0)
        prices.append(
            compute_removal_costs(LinearizedFit.from_fit(found), [limit])[limit]
        )
    assert prices[0] == pytest.approx(1) and 1 < prices[1] < np.inf


@pytest.mark.parametrize(("share", "stays"), [(1.15, False), (2.0, True)])
def test_a_value_stated_anew_that_the_model_may_state_needs_no_name(
    pendulum, share, stays
):
    stated = [t for t in list_nominal_terms(pendulum) if "damping" in t.targets[0]]
    oil = find_effect("viscous_friction").propose_terms(pendulum.robot)[0]
    truth = share * oil.parameters[0].nominal
    problem = make_problem(pendulum, (oil,), (truth,), noise=1e-5)
    problem = replace(problem, sigma=problem.sigma / 100)
    terms, start = (*stated, oil), np.append(np.ones(len(stated)), truth)
    found = fit_parameters(problem, terms, start, iterations=4)
    base = LinearizedFit.from_fit(found)
    cost = compute_removal_costs(base, [oil])[oil]
    less = fit_without(base, oil)
    assert (cost > 1.1) == stays == (less.cost > 1.1 * found.cost)
    left = eliminate_backward(found, len(stated))
    assert (oil in left.terms) == stays


def test_what_one_column_needs_stays_however_little_it_is_among_all(arm):
    """The friction of one joint hardly changes the sum over many noisy readings."""
    terms = tuple(find_effect("viscous_friction").propose_terms(arm.robot))
    given = np.array([t.parameters[0].nominal for t in terms])
    problem = make_problem(arm, terms, given + [MORE_OIL, 0.0])
    found = fit_parameters(problem, terms, given, iterations=20)
    base = LinearizedFit.from_fit(found)
    step = base.move(np.array([0]), given[:1] - found.values[:1])
    width = problem.segments.readings.shape[1]
    before, after = (
        (r.reshape(-1, width) ** 2).sum(axis=0)
        for r in (found.residuals, problem.residuals_at(terms, found.values + step))
    )
    scored = repeat_by_column(problem.simulator.channels, "is_scored")
    cost = compute_removal_costs(base, terms[:1])[terms[0]]
    assert cost == pytest.approx((after / before)[scored].max(), rel=1e-3)
    limit = 1 + SELECTION.removal_tolerance
    assert cost > limit > after.sum() / before.sum()
    assert eliminate_backward(found, 0).terms == terms[:1]


def test_a_fit_without_an_effect_is_close_where_it_may_be_needless(arm):
    """Here the other joint has no dry friction."""
    dry, other = find_effect("coulomb_friction").propose_terms(arm.robot)
    problem = make_problem(arm, (dry,), (0.1,))
    both = fit_parameters(problem, (dry, other), np.array([0.1, 0.0]))
    alone = fit_parameters(problem, (dry,), np.array([0.1]), iterations=20)
    base = LinearizedFit.from_fit(both)
    assert fit_without(base, other).cost == pytest.approx(alone.cost, rel=1e-3)
    assert fit_without(base, dry).cost > 2 * both.cost


def test_costs_of_removal_are_bounded_from_below_by_those_without_bounds(arm):
    names = ("coulomb_friction", "viscous_friction", "sensor_bias")
    usual = tuple(t for n in names for t in find_effect(n).propose_terms(arm.robot))
    absent = [p.nominal for t in usual for p in t.parameters]
    problem = make_problem(arm, usual[:1], (0.1,))
    start = np.array([0.1, *absent[1:]])
    found = fit_parameters(problem, usual, start, iterations=10)
    base, whole = LinearizedFit.from_fit(found), found.cost
    for removed in ([], list(usual[2:4])):
        left = [t for t in usual if t not in removed]
        bounds = base.bound_removal_costs(left, removed)
        for term, cost in compute_removal_costs(base, left, removed).items():
            assert 0 < bounds[term] <= (1 + 1e-6) * cost * whole
        assert bounds[usual[0]] > 2 * whole
