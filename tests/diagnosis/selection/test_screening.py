"""Screening of candidates: diverging ones never win, odd segments are found."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect, load_catalogue
from selfheal.diagnosis.estimation.candidate_fit import fit_candidate
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.linearized_fit import LinearizedFit
from selfheal.diagnosis.estimation.settings import FIT
from selfheal.diagnosis.selection.screening import (
    find_overlooked_segments,
    screen_candidates,
)
from selfheal.diagnosis.selection.search_state import start_state
from selfheal.diagnosis.selection.settings import SELECTION
from tests.support.problems import Explosion, list_nominal_terms, make_problem


def test_a_diverging_candidate_never_wins_and_never_raises(pendulum):
    (boom,) = Explosion().propose_terms(pendulum.robot)
    dry = find_effect("coulomb_friction").propose_terms(pendulum.robot)[0]
    problem = make_problem(pendulum, (dry,), (0.05,))
    with np.errstate(all="ignore"):
        r = problem.compute_residuals((boom,), np.array([[25.0]]))
        assert np.abs(r).max() == FIT.max_residual
        base = LinearizedFit.from_fit(fit_parameters(problem, (), np.zeros(0)))
        tried = fit_candidate(base, boom)
        assert np.isfinite(tried.cost) and np.isfinite(tried.jacobian).all()
        messages: list[str] = []
        fits, count, again = screen_candidates(
            [base] * 3, [boom, dry], lambda what, share: messages.append(what)
        )
    assert fits[0].terms[-1].label == dry.label
    assert fits[0].cost < 0.5 * base.fit.cost
    # what gains nothing is not tried a third time
    assert 1 <= count <= 2 and len(messages) == 5
    assert [t.label for t in again] == [dry.label, boom.label]


@pytest.mark.slow
def test_many_candidates_are_sorted_out_before_they_are_fitted(arm):
    robot = arm.robot
    (_, dry) = find_effect("coulomb_friction").propose_terms(robot)
    problem = make_problem(arm, (dry,), (0.1,))
    base = LinearizedFit.from_fit(fit_parameters(problem, (), np.zeros(0)))
    effects = [e for e in load_catalogue().values() if not e.rounds_readings]
    proposed = [t for effect in effects for t in effect.propose_terms(robot)]
    assert len(proposed) > SELECTION.screening_scored
    messages: list[str] = []
    tried: set[tuple] = set()
    fits, _, again = screen_candidates(
        [base] * 3,
        proposed,
        lambda what, share: messages.append(what),
        lambda terms: tried.update(t.key for t in terms),
    )
    assert tried == {t.key for t in proposed}
    assert fits[0].terms[-1].key == dry.key
    most = SELECTION.screening_scored + sum(SELECTION.screening_kept)
    assert len(messages) <= len(proposed) + most
    assert len(again) == min(len(proposed), SELECTION.max_retried_candidates)


def test_a_segment_that_shows_an_effect_is_not_overlooked(arm):
    problem = make_problem(arm)
    stop = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    predicted = arm.simulator.simulate((stop,), np.array([[0.1]]), problem.segments)[0]
    readings = problem.segments.readings.copy()
    rows = problem.segments.find_sample_rows(np.array([5]))
    readings[rows] = predicted[rows]
    odd = replace(problem, segments=replace(problem.segments, readings=readings))
    some, stated = np.arange(5), list_nominal_terms(arm)
    for p, numbers in ((problem, []), (odd, [5])):
        search = start_state(p, stated, (), some)
        found = find_overlooked_segments(p, some, search.best.fit)
        assert found.tolist() == numbers
    every = np.arange(len(odd.segments))
    assert not len(find_overlooked_segments(odd, every, search.best.fit))
