"""Which candidate wins: gains, priors of fitted values, effects without parameters."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.effects.terms import restates_nominal_value
from selfheal.diagnosis.estimation.fit import Fit
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.linearized_fit import LinearizedFit
from selfheal.diagnosis.estimation.quadratic_model import stack_bounds
from selfheal.diagnosis.selection.criteria import (
    _choose_likeliest,
    choose_winner,
    find_relieving,
    fit_damages,
    is_clear,
    significant_prior_penalty,
)
from selfheal.diagnosis.selection.cross_validation import ScoredFit, fit_and_score
from selfheal.diagnosis.selection.settings import SELECTION
from tests.support.problems import (
    list_nominal_terms,
    make_pose_problem,
    make_problem,
    with_contact,
)


@pytest.mark.parametrize("factor", [1.1, 1.6])
def test_nominal_values_at_their_bounds_are_relieved_by_the_missing_effect(arm, factor):
    """The elbow's rotor, which masses and lengths can stand for in rough readings."""
    stated = list_nominal_terms(arm)
    terms = [t for n in ("armature", "viscous_friction")
             for t in find_effect(n).propose_terms(arm.robot)]  # fmt: skip
    assert all(restates_nominal_value(t, stated) for t in terms)
    (rotor,) = (t for t in terms if t.label == "armature at joint:elbow")
    inertia = arm.simulator.compiler.nominal.dof_armature[1] * factor
    ones = np.ones(len(stated))
    problem = make_problem(arm, (*stated, rotor), (*ones, inertia), noise=0.03)
    rough = [replace(c, noise=np.full(c.width, 0.03)) for c in arm.simulator.channels]
    problem = replace(problem, simulator=replace(arm.simulator, channels=tuple(rough)))
    base = LinearizedFit.from_fit(fit_parameters(problem, stated, ones))
    now = ScoredFit.from_fit(base.fit)
    won = find_relieving(base, now, terms, lambda what, share: None)
    assert (won is None) == (factor < 1.3)  # inside what the contract grants
    if won is not None:
        assert won[0].candidate.label == rotor.label
        assert won[0].values[0] == pytest.approx(inertia, rel=0.2)


def test_a_significant_prior_penalty_is_larger_in_contact(arm):
    problem, terms = make_problem(arm), list_nominal_terms(arm)
    smooth, touching = (
        fit_parameters(p, terms, np.ones(len(terms)), iterations=0)
        for p in (problem, with_contact(problem))
    )
    least = SELECTION.significant_prior_penalty
    assert significant_prior_penalty(smooth) == least
    assert significant_prior_penalty(touching) == least + len(terms)


@pytest.mark.parametrize(("left", "rough", "smooth"), [(0.8, 1, 1), (0.92, 0, 1)])
def test_a_small_gain_names_nothing_in_contact(arm, left, rough, smooth):
    (_, dry, *_) = find_effect("coulomb_friction").propose_terms(arm.robot)
    problem = make_problem(arm, (dry,), (0.001,))
    for p, earns in (problem, smooth), (with_contact(problem), rough):
        now = fit_and_score(p, (), np.zeros(0))
        fit = fit_parameters(p, (dry,), np.array([0.001]))
        best = ScoredFit(fit, left * now.held_out_errors)
        assert (choose_winner(now, [best], 1) is not None) == earns


def test_a_lost_limb_is_tried_with_nominal_values(arm):
    (loss,) = find_effect("limb_loss").propose_terms(arm.robot)
    dry, *_ = find_effect("coulomb_friction").propose_terms(arm.robot)
    stated, tell = list_nominal_terms(arm), lambda what, share: None
    low, _, _ = stack_bounds(stated)  # where what is missing may have driven them
    problem = make_problem(arm, (loss,))
    lost = LinearizedFit.from_fit(fit_parameters(problem, stated, low, iterations=0))
    (best,) = fit_damages(lost, len(stated), [dry, loss], tell)
    assert best.candidate is loss and best.is_reestimated
    assert best.error < 2 * np.count_nonzero(best.fit.residuals) < 0.1 * lost.fit.cost
    np.testing.assert_allclose(best.fit.values, 1, atol=0.1)
    before = ScoredFit.from_fit(lost.fit)
    assert is_clear(before, best) and not is_clear(best, best)
    problem = make_problem(arm)  # nothing is lost
    whole = LinearizedFit.from_fit(fit_parameters(problem, stated, low, iterations=0))
    assert fit_damages(whole, len(stated), [dry, loss], tell) == []


def test_of_single_readings_what_acts_at_rest_goes_before_a_delay(arm):
    problem, rng = make_pose_problem(arm, 12), np.random.default_rng(0)
    held, rows = rng.normal(size=12) ** 2, problem.segments.readings.size

    def tried(name: str, held) -> ScoredFit:
        term = find_effect(name).propose_terms(arm.robot)[0]
        at = Fit(
            problem,
            (term,),
            np.array(term.initial_values[0]),
            np.zeros(rows),
            np.zeros((rows, len(term.parameters))),
        )
        return ScoredFit(at, held)

    late, stopped = tried("actuator_lag", held), tried("hard_stop", 1.01 * held)
    assert _choose_likeliest(late, [late, stopped]) is stopped
    # unless the poses speak against it
    worse = tried("hard_stop", 3 * held)
    assert _choose_likeliest(late, [late, worse]) is late
