"""Evidence for an effect: what counts as better, and as as good."""

from dataclasses import replace

import numpy as np
import pytest

from selfheal.diagnosis.effects import find_effect
from selfheal.diagnosis.estimation.covariance import effective_sample_size
from selfheal.diagnosis.estimation.fit import Fit
from selfheal.diagnosis.estimation.least_squares import fit_parameters
from selfheal.diagnosis.estimation.noise import expected_noise
from selfheal.diagnosis.selection.cross_validation import ScoredFit, predict_held_out
from selfheal.diagnosis.selection.evidence import (
    bic,
    find_uncertain,
    improvement_p_value,
    is_as_good,
    most_blocks_p_value,
)
from tests.support.problems import (
    make_linear_problem,
    make_pose_problem,
    make_problem,
    with_contact,
)


def _add_values(found: Fit, count: int) -> Fit:
    """A fit with more values, which change no residual."""
    columns = np.zeros((len(found.residuals), count))
    return replace(
        found,
        values=np.append(found.values, np.zeros(count)),
        jacobian=np.hstack([found.jacobian, columns]),
    )


def test_a_worse_prediction_is_never_better_and_tries_are_paid_for(arm):
    rng = np.random.default_rng(0)
    problem, found, _ = make_linear_problem(arm, rng)
    now = ScoredFit(found, predict_held_out(found))
    more = _add_values(found, 1)
    worse = ScoredFit(more, 1.1 * now.held_out_errors)
    assert improvement_p_value(now, worse, 1) == 1.0
    ratio = 1 - 12 / effective_sample_size(problem, found.residuals)
    good = ScoredFit(more, ratio * now.held_out_errors)
    p = [improvement_p_value(now, good, tries) for tries in (1, 10, 100)]
    assert p[0] < 0.01 and p[1] == pytest.approx(10 * p[0])
    assert p[2] == pytest.approx(min(1, 100 * p[0]))


def test_of_single_readings_a_large_one_counts_and_small_ones_do_not_outvote_it(arm):
    problem = make_pose_problem(arm, 12)
    assert (
        problem.segments.is_single_readings
        and not make_problem(arm).segments.is_single_readings
    )
    readings = np.zeros(problem.segments.readings.size)
    found = Fit(problem, (), np.zeros(0), readings, np.zeros((len(readings), 0)))
    found = _add_values(found, 3)
    large, small = [0, 0, 1.5, 25, 6, 1.3, 0.1, 0, 1.6, 0, 0.1, 0], [1.5, 6, 1.3, 1.6]
    now = ScoredFit(found, np.array(large, float))
    tips, drifts = now.held_out_errors.copy(), now.held_out_errors.copy()
    tips[3] = 1.6
    drifts[[2, 4, 5, 8]] = 0.2 * np.array(small)
    more = _add_values(found, 1)
    assert improvement_p_value(now, ScoredFit(more, tips), 3) < 0.01
    assert improvement_p_value(now, ScoredFit(more, drifts), 3) > 0.01
    assert is_as_good(now, now)
    assert not is_as_good(now, ScoredFit(more, tips))
    # one that predicts as well with fewer numbers is the likelier
    assert bic(now) > bic(ScoredFit(more, now.held_out_errors))


def test_a_gain_of_one_segment_alone_is_no_gain(arm):
    problem, found, _ = make_linear_problem(arm, np.random.default_rng(0))
    now = ScoredFit(found, predict_held_out(found))
    held = 1.05 * now.held_out_errors
    held[0] = -0.9 * now.held_out_errors.sum()
    one = ScoredFit(_add_values(found, 1), held)
    assert improvement_p_value(now, one, 1) == 1.0


def test_one_segment_does_not_cancel_a_gain(arm):
    """One segment has an odd initial state; all others are predicted better."""
    problem, found, _ = make_linear_problem(arm, np.random.default_rng(0))
    now = ScoredFit(found, predict_held_out(found))
    held = 0.5 * now.held_out_errors
    held[0] += 0.45 * now.held_out_errors.sum()
    more = ScoredFit(_add_values(found, 1), held)
    assert improvement_p_value(now, more, 1) < 0.01
    worse = 1.5 * now.held_out_errors
    worse[0] = 0.0
    assert improvement_p_value(now, ScoredFit(more.fit, worse), 1) == 1.0


def test_most_blocks_speak_for_an_effect_though_one_has_all_the_error(arm):
    problem, found, _ = make_linear_problem(arm, np.random.default_rng(0))
    sizes = np.exp(np.random.default_rng(1).normal(size=len(problem.segments)))
    sizes[0] = 1e4 * sizes.sum()
    now = ScoredFit(found, sizes)
    more = _add_values(found, 1)
    better = ScoredFit(more, 0.3 * sizes * np.where(sizes < sizes.max(), 1, 3.4))
    assert better.error > now.error
    assert most_blocks_p_value(now, better, 1) < 0.01
    assert most_blocks_p_value(better, now, 1) == pytest.approx(1, abs=0.01)
    assert most_blocks_p_value(now, now, 1) == 1.0


@pytest.mark.parametrize("left", [1.0, 3.0])
def test_where_only_noise_is_left_likelihoods_decide_what_is_as_good(arm, left):
    """A third of the segments is worse than chance alone would have it."""
    problem, found, _ = make_linear_problem(arm, np.random.default_rng(0))
    size = np.sqrt(expected_noise(problem) / found.cost)
    found = replace(found, residuals=left * size * found.residuals)
    lead = ScoredFit(found, problem.sum_by_segment(found.residuals**2))
    held = (
        np.where(np.arange(len(lead.held_out_errors)) % 3, 1.0, 2.5)
        * lead.held_out_errors
    )
    assert is_as_good(ScoredFit(found, held), lead, 1e6) == (left > 1)
    alone = lead.held_out_errors.copy()
    alone[0] *= 1 + len(alone) / 3
    assert is_as_good(ScoredFit(found, alone), lead, 1e6)


@pytest.mark.parametrize("bias", [0.0, 0.05])
def test_a_value_within_its_errors_of_none_is_uncertain(arm, bias):
    term = find_effect("sensor_bias").propose_terms(arm.robot)[0]
    problem = make_problem(arm, (term,), (bias,))
    fit = fit_parameters(problem, (term,), np.array([bias]), iterations=4)
    assert find_uncertain(fit) == ([] if bias else [term])
    assert find_uncertain(replace(fit, problem=with_contact(problem))) == []
