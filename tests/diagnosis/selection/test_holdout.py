"""Segments that no fit saw decide between hypotheses and equivalents."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.marginalization import marginalize_initial_states
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.output.document import build_unproven
from selfheal.diagnosis.selection.cross_validation import ScoredFit
from selfheal.diagnosis.selection.evidence import Evidence
from selfheal.diagnosis.selection.holdout import (
    choose_hypothesis,
    hand_over_plain,
    keep_predictive,
    squared_error,
    try_equivalents,
)
from selfheal.diagnosis.selection.hypotheses import Hypothesis, NamedEffect
from selfheal.diagnosis.selection.replay_scores import HeldOutScores
from tests.support.problems import STEPS, make_problem, name_effect
from tests.support.recorded_robots import bench


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
    ((instead,), best) = try_equivalents(held, refuted, less)
    assert instead.term.key == dry.key and instead.equivalent == ()
    assert best.terms == (instead.term,)
    assert best.values[0] == pytest.approx(0.1, rel=0.2)
    alone = replace(refuted, equivalent=())
    assert try_equivalents(held, alone, less) == ([], less)
    with_it = fit_parameters(seen, (dry,), np.array([0.1]))  # it has a name already
    assert try_equivalents(held, refuted, with_it) == ([], with_it)


@pytest.mark.slow
def test_held_out_segments_decide_between_hypotheses_only_where_they_clearly_do(arm):
    dry = find_effect("coulomb_friction").propose_terms(arm.robot)[1]
    problem = make_problem(arm, (dry,), (0.1,))
    case = SimpleNamespace(held_out=arm.simulator)
    predicted = arm.simulator.simulate((dry,), np.array([[0.1]]), problem.segments)[0]
    seen = replace(problem, segments=replace(problem.segments, readings=predicted))

    def naming(value: float, *says) -> Hypothesis:
        at = fit_parameters(seen, (dry,), np.array([value]), iterations=0)
        scored = ScoredFit.from_fit(at)
        return Hypothesis(scored, scored, tuple(map(name_effect, says)), ())

    # the held-out segments are those of a robot without any friction
    near, far, alike = ((naming(x, dry), ()) for x in (0.01, 0.1, 0.009))
    assert choose_hypothesis(case, [far]) is far
    assert choose_hypothesis(case, [far, near]) is near
    assert choose_hypothesis(case, [near, far]) is near
    assert choose_hypothesis(case, [near, alike]) is alike
    # the last fit stands unless the search's predicts clearly better
    others = replace(seen, segments=replace(seen.segments))

    def refit(naming: Hypothesis) -> Hypothesis:
        fit = replace(naming.final.fit, problem=others)
        return replace(naming, final=replace(naming.final, fit=fit))

    for refined, searched, kept in (far, near, near), (near, far, near):
        last = refit(refined[0])
        chosen = keep_predictive(case, last, searched[0])
        assert chosen is (last if kept is refined else searched[0])
    last = refit(near[0])
    assert keep_predictive(case, last, naming(0.00999, dry)) is last
    # in the segments of the search it always does
    assert keep_predictive(case, far[0], near[0]) is far[0]
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
    nominal = ScoredFit.from_fit(fit_parameters(problem, (), np.zeros(0)))

    def at(values) -> Hypothesis:
        final = fit_parameters(problem, terms, np.array(values), iterations=0)
        scored = ScoredFit.from_fit(final)
        return Hypothesis(nominal, scored, tuple(map(name_effect, terms)), ())

    right, wrong = at(given), at(3 * given)
    assert hand_over_plain(case, (wrong, ())) is None
    assert hand_over_plain(case, (right, ())) is None
    assert hand_over_plain(case, (replace(right, plain=wrong.final.fit), ())) is None
    # nothing in it stands on evidence, for the robot is as given
    assert hand_over_plain(case, (replace(wrong, plain=right.final.fit), ())) is None


@pytest.mark.parametrize("is_longer", [False, True])
def test_what_is_handed_over_predicts_as_well_as_the_fit_of_all_usual_effects(
    is_longer, tmp_path
):
    def change(model):
        model.dof_frictionloss[1] = 0.1

    how = {"episodes": 4, "seconds": 2.0, "seed": 3, "finer": 1}
    real = bench("arm", tmp_path, change=change, **how)
    held, training = (
        replace(real, simulator=replace(real.simulator, episodes=episodes))
        for episodes in (real.simulator.episodes[:1], real.simulator.episodes[1:])
    )
    usual = ("coulomb_friction", "viscous_friction", "armature")
    terms = [t for name in usual for t in find_effect(name).propose_terms(real.robot)]
    sigma = make_problem(training).sigma
    start = np.concatenate([t.initial_values[0] for t in terms])

    def pose(steps: int) -> Problem:
        segments = cut_segments(training.simulator.episodes, steps)
        problem = Problem(training.simulator, segments, sigma)
        return marginalize_initial_states(problem, terms, start)

    searched = pose(STEPS)  # and perhaps all usual effects in fewer, longer segments
    longer = pose(STEPS + 50).select(np.arange(14)) if is_longer else searched
    plain = fit_parameters(longer, tuple(terms), start)
    nominal = ScoredFit.from_fit(fit_parameters(searched, (), np.zeros(0)))
    missed = Hypothesis(nominal, nominal, (), (), plain)
    case = SimpleNamespace(held_out=held.simulator)
    handed = hand_over_plain(case, (missed, ("x",)))
    assert handed is not None and handed[1] == ("x",)
    found = handed[0]
    assert found.problem is longer
    # the fits that a replay compares are each read in their own segments
    scores = HeldOutScores.compute(case, found)
    assert scores.numbers["patched"] < scores.numbers["refit"]
    assert [n.term for n in found.named] == [terms[1]]
    assert set(found.final.fit.terms) <= set(terms)
    unseen = Problem(
        held.simulator, cut_segments(held.simulator.episodes, STEPS), sigma
    )
    assert squared_error(unseen, found.final.fit) <= 1.02 * squared_error(unseen, plain)
    # what is in the fit without a name is listed with its values
    listed = build_unproven(found, np.ones(len(found.final.fit.values)))
    others = [t for t in found.final.fit.terms if t is not terms[1]]
    assert [(e["effect"], e["target"]) for e in listed] == [
        (t.effect.name, target) for t in others for target in t.targets
    ]
