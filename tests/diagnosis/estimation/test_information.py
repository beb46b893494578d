"""Gram matrices say what recordings tell only together."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.information import Information
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from tests.support.problems import list_nominal_terms, make_problem


def _fit(pendulum):
    """A fit of dry friction and of what the model states, to positions alone."""
    stated = list_nominal_terms(pendulum)
    terms = (*stated, find_effect("coulomb_friction").propose_terms(pendulum.robot)[0])
    truth = np.append(np.ones(len(stated)), 0.05)
    problem = make_problem(pendulum, terms, truth, noise=1e-4)
    problem = replace(problem, sigma=np.full_like(problem.sigma, 1e-4))
    return fit_parameters(problem, terms, truth)


def test_blocks_add_up_to_the_whole(pendulum):
    fit = _fit(pendulum)
    information = Information.build(fit)
    assert information.gram.sum(axis=0) == pytest.approx(fit.jacobian.T @ fit.jacobian)
    whole = fit.jacobian.T @ fit.residuals
    assert information.gradient.sum(axis=0) == pytest.approx(whole)
    assert len(information.parameters) == len(fit.values)


def test_positions_alone_tell_torques_and_masses_up_to_one_factor(pendulum):
    (group,) = Information.build(_fit(pendulum)).find_confounded()
    assert "joint:hinge/frictionloss" in group
    assert any(name.endswith("/mass") for name in group)


def test_what_is_told_apart_is_in_no_group():
    gram = np.array([1e6 * np.eye(3)])
    apart = Information(
        ("a", "b", "c"), np.ones(3), np.full(3, 100.0), gram, np.zeros((1, 3)), 1.0
    )
    assert apart.find_confounded() == []
    u = np.array([1.0, 1.0, 0.0])
    blurred = replace(apart, gram=gram - 1e6 * np.outer(u, u)[None] / 2)
    assert blurred.find_confounded() == [("a", "b")]
