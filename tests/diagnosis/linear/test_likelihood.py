"""Laws of the likelihood of equation errors."""

from types import SimpleNamespace

import numpy as np
import pytest

from selfheal.diagnosis.linear.likelihood import estimate_independence, whiten
from selfheal.diagnosis.linear.model import Errors

ROWS = 400


def make_errors(rng, noise=(0.3, 0.1), missing=(0.05, 0.4), unit=1.0):
    """Errors of two joints and one velocity, and what they are of."""
    root = rng.normal(size=(ROWS, 2, 2))
    inertia = root @ root.swapaxes(1, 2) + 2 * np.eye(2)
    torque = np.einsum("rij,rj->ri", inertia, noise * rng.normal(size=(ROWS, 2)))
    torque += missing * rng.normal(size=(ROWS, 2))
    values = np.hstack([unit * torque, 0.2 * rng.normal(size=(ROWS, 1))])
    volume = np.linalg.slogdet(unit * inertia)[1].sum()
    motion = SimpleNamespace(width=3, joints=(0, 1), noise=np.array(noise))
    return motion, Errors(values.ravel(), float(volume), unit * inertia)


def test_whitened_errors_are_independent():
    motion, errors = make_errors(np.random.default_rng(1))
    found = whiten(motion, errors).errors
    assert np.corrcoef(found.T) == pytest.approx(np.eye(3), abs=0.12)


def test_another_unit_of_mass_and_torque_is_as_likely():
    (motion, errors), (_, grams) = (
        make_errors(np.random.default_rng(2), unit=u) for u in (1.0, 1000.0)
    )
    assert whiten(motion, grams).loss == pytest.approx(whiten(motion, errors).loss)


def test_a_small_change_is_predicted_as_it_turns_out():
    rng = np.random.default_rng(3)
    motion, errors = make_errors(rng)
    change = 0.02 * rng.normal(size=errors.values.shape)
    whitening = whiten(motion, errors)
    moved = Errors(errors.values + change, errors.volume, errors.inertia)
    predicted = whitening.predict_loss(change, 0.0)
    assert whitening.predict_loss(0 * change, 0.0) == pytest.approx(whitening.loss)
    assert predicted == pytest.approx(whiten(motion, moved).loss, abs=1.0)


def test_a_blow_costs_little_more_however_hard_it_is():
    motion, errors = make_errors(np.random.default_rng(4))
    values = errors.values.copy()
    values[:6] += 50
    soft = whiten(motion, Errors(values, errors.volume, errors.inertia)).loss
    values[:6] += 500
    hard = whiten(motion, Errors(values, errors.volume, errors.inertia)).loss
    assert hard - soft < 6 * 6 * np.log(11)


def test_errors_that_diverge_are_never_likely():
    motion, errors = make_errors(np.random.default_rng(5))
    values = errors.values.copy()
    values[7] = np.nan
    assert whiten(motion, Errors(values, 0.0, errors.inertia)).loss == np.inf


def test_neighbors_that_are_alike_count_once():
    rng = np.random.default_rng(6)
    motion, errors = make_errors(rng)
    alone = estimate_independence(whiten(motion, errors))
    four = np.repeat(errors.values.reshape(ROWS, 3)[: ROWS // 4], 4, axis=0)
    inertia = np.repeat(errors.inertia[: ROWS // 4], 4, axis=0)
    alike = estimate_independence(whiten(motion, Errors(four.ravel(), 0.0, inertia)))
    assert alone > 0.8 and 0.15 < alike < 0.45
