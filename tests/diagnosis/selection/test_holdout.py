"""Segments that no fit saw decide between hypotheses and equivalents."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.selection.holdout import (
    drop_refuted,
    keep_predictive,
    try_equivalents,
)
from selfheal.diagnosis.selection.hypotheses import Hypothesis, NamedEffect
from selfheal.diagnosis.selection.judge import Judge
from selfheal.diagnosis.selection.search_state import Evidence
from tests.support.problems import make_problem, name_effect


def test_what_held_out_segments_refute_gives_way_to_what_they_support(arm):
    dry, inert = (
        find_effect(name).propose_terms(arm.robot)[1]
        for name in ("coulomb_friction", "armature")
    )
    problem = make_problem(arm, (dry,), (0.1,))
    held, seen = (
        problem.select(np.arange(i, len(problem.segments), 3)) for i in (0, 1)
    )
    less = fit_parameters(seen, (), np.zeros(0))
    judge = Judge(held.simulator, (held.segments,))
    refuted = NamedEffect(inert, Evidence(1.0, 1e-3, 1.0), (dry,))
    ((instead,), best) = try_equivalents(judge, refuted, less)
    assert instead.term.key == dry.key and instead.equivalent == ()
    assert best.terms == (instead.term,)
    assert best.values[0] == pytest.approx(0.1, rel=0.2)
    alone = replace(refuted, equivalent=())
    assert try_equivalents(judge, alone, less) == ([], less)
    with_it = fit_parameters(seen, (dry,), np.array([0.1]))  # it has a name already
    assert try_equivalents(judge, refuted, with_it) == ([], with_it)


def test_the_last_fit_stands_unless_the_one_of_the_search_predicts_better(arm):
    dry = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    problem = make_problem(arm, (dry,), (0.1,))
    predicted = arm.simulator.simulate((dry,), np.array([[0.1]]), problem.segments)[0]
    seen = replace(problem, segments=replace(problem.segments, readings=predicted))
    others = replace(seen, segments=replace(seen.segments))

    def naming(value: float, fitted: Problem) -> Hypothesis:
        at = fit_parameters(fitted, (dry,), np.array([value]), iterations=0)
        return Hypothesis(at, at, (name_effect(dry),), ())

    # the held-out segments are those of a robot without any friction
    near, far = (naming(x, seen) for x in (0.01, 0.1))
    for refined, searched, is_kept in (0.1, near, False), (0.01, far, True):
        last = naming(refined, others)
        assert keep_predictive(arm.simulator, last, searched) is (
            last if is_kept else searched
        )
    # in the segments of the search it always does
    assert keep_predictive(arm.simulator, far, near) is far


def test_what_explains_most_in_held_out_segments_comes_first(arm, monkeypatch):
    """Whatever the order in which a search found it."""
    dry, wet = (
        find_effect(name).propose_terms(arm.robot)[1]
        for name in ("coulomb_friction", "viscous_friction")
    )
    for values in ((0.2, 0.01), (0.02, 0.1)):
        problem = make_problem(arm, (dry, wet), values)
        held, seen = (
            problem.select(np.arange(i, len(problem.segments), 3)) for i in (0, 1)
        )
        judge = Judge(held.simulator, (held.segments,))
        monkeypatch.setattr(Judge, "build", lambda *_, judge=judge: judge)
        fit = fit_parameters(seen, (dry, wet), np.array(values))
        names = (name_effect(dry), name_effect(wet))
        kept, refuted = drop_refuted(None, Hypothesis(fit, fit, names, ()))
        assert not refuted
        first = max(zip(values, (dry, wet), strict=True), key=lambda each: each[0])[1]
        assert kept.named[0].term.key == first.key
        assert kept.named[0].growth > kept.named[1].growth > 1
