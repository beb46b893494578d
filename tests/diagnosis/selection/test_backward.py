"""Backward steps: what costs nothing to take away, and exchanges."""

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.candidate_fit import LinearizedFit
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.selection.backward import compute_removal_costs, exchange_term
from selfheal.diagnosis.selection.cross_validation import fit_and_score
from tests.support.problems import make_problem


@pytest.mark.parametrize("hidden", [0.0, 0.05])
def test_a_rare_effect_takes_a_usual_ones_place_only_where_little_is_left(arm, hidden):
    dry = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    rare = find_effect("com_shift").propose_terms(arm.robot)[1]
    bias = find_effect("sensor_bias").propose_terms(arm.robot)[0]
    problem = make_problem(arm, (rare, bias), (0.01, 0.0, 0.0, hidden))
    now = fit_and_score(problem, (dry,), np.array([0.01]), iterations=4)
    rival = fit_and_score(problem, (rare,), np.zeros(3), iterations=4)
    assert rival.error < 0.9 * now.error
    new = exchange_term(problem, now, dry, [rare])
    assert new.candidate is (dry if hidden else rare)
    assert exchange_term(problem, rival, rare, [dry]) is rival


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
            compute_removal_costs(LinearizedFit.from_fit(problem, found), 0)[limit]
        )
    assert prices[0] == pytest.approx(1) and 1 < prices[1] < np.inf
