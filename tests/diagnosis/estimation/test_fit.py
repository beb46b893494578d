"""A fit is one of its own problem."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.estimation.least_squares import fit_parameters
from tests.support.problems import list_nominal_terms, make_problem


def test_a_fit_has_the_residuals_and_the_jacobian_of_its_own_problem(arm):
    problem, terms = make_problem(arm), list_nominal_terms(arm)
    fit = fit_parameters(problem, terms, np.ones(len(terms)), iterations=0)
    other = problem.select(np.arange(3))
    for mixed in (
        {"problem": other},
        {"residuals": other.residuals_at(fit.terms, fit.values)},
        {"jacobian": fit.jacobian[:-1]},
        {"jacobian": fit.jacobian[:, :-1]},
        {"values": fit.values[:-1]},
    ):
        with pytest.raises(ValueError, match="residuals and Jacobian"):
            replace(fit, **mixed)
