"""Held-out errors are those of fits that did not see the held-out readings."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.data.segments import cut_segments
from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.candidate_fit import fit_candidate
from selfheal.diagnosis.estimation.fit import Fit
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.linearized_fit import LinearizedFit
from selfheal.diagnosis.estimation.problem import Problem
from selfheal.diagnosis.selection.cross_validation import (
    ScoredFit,
    assign_folds,
    generalizes_across_episodes,
    predict_held_out,
    refit_without_folds,
)
from selfheal.diagnosis.simulation.build import build_simulator, summarize_robot
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from selfheal.recording import read
from tests.support.problems import LinearProblem, make_linear_problem


def test_held_out_errors_are_those_of_fits_that_did_not_see_them(arm):
    problem, found, y = make_linear_problem(arm, np.random.default_rng(0))
    expected = np.empty(len(y))
    for of in (assign_folds(problem), problem.segment_of_residual):
        for fold in np.unique(of):
            seen = of != fold
            x = np.linalg.lstsq(found.jacobian[seen], -y[seen], rcond=None)[0]
            expected[~seen] = (y[~seen] + found.jacobian[~seen] @ x) ** 2
        predicted = predict_held_out(found, of)
        np.testing.assert_allclose(
            predicted, problem.sum_by_segment(expected), rtol=1e-5
        )
        assert predicted.sum() > found.cost


def test_whole_held_out_segments_are_simulated(arm):
    """A Jacobian may be wrong there, as where a foot touches down or does not."""
    problem, found, _ = make_linear_problem(arm, np.random.default_rng(0))
    fold = problem.segment_of_residual == 1
    jac = np.where(fold[:, None], 1e3 * found.jacobian, found.jacobian)
    wrong, of = replace(found, jacobian=jac), problem.segment_of_residual
    predicted, right = (predict_held_out(f, of)[1] for f in (wrong, found))
    assert predicted == pytest.approx(right, rel=1e-3)
    # unless the Jacobian is to be believed
    believed, same = (predict_held_out(f, of, linearly=True)[1] for f in (wrong, found))
    assert same == pytest.approx(right, rel=1e-3) and believed > 2 * right


def test_few_held_out_segments_are_simulated_where_residuals_are_linear(
    arm, monkeypatch
):
    problem, found, _ = make_linear_problem(arm, np.random.default_rng(0))
    simulated, simulate = [], LinearProblem.residuals_at

    def count(part, terms, values):
        simulated.append(part)
        return simulate(part, terms, values)

    monkeypatch.setattr(LinearProblem, "residuals_at", count)
    predict_held_out(found, problem.segment_of_residual)
    assert 0 < len(simulated) < len(problem.segments)


def test_long_segments_are_divided_into_blocks(arm):
    """The last fold of a few long segments would have to extrapolate."""
    problem, found, _ = make_linear_problem(arm, np.random.default_rng(0))
    few = problem.select(np.arange(3))
    rows = np.isin(problem.segment_of_residual, [0, 1, 2])
    part = Fit(
        few, found.terms, found.values, found.residuals[rows], found.jacobian[rows]
    )
    whole = predict_held_out(part, few.segment_of_residual).sum()
    assert part.cost < predict_held_out(part).sum() < whole


def test_what_explains_one_episode_only_does_not_generalize(arm):
    rng = np.random.default_rng(1)
    problem, found, _ = make_linear_problem(arm, rng)
    log = problem.segments.episode[problem.segment_of_residual]
    assert len(np.unique(log)) == 3
    same = rng.normal(size=len(log))
    own = same * np.array([1.0, -1.0, 1.0])[log]  # of another sign in one episode
    assert generalizes_across_episodes(*_added(problem, found, same, 3 * same))
    assert not generalizes_across_episodes(*_added(problem, found, same, 3 * own))


def test_an_effect_that_one_episode_alone_shows_may_generalize(arm):
    """A torque's limit may be reached in one episode; others do not determine it."""
    rng = np.random.default_rng(1)
    problem, found, _ = make_linear_problem(arm, rng)
    log = problem.segments.episode[problem.segment_of_residual]
    column = rng.normal(size=len(log)) * np.array([1.0, 1e3, 1.0])[log]
    fits = _added(problem, found, column, 3 * column)
    worse = fits[1].jacobian.copy()
    worse[log == 1, -1] *= -0.5  # from the others the wrong way
    lacking = replace(fits[0].problem, jac=worse)
    assert generalizes_across_episodes(*(replace(f, problem=lacking) for f in fits))


def _added(problem: LinearProblem, found: Fit, column, missing) -> tuple[Fit, Fit]:
    """A fit that lacks something, and that with a column for it, at its best."""
    jac = np.column_stack([found.jacobian, column])
    lacking = replace(problem, y=problem.y + missing, jac=jac)
    old = replace(found, problem=lacking, residuals=found.residuals + missing)
    (new,) = np.linalg.lstsq(column[:, None], -old.residuals, rcond=None)[0]
    terms = (*found.terms, replace(found.terms[0]))
    values, left = np.append(found.values, new), old.residuals + column * new
    return old, Fit(lacking, terms, values, left, jac)


@pytest.mark.slow
def test_what_fits_every_pose_has_to_predict_those_it_did_not_see(shared_recordings):
    """The damaged robot of 2006: a torso heavy on one side explains its poses too."""
    folder = shared_recordings / "starfish_2006"
    damaged = read(folder / "damaged.h5")
    chosen = list(damaged.episodes)[::2]
    damaged = replace(damaged, episodes={i: damaged.episodes[i] for i in chosen})
    simulator = build_simulator(
        ModelCompiler(str(folder / "published_body.xml")), [damaged]
    )
    robot = summarize_robot(simulator)
    simulator = replace(simulator, has_contact=robot.has_contact)
    segments = cut_segments(simulator.episodes, None)
    problem = Problem(simulator, segments, np.full(segments.readings.shape[1], 0.02))
    base = LinearizedFit.from_fit(fit_parameters(problem, (), np.zeros(0)))
    terms = [
        t
        for name, target in (("limb_loss", "right_lower"), ("com_shift", "torso"))
        for t in find_effect(name).propose_terms(robot)
        if t.targets == (f"body:{target}",)
    ]
    tried = [ScoredFit.from_fit(fit_candidate(base, t)) for t in terms]
    assert max(s.error for s in tried) < 0.1 * base.fit.cost
    (best,) = refit_without_folds(base, tried, terms)
    assert best.candidate is terms[0] and best.error < 0.1 * base.fit.cost
