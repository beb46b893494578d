"""Likelihood of equation errors: noise of what was read, and torques that are missing.

The balance of torques of a window has the covariance C = N + D: of noise of the
readings, which is known, and of each joint's discrepancies, with a diagonal D. Whitened
by a root of C errors have Student's t, so that blows do not count. What a hypothesis
misses is alike from one row to the next: a first-order autoregression of each column
takes that away (Cochrane and Orcutt 1949; Ljung 1999, section 10.1).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import expit

from ...recording.data import Floats

FREEDOM = 4.0  # degrees of freedom of Student's t (Lange, Little and Taylor 1989)
WINSOR = 3.0  # scales, beyond which an error is a blow
MOST_MEMORY = 0.99  # of an autoregression; more is a drift, whose first row counts
MIN_SHARE = 1e-3  # of a mixture's part, whose logarithm stays finite
SCALE_ITERATIONS = 20  # of its scale; each halves the error, or more


@dataclass(frozen=True, eq=False)
class Whitening:
    """What makes errors independent and of unit variance, row by row.

    Attributes:
        roots: (R, J, J) inverse roots of the covariance of the first J columns.
        memory: (C) autoregression of each column, the first J after their roots.
        follows: (R) whether a row follows the one before in time.
        scale: (C) Student's scale of each column's innovations.
        weights: (R, C) roots of Student's weights of the errors.
        errors: (R, C) innovations, whitened.
        loss: negative log-likelihood [nats] of the errors, up to a constant.
    """

    roots: Floats
    memory: Floats
    follows: np.ndarray
    scale: Floats
    weights: Floats
    errors: Floats
    loss: float

    def apply(self, changes: Floats) -> Floats:
        """(..., R C) changes of errors, whitened and weighted."""
        return (self._divide(changes) * self.weights).reshape(changes.shape)

    def _divide(self, changes: Floats) -> Floats:
        """(..., R, C) changes (..., R C), whitened."""
        x = changes.reshape(*changes.shape[:-1], *self.errors.shape).copy()
        count = self.roots.shape[-1]
        x[..., :count] = np.einsum("rij,...rj->...ri", self.roots, x[..., :count])
        return _innovate(x, self.memory, self.follows) / self.scale

    def predict_loss(self, change: Floats, volume: float) -> float:
        """The loss [nats] with other errors, in the same covariance.

        Args:
            change: (R C) of the errors.
        """
        r = self.errors + self._divide(change)
        return self.loss + _compute_size(r, estimate_scale(r)) - self._size - volume

    @cached_property
    def _size(self) -> float:
        """Negative log-likelihood [nats] of the whitened errors."""
        return _compute_size(self.errors, estimate_scale(self.errors))


def whiten(
    errors: Floats,
    noise: Floats | None,
    volume: float,
    follows: np.ndarray,
    slack: Floats | float = 0.0,
) -> Whitening:
    """The whitening of a hypothesis's errors, with the likeliest discrepancies.

    The loss is infinite where errors are not finite.

    Args:
        errors: (R, C) in columns.
        noise: (R, J, J) covariance of the first J by noise of the readings.
        volume: of the errors [nats].
        follows: (R) whether a row follows the one before in time.
        slack: (R, J) variance of undecided forces.
    """
    if not np.isfinite(errors).all() or noise is None:
        none, count = np.zeros_like(errors), errors.shape[1]
        roots, one = np.zeros((len(errors), 0, 0)), np.ones(count)
        return Whitening(roots, 0 * one, follows, one, none, none, np.inf)
    joints = noise.shape[-1]
    known = np.einsum("rjj->rj", noise)
    spread = estimate_scale(errors[:, :joints]) ** 2
    missing = np.maximum(spread - np.median(known, axis=0), 0.0)
    missing += 1e-6 * spread + np.finfo(float).tiny
    loose, chosen = _mix(errors[:, :joints], known + missing, slack)
    each = noise + (missing + loose)[:, None] * np.eye(joints)
    roots = np.linalg.inv(np.linalg.cholesky(each))
    r = errors.copy()
    r[:, :joints] = np.einsum("rij,rj->ri", roots, errors[:, :joints])
    volume += np.log(np.einsum("rjj->rj", roots)).sum() + chosen
    memory = _estimate_memory(r, follows)
    r = _innovate(r, memory, follows)
    scale = estimate_scale(r)
    volume += 0.5 * (~follows).sum() * np.log1p(-(memory**2)).sum()
    loss = _compute_size(r, scale) - volume
    r = r / scale
    weights = np.sqrt((FREEDOM + 1) / (FREEDOM + r**2))
    return Whitening(roots, memory, follows, scale, weights, r, float(loss))


def _mix(
    errors: Floats, variance: Floats, slack: Floats | float
) -> tuple[Floats, float]:
    """Variances that undecided forces add, which may be of any size up to their slack.

    Of a mixture of two normals, without and with it, whose shares are the likeliest
    (expectation maximization, Dempster, Laird and Rubin 1977): a sensor of velocity may
    be noisy only where something moves.

    Args:
        errors: (R, J).
        variance: (R, J) without slack.
        slack: (R, J) variance of undecided forces.

    Returns:
        Variances (R, J) of a normal that pulls as the mixture does, less those without
        slack, and the log-likelihood [nats] of the mixture less that of this normal.
    """
    is_open = np.broadcast_to(slack > 0.0, errors.shape)
    less = variance[is_open]
    more = less + np.broadcast_to(slack, errors.shape)[is_open]
    square, share = errors[is_open] ** 2, 0.5
    if not len(square):
        return np.zeros_like(variance), 0.0
    likely = [-0.5 * (np.log(x) + square / x) for x in (less, more)]
    for _ in range(SCALE_ITERATIONS):
        odds = np.log(share) - np.log1p(-share) + likely[1] - likely[0]
        loose = expit(odds)
        share = float(np.clip(loose.mean(), MIN_SHARE, 1 - MIN_SHARE))
    precision = (1 - loose) / less + loose / more
    whole = np.logaddexp(np.log1p(-share) + likely[0], np.log(share) + likely[1])
    nats = (whole - 0.5 * (np.log(precision) - square * precision)).sum()
    out = np.zeros_like(variance)
    out[is_open] = 1 / precision - less
    return out, float(nats)


def _estimate_memory(errors: Floats, follows: np.ndarray) -> Floats:
    """(C) correlation of each column of errors (R, C) with the row before, 0 or more.

    Winsorized, so that a blow does not decide it.
    """
    most = WINSOR * estimate_scale(errors)
    x = np.clip(errors, -most, most)
    after = np.flatnonzero(follows)
    power = (x[after] ** 2).sum(axis=0) + (x[after - 1] ** 2).sum(axis=0)
    product = 2 * (x[after] * x[after - 1]).sum(axis=0)
    memory = product / np.maximum(power, np.finfo(float).tiny)
    return np.clip(memory, 0.0, MOST_MEMORY)


def _innovate(values: Floats, memory: Floats, follows: np.ndarray) -> Floats:
    """Innovations (..., R, C) of an autoregression; the first ones of the same size."""
    out = values * np.where(follows[:, None], 1.0, np.sqrt(1 - memory**2))
    after = np.flatnonzero(follows)
    out[..., after, :] -= memory * values[..., after - 1, :]
    return out


def estimate_scale(errors: Floats) -> Floats:
    """(C) scale of Student's t of each column of errors (R, C)."""
    scale = 1.4826 * np.median(np.abs(errors), axis=0)
    least = 1e-3 * np.sqrt((errors**2).mean(axis=0)) + np.finfo(float).tiny
    scale = np.maximum(scale, least)
    for _ in range(SCALE_ITERATIONS):
        weights = (FREEDOM + 1) / (FREEDOM + (errors / scale) ** 2)
        scale = np.sqrt((weights * errors**2).mean(axis=0))
    return scale


def _compute_size(errors: Floats, scale: Floats) -> float:
    """Negative log-likelihood [nats] of errors (R, C) with columns of scales (C)."""
    tails = np.log1p((errors / scale) ** 2 / FREEDOM).sum()
    size = len(errors) * np.log(scale).sum() + (FREEDOM + 1) / 2 * tails
    return float(size)


def estimate_independence(whitening: Whitening) -> float:
    """Share of rows that are independent, by the correlation of neighbors in time.

    R / (1 + 2 sum_k rho_k), over the lags whose autocorrelation is beyond two standard
    errors of none; the mean over the columns of innovations.
    """
    x = whitening.weights * whitening.errors
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
