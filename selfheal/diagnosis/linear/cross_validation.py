"""Cross-validation of linear fits: takes two, gives by how much one predicts better.

Blocks of neighboring rows are predicted by values that the other blocks tell, in one
Gauss-Newton step of each (Stone 1974). What a fit misses is alike within a block, so
that what helps where it was fitted alone earns no name.
"""

import numpy as np

from ...recording.data import Floats
from ..estimation.settings import FIT
from .fit import DAMPING, LinearFit
from .likelihood import Whitening


def compute_gains(before: LinearFit, after: LinearFit) -> Floats:
    """Gain [nats] in each of B blocks that are predicted from the others.

    Args:
        after: another one of the same errors, whose whitening counts.
    """
    whitening = after.whitening
    losses = [_predict_blocks(fit, whitening) for fit in (before, after)]
    return losses[0] - losses[1]


def is_worth_more(simple: LinearFit, new: LinearFit) -> bool:
    """Whether a form with more parameters predicts blocks better by a standard error.

    Of forms that do not, the simplest counts (Breiman et al. 1984).
    """
    if len(new.values) <= len(simple.values):
        return True
    gains = compute_gains(simple, new)
    return bool(gains.sum() > np.sqrt(len(gains)) * gains.std(ddof=1))


def _predict_blocks(fit: LinearFit, whitening: Whitening) -> Floats:
    """Losses [nats] of B blocks, each with values that the others tell."""
    count = len(whitening.errors)
    errors = whitening.apply(fit.errors.values).reshape(count, -1)
    slopes = whitening.apply(fit.jacobian.values).reshape(-1, *errors.shape)
    parts = np.array_split(np.arange(count), min(FIT.max_blocks, count))
    each = [(slopes[:, p].reshape(len(slopes), -1), errors[p].ravel()) for p in parts]
    curvatures = np.array([j @ j.T for j, _ in each])
    gradients = np.array([j @ e for j, e in each])
    prior, pull = fit.prior_model
    whole, slope = curvatures.sum(axis=0) + prior, gradients.sum(axis=0) + pull
    diagonal = np.diag(np.maximum(np.diag(whole), np.finfo(float).tiny))
    low, high, _ = fit.bounds
    out = []
    for (j, e), h, g in zip(each, curvatures, gradients, strict=True):
        step = -np.linalg.solve(whole - h + DAMPING * diagonal, slope - g)
        step = np.clip(fit.values + step, low, high) - fit.values
        out.append(0.5 * float(((e + step @ j) ** 2).sum()))
    return np.array(out)
