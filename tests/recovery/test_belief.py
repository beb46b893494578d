"""Belief: the right hypothesis wins, and what should not decide does not."""

from itertools import islice

import numpy as np
import pytest

from selfheal.damage.kinds import INTACT, Damage
from selfheal.recovery.belief import (
    CandidateAction,
    ResidualNoise,
    choose_action,
    compute_log_likelihood,
    compute_posterior,
    score_outcomes,
    sum_over_groups,
    widen_scale,
)
from selfheal.recovery.hypotheses import (
    compute_log_prior,
    group_damages,
    list_damages,
    refine_damages,
)
from selfheal.recovery.predict_actions import infer_damage, predict_actions
from selfheal.robot.actions import load_published_body

ANATOMY = load_published_body().anatomy


def _belief(predicted, felt, slope=None, scale=1.0, drift=1.0):
    slope = np.zeros((*predicted.shape, 0)) if slope is None else slope
    noise = ResidualNoise(np.full(predicted.shape[1], scale), drift)
    return compute_posterior(compute_log_likelihood(predicted, slope, felt, noise))


def test_the_hypothesis_that_predicts_best_is_the_most_probable():
    predicted = np.array([[0.0, 0, 0], [5, 0, 0], [0, 5, 0]])
    assert _belief(predicted, np.array([4.5, 0.3, 0])).argmax() == 1


def test_a_drift_in_many_readings_does_not_outvote_two_large_changes():
    # the first predicts two large changes, the second that many readings are off a bit
    count = 16
    predicted = np.zeros((2, count))
    predicted[0, :2], predicted[1, 2:] = 25.0, 1.5
    felt = predicted[0] + np.where(np.arange(count) < 2, 0, 1.5)
    slope = np.ones((2, count, 1)) * (np.arange(count) >= 2)[None, :, None]
    assert _belief(predicted, felt, slope)[0] > 0.99


def test_a_failed_simulation_is_never_believed():
    predicted = np.array([[0.0, np.nan], [9.0, 9.0]])
    assert _belief(predicted, np.zeros(2)) == pytest.approx([0, 1])


def test_a_reading_that_is_missing_counts_nothing():
    predicted = np.array([[0.0, 50.0], [3.0, 0.0]])
    belief = _belief(predicted, np.array([0.0, np.nan]))
    assert belief[0] > belief[1]


def test_what_any_robot_that_it_may_be_shows_is_explained():
    # of the first hypothesis the second robot shows it, of the second one none does
    table = np.array([[[40.0, 0.0], [7.0, 7.0]], [[40.0, 0.0], [0.0, 40.0]]])
    felt = score_outcomes(CandidateAction(table, np.ones(2)), np.array([7.0, 7.0]))
    assert felt[0] == pytest.approx(-np.log(2), abs=1e-3)
    assert felt[1] < felt[0] - 5


def test_a_robot_that_could_not_be_simulated_explains_nothing():
    table = np.array([[[np.nan], [1.0]], [[np.nan], [np.nan]]])
    alone = score_outcomes(CandidateAction(table[:1, 1:], np.ones(1)), np.ones(1))
    both = score_outcomes(CandidateAction(table, np.ones(1)), np.ones(1))
    assert both == pytest.approx([alone[0] - np.log(2), -np.inf])


def test_one_value_written_down_many_times_is_worth_one():
    once = np.array([[[0.0]], [[4.0]]])
    many = CandidateAction(
        np.repeat(once, 8, axis=2), np.ones(8), effective_share=1 / 8
    )
    felt = np.array([1.0])
    assert score_outcomes(many, np.repeat(felt, 8)) == pytest.approx(
        score_outcomes(CandidateAction(once, np.ones(1)), felt)
    )


def test_an_unknown_drift_blurs_what_moves_with_it_alone():
    slope = np.array([[0.0, 0.0], [3.0, 4.0]])
    assert widen_scale(np.ones(2), slope, 2.0) == pytest.approx([1.0, np.sqrt(101)])


def test_the_action_that_separates_groups_is_chosen():
    group = np.array([0, 0, 1, 1])
    same, values, apart = 4 * [0.0], [0.0, 9, 0, 9], [0.0, 0, 9, 9]
    rng = np.random.default_rng(0)
    shown = [
        CandidateAction(np.reshape(table, (4, 1, 1)), np.ones(1))
        for table in (same, values, apart)
    ]
    best, left = choose_action(shown, np.zeros(4), group, rng)
    assert best == 2
    assert left < 0.3


def test_the_prior_says_that_something_happened_and_no_kind_is_likelier():
    damages = list_damages(ANATOMY, np.zeros(8))
    prior = np.exp(compute_log_prior(damages))
    names, group = group_damages(damages)
    assert prior.sum() == pytest.approx(1)
    assert damages[0] == INTACT and prior[0] == pytest.approx(0.05)
    share = sum_over_groups(prior, group)
    kinds = np.array([kind for kind, _ in names])
    sums = [share[kinds == kind].sum() for kind in {*kinds} - {"none"}]
    assert np.ptp(sums) == pytest.approx(0, abs=1e-12)


def test_values_grow_finer_round_the_best_until_they_are_fine():
    damages, truth = list_damages(ANATOMY, np.zeros(8)), 0.43
    for _ in range(12):
        here = [d.place == ("part_scale", "body:left_upper") for d in damages]
        gap = np.array([abs(d.value - truth) for d in damages])
        new = refine_damages(damages, np.where(here, -50 * gap, -99.0), 1)
        if not new:
            break
        assert all(d.target == "body:left_upper" for d in new)
        damages += new
    values = [d.value for d in damages if d.kind == "part_scale"]
    assert not new
    assert min(abs(v - truth) for v in values) < 0.03


def test_a_slope_is_refined_in_tilt_and_direction():
    azimuths = np.radians((0, 90, 180, 270))
    tilts = np.radians((5, 10, 15))
    slopes = [Damage("slope", "world", t, a) for t in tilts for a in azimuths]
    weight = np.where(np.arange(12) == 5, 0.0, -9.0)
    new = refine_damages(slopes, weight, 1)
    assert {round(float(np.degrees(d.azimuth))) for d in new} >= {45, 135}
    assert {round(float(np.degrees(d.value)), 1) for d in new} >= {7.5, 12.5}


@pytest.fixture(scope="module")
def readings(shared_recordings):
    """The readings of 2006, whole and damaged, with what damages would show."""
    from selfheal.recording import read
    from selfheal.robot.replay import replay

    folder = shared_recordings / "starfish_2006"
    files = ("intact.h5", "damaged.h5")
    body = load_published_body()
    robots = (replay(f, read(folder / f), body.anatomy, body) for f in files)
    return predict_actions(*robots, load_published_body())


@pytest.mark.parametrize("seed", range(3))
def test_the_right_leg_of_the_real_robot_is_found(readings, seed):
    rng = np.random.default_rng(seed)
    *_, (_, belief) = islice(infer_damage(readings, rng, chosen=True), 10)
    lower = [d.name == "right_lower" for d in readings.damages]
    assert belief[lower].sum() > 0.9
