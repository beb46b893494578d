"""When a search ends: by what residuals leave, and by what stated values ask for."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.selection.search_state import SearchState
from tests.support.problems import list_nominal_terms, make_problem, with_contact


@pytest.mark.parametrize("dry", [0.0, 0.1])
def test_noise_is_explained_and_friction_is_not(arm, dry):
    (_, term) = find_effect("coulomb_friction").propose_terms(arm.robot)
    stated = list_nominal_terms(arm)
    ones = np.ones(len(stated))
    problem = make_problem(arm, (*stated, term), (*ones, dry))
    state = SearchState(fit_parameters(problem, stated, ones), len(stated), ())
    assert state.is_explained == state.is_complete == (not dry)


def test_stated_values_at_their_bounds_ask_for_an_effect(arm):
    stated = list_nominal_terms(arm)
    values = np.ones(len(stated))
    problem = make_problem(arm, stated, values)
    values[:4] = [t.high[0] for t in stated[:4]]
    at = replace(make_problem(arm, stated, values), segments=problem.segments)
    for each in (at, with_contact(at)):
        fit = fit_parameters(each, stated, values, iterations=0)
        fit = replace(fit, residuals=1e-3 * fit.residuals / np.abs(fit.residuals).max())
        state = SearchState(fit, len(stated), ())
        assert state.is_explained and not state.is_complete
