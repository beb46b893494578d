"""Laws of the likelihood of equation errors."""

import numpy as np
import pytest

from selfheal.diagnosis.linear import likelihood
from selfheal.diagnosis.linear.likelihood import estimate_independence

ROWS = 400


def whiten(values, noise, volume, *, follows=False):
    """The whitening of rows, which may follow each other."""
    follows = (np.arange(len(values)) > 0) & follows
    return likelihood.whiten(values, noise, volume, follows)


def make_errors(rng, noise=(0.3, 0.1), missing=(0.05, 0.4), unit=1.0):
    """Errors of two joints and one velocity, the covariance by noise, the volume."""
    root = rng.normal(size=(ROWS, 2, 2))
    inertia = root @ root.swapaxes(1, 2) + 2 * np.eye(2)
    torque = np.einsum("rij,rj->ri", inertia, noise * rng.normal(size=(ROWS, 2)))
    torque += missing * rng.normal(size=(ROWS, 2))
    values = np.hstack([unit * torque, 0.2 * rng.normal(size=(ROWS, 1))])
    spread = unit * inertia * noise
    covariance = spread @ spread.swapaxes(1, 2)
    volume = 0.5 * np.linalg.slogdet(covariance)[1].sum()
    return values, covariance, float(volume)


def test_whitened_errors_are_independent():
    found = whiten(*make_errors(np.random.default_rng(1))).errors
    assert np.corrcoef(found.T) == pytest.approx(np.eye(3), abs=0.12)


def test_another_unit_of_mass_and_torque_is_as_likely():
    losses = [
        whiten(*make_errors(np.random.default_rng(2), unit=u)).loss
        for u in (1.0, 1000.0)
    ]
    assert losses[1] == pytest.approx(losses[0])


def test_a_small_change_is_predicted_as_it_turns_out():
    rng = np.random.default_rng(3)
    values, noise, volume = make_errors(rng)
    change = 0.02 * rng.normal(size=values.shape)
    whitening = whiten(values, noise, volume)
    predicted = whitening.predict_loss(change.ravel(), 0.0)
    none = whitening.predict_loss(0 * change.ravel(), 0.0)
    assert none == pytest.approx(whitening.loss)
    moved = whiten(values + change, noise, volume).loss
    assert predicted == pytest.approx(moved, abs=1.0)


def test_changes_are_whitened_as_errors_are():
    values, noise, volume = make_errors(np.random.default_rng(7))
    whitening = whiten(values, noise, volume)
    same = whitening.apply(values.ravel()).reshape(values.shape)
    assert same == pytest.approx(whitening.weights * whitening.errors)


def test_a_blow_costs_little_more_however_hard_it_is():
    values, noise, volume = make_errors(np.random.default_rng(4))
    values[:2] += 50
    soft = whiten(values, noise, volume).loss
    values[:2] += 500
    hard = whiten(values, noise, volume).loss
    assert hard - soft < 6 * 6 * np.log(11)


def test_errors_that_diverge_are_never_likely():
    values, noise, volume = make_errors(np.random.default_rng(5))
    values[2, 1] = np.nan
    assert whiten(values, noise, volume).loss == np.inf


def test_errors_of_which_no_noise_is_known_are_independent_columns():
    values, _, _ = make_errors(np.random.default_rng(8))
    whitening = whiten(values, np.zeros((ROWS, 0, 0)), 0.0)
    assert whitening.errors * whitening.scale == pytest.approx(values)


def test_neighbors_that_are_alike_count_once():
    values, noise, volume = make_errors(np.random.default_rng(6))
    alone = estimate_independence(whiten(values, noise, volume))
    four, alike = (np.repeat(x[: ROWS // 4], 4, axis=0) for x in (values, noise))
    share = estimate_independence(whiten(four, alike, volume))
    assert alone > 0.8 and 0.15 < share < 0.45


def test_errors_that_last_are_predicted_from_those_before():
    rng = np.random.default_rng(7)
    values, noise, volume = make_errors(rng)
    for i in range(1, ROWS):
        values[i] += 0.8 * values[i - 1]
    apart, together = (whiten(values, noise, volume, follows=x) for x in (False, True))
    assert together.memory[2] == pytest.approx(0.8, abs=0.1)
    assert together.loss < apart.loss - ROWS / 4
    assert not apart.memory.any()


def test_forces_that_may_be_undecided_are_so_only_where_errors_tell():
    rng = np.random.default_rng(8)
    values, noise, volume = make_errors(rng)
    slack = np.full((ROWS, 2), 100.0)
    follows = np.zeros(ROWS, bool)
    without = likelihood.whiten(values, noise, volume, follows)
    hardly = likelihood.whiten(values, noise, volume, follows, slack)
    assert hardly.loss == pytest.approx(without.loss, abs=3)
    loose, slack = values.copy(), np.zeros((ROWS, 2))
    loose[::4, 0] += 10 * rng.normal(size=ROWS // 4)
    slack[::4, 0] = 100.0
    losses = [
        likelihood.whiten(loose, noise, volume, follows, s).loss for s in (slack, 0.0)
    ]
    assert losses[0] < losses[1] - 10
