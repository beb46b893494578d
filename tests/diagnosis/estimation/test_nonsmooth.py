"""Fits where residuals are rough: searches past local minima and by smoothed slopes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.base import Term
from selfheal.diagnosis.effects.declaration import Parameter
from selfheal.diagnosis.effects.places import Place
from selfheal.diagnosis.estimation import nonsmooth
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.marginalization import marginalize_initial_states
from selfheal.diagnosis.estimation.nonsmooth import (
    search_along_valleys,
    search_multiples,
)
from selfheal.diagnosis.estimation.regime import SMOOTH
from selfheal.diagnosis.estimation.settings import FIT
from tests.support.problems import list_nominal_terms, make_problem, with_contact
from tests.support.recorded_robots import bench


def _rough(count: int, outlier: float = 0.0):
    """A problem of one parameter: a valley at 1.0 with ripples, in each segment."""

    def residuals(terms, points):
        far = points[:, :1] - 1.0
        ripples = 0.1 * np.sin(60.0 * far)
        predicted = np.tile(10 * np.hypot(far, 0.1) * (1 + ripples), (1, count))
        predicted[:, 0] += outlier * np.abs(points[:, 0] - 0.49)
        return predicted

    return SimpleNamespace(
        compute_residuals=residuals,
        segment_of_residual=np.arange(count),
        sum_by_segment=lambda r: r,
        regime=SMOOTH,
    )


@pytest.mark.parametrize("outlier", [0.0, 1000.0])
def test_a_better_minimum_farther_off_is_found_by_most_segments(outlier):
    free = Parameter("x", "1", 0.0, 0.0, 5.0, 1.0)
    term = Term(find_effect("wind"), ("world",), (Place(),), (free,), ())
    problem = _rough(9, outlier)
    (near,) = search_multiples(problem, (term,), np.array([0.7]))
    assert abs(near - 1.0) < 0.05
    (stays,) = search_multiples(problem, (term,), np.array([1.0]))
    assert stays == 1.0


def test_initial_states_of_another_friction_do_not_fix_it(tmp_path):
    b = bench("box", tmp_path, episodes=6, seconds=0.9)
    (slip, *_), truth = find_effect("ground_friction").propose_terms(b.robot), 0.3
    problem = with_contact(make_problem(b, (slip,), (truth,)))
    wrong = np.array([truth / 0.9])
    problem = marginalize_initial_states(problem, (slip,), wrong)
    found = fit_parameters(problem, (slip,), wrong, iterations=0)
    assert search_along_valleys(found) == pytest.approx(truth)


def test_nominal_values_follow_an_effect_that_changes(arm):
    drag = find_effect("viscous_friction").propose_terms(arm.robot)[1]
    terms = (*list_nominal_terms(arm), drag)
    truth = np.append(np.full(len(terms) - 1, 1.02), 0.1)
    problem = make_problem(arm, terms, truth)
    (size,) = drag.parameters
    still = replace(drag, parameters=(replace(size, low=0.1 / 1.1, high=0.1 / 1.1),))
    held = replace(fit_parameters(problem, (*terms[:-1], still), truth), terms=terms)
    values = search_along_valleys(held)
    assert values[-1] == pytest.approx(0.1)
    alone = np.append(held.values[:-1], values[-1])
    costs = [
        float((problem.residuals_at(terms, v) ** 2).sum()) for v in (alone, values)
    ]
    assert costs[1] < 0.2 * costs[0]


def test_in_contact_a_smoothed_fit_goes_further(tmp_path, monkeypatch):
    monkeypatch.setattr(nonsmooth, "FIT", replace(FIT, smoothed_iterations=2))
    b = bench("box", tmp_path, episodes=4, seconds=0.6)
    stated, (slip, *_) = (
        list_nominal_terms(b),
        find_effect("ground_friction").propose_terms(b.robot),
    )
    terms = (*stated, slip)
    truth = np.append(np.full(len(stated), 1.02), 0.3)
    problem = with_contact(make_problem(b, terms, truth))
    begin = np.append(np.ones(len(stated)), 0.8 * 0.3)
    problem = marginalize_initial_states(problem, terms, begin)
    found = fit_parameters(problem, terms, begin)
    new = nonsmooth.fit_smoothed(found)
    assert new.cost < 0.7 * found.cost
    assert abs(new.values[-1] - 0.3) < abs(found.values[-1] - 0.3)
    np.testing.assert_array_equal(
        new.residuals, new.problem.residuals_at(terms, new.values)
    )
    assert new.jacobian.shape == found.jacobian.shape
