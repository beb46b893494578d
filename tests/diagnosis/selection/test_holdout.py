"""Segments that no fit saw decide between hypotheses and equivalents."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.selection.cross_validation import ScoredFit
from selfheal.diagnosis.selection.evidence import Evidence
from selfheal.diagnosis.selection.holdout import (
    choose_hypothesis,
    hand_over_plain,
    try_equivalents,
)
from selfheal.diagnosis.selection.hypotheses import Hypothesis, NamedEffect
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
    refuted = NamedEffect(inert, Evidence(1.0, 1e-3, 1.0), (dry,))
    ((instead,), best) = try_equivalents(seen, held, refuted, less)
    assert instead.term.key == dry.key and instead.equivalent == ()
    assert best.terms == (instead.term,)
    assert best.values[0] == pytest.approx(0.1, rel=0.2)
    alone = replace(refuted, equivalent=())
    assert try_equivalents(seen, held, alone, less) == ([], less)
    with_it = fit_parameters(seen, (dry,), np.array([0.1]))  # it has a name already
    assert try_equivalents(seen, held, refuted, with_it) == ([], with_it)


def test_held_out_segments_decide_between_hypotheses_only_where_they_clearly_do(arm):
    dry = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    problem = make_problem(arm, (dry,), (0.1,))
    case = SimpleNamespace(held_out=arm.simulator)
    predicted = arm.simulator.simulate((dry,), np.array([[0.1]]), problem.segments)[0]
    seen = replace(problem, segments=replace(problem.segments, readings=predicted))

    def naming(value: float, *says) -> Hypothesis:
        at = fit_parameters(seen, (dry,), np.array([value]), iterations=0)
        scored = ScoredFit.from_fit(seen, at)
        return Hypothesis(seen, scored, scored, tuple(map(name_effect, says)), ())

    # the held-out segments are those of a robot without any friction
    near, far, alike = ((naming(x, dry), ()) for x in (0.01, 0.1, 0.009))
    assert choose_hypothesis(case, [far]) is far
    assert choose_hypothesis(case, [far, near]) is near
    assert choose_hypothesis(case, [near, far]) is near
    assert choose_hypothesis(case, [near, alike]) is alike
    # nor more things, nor rarer ones, for next to nothing
    rare = find_effect("com_shift").propose_terms(arm.robot)[0]
    for says in (dry, dry), (rare,):
        assert choose_hypothesis(case, [near, (naming(0.009, *says), ())]) is near
        assert (
            choose_hypothesis(case, [far, (naming(0.009, *says), ())])[0] is not far[0]
        )


def test_the_fit_of_all_usual_effects_is_handed_over_only_where_it_predicts_better(arm):
    terms = tuple(find_effect("viscous_friction").propose_terms(arm.robot))
    given = np.array([t.parameters[0].nominal for t in terms])
    # the held-out segments are those of the model as given
    problem, case = make_problem(arm), SimpleNamespace(held_out=arm.simulator)
    nominal = ScoredFit.from_fit(problem, fit_parameters(problem, (), np.zeros(0)))

    def at(values) -> Hypothesis:
        final = fit_parameters(problem, terms, np.array(values), iterations=0)
        scored = ScoredFit.from_fit(problem, final)
        return Hypothesis(problem, nominal, scored, tuple(map(name_effect, terms)), ())

    right, wrong = at(given), at(3 * given)
    better = replace(wrong, plain=right.final.fit)
    assert hand_over_plain(case, (wrong, ())) is None
    assert hand_over_plain(case, (right, ())) is None
    assert hand_over_plain(case, (replace(right, plain=wrong.final.fit), ())) is None
    handed = hand_over_plain(case, (better, ("a name",)))
    assert handed is not None
    # nothing in it stands on evidence, for the robot is as given
    assert handed[0].named == () and handed[1][0] == "a name"
