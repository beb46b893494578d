"""Likelihood of equation errors: heavy tails, and neighbors that are alike."""

import numpy as np

from ...recording.data import Floats
from .model import Errors

FREEDOM = 4.0  # degrees of freedom of Student's t (Lange, Little and Taylor 1989)
ITERATIONS = 20  # of its scale; each halves the error, or more


def estimate_scale(errors: Floats) -> Floats:
    """(C) scale of Student's t of each column of errors (R, C)."""
    scale = 1.4826 * np.median(np.abs(errors), axis=0)
    least = 1e-3 * np.sqrt((errors**2).mean(axis=0)) + np.finfo(float).tiny
    scale = np.maximum(scale, least)
    for _ in range(ITERATIONS):
        weights = (FREEDOM + 1) / (FREEDOM + (errors / scale) ** 2)
        scale = np.sqrt((weights * errors**2).mean(axis=0))
    return scale


def weigh(errors: Errors, width: int) -> Floats:
    """(R C) Student's weights over the squared scale of each of C columns."""
    e = errors.values.reshape(-1, width)
    scale = estimate_scale(e)
    return ((FREEDOM + 1) / (FREEDOM * scale**2 + e**2)).ravel()


def compute_loss(errors: Errors, width: int) -> float:
    """Negative log-likelihood [nats] of errors, up to a constant.

    Student's t with the likeliest scale of each column; infinite where they are not
    finite.
    """
    e = errors.values.reshape(-1, width)
    if not np.isfinite(e).all():
        return np.inf
    scale = estimate_scale(e)
    tails = np.log1p((e / scale) ** 2 / FREEDOM).sum()
    size = len(e) * np.log(scale).sum() - errors.volume
    return float(size + (FREEDOM + 1) / 2 * tails)


def estimate_independence(errors: Errors, weights: Floats, width: int) -> float:
    """Share of rows that are independent, by the correlation of neighbors in time.

    R / (1 + 2 sum_k rho_k), over the lags whose autocorrelation is beyond two standard
    errors of none; the mean over the columns.
    """
    x = (np.sqrt(weights) * errors.values).reshape(-1, width)
    count, shares = len(x), []
    for column in x.T:
        total, power = 1.0, column @ column
        for lag in range(1, count // 4):
            rho = column[lag:] @ column[:-lag] / power
            if rho < 2 / np.sqrt(count):
                break
            total += 2 * rho
        shares.append(1 / total)
    return float(np.mean(shares))
