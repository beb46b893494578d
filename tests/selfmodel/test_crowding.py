"""Deterministic crowding: losses never rise, failures never win."""

import numpy as np

from selfheal.selfmodel.crowding import run_generation


def test_crowding_never_loses_and_a_failed_child_never_wins(rng):
    def score(genes):
        far = ((genes - 0.3) ** 2).sum(axis=1)
        return np.where(genes[:, 0] > 0.9, np.inf, far)

    genes = rng.random((40, 5))
    errors = score(genes)
    best = [errors.min()]
    for _ in range(60):
        genes, errors = run_generation(genes, errors, score, rng)
        assert np.array_equal(errors, score(genes))
        assert ((genes >= 0) & (genes <= 1)).all()
        best.append(errors.min())
    assert (np.diff(best) <= 0).all() and best[-1] < 0.01 < best[0]
    assert np.isfinite(errors).all()
