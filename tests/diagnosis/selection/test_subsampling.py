"""Segments that stand for all: odd ones are not overlooked."""

from dataclasses import replace

import numpy as np

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.selection.search_state import start_state
from selfheal.diagnosis.selection.subsampling import find_overlooked_segments
from tests.support.problems import list_nominal_terms, make_problem


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
        found = find_overlooked_segments(p, some, search.best)
        assert found.tolist() == numbers
    every = np.arange(len(odd.segments))
    assert not len(find_overlooked_segments(odd, every, search.best))
