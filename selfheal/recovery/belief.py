"""Belief: what hypotheses predict and what was measured in, how likely each is out.

A residual is Student's t about a drift: every joint's zero may have moved a little, the
same in every action. So a drift in many readings does not outvote a few large changes,
and one outlier does not outvote all others. Values that change together count as
the few independent ones that they are worth.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.body import Floats, Ints

DEGREES_OF_FREEDOM = 4.0  # heavier tails than any sensor's; chosen
_ROUNDS = 6  # of the drift's fit
_AT_ONCE = 4_000_000  # numbers compared at a time, 32 MB; chosen
_DRAWS = 384  # outcomes imagined of each candidate action; chosen


def compute_log_t(z: Floats) -> Floats:
    """Log density of Student's t, without its constant.

    Args:
        z: (...) residuals over their scale [1]; NaN counts nothing.

    Returns:
        (...) log densities [nats].
    """
    tails = (DEGREES_OF_FREEDOM + 1) / 2
    return -tails * np.log1p(np.nan_to_num(z) ** 2 / DEGREES_OF_FREEDOM)


@dataclass(frozen=True)
class ResidualNoise:
    """How far a right prediction may be off.

    Attributes:
        scale: (M) of each value's residual.
        drift: standard deviation of each joint's zero [deg]; 0 = no drift.
    """

    scale: Floats
    drift: float


def compute_log_likelihood(
    predicted: Floats, slope: Floats, measured: Floats, noise: ResidualNoise
) -> Floats:
    """How well each hypothesis explains all that was measured.

    Args:
        predicted: (H, M) values; NaN where the simulation failed.
        slope: (H, M, D) change of a value with each joint's zero [1/deg], or D = 0.
        measured: (M); NaN where nothing was read.
        noise: see `ResidualNoise`.

    Returns:
        (H) log likelihood, the drift integrated out (Laplace's approximation);
        -inf where the simulation failed.
    """
    gap, drifts = (measured - predicted) / noise.scale, slope.shape[-1]
    failed = (np.isnan(predicted) & ~np.isnan(measured)).any(axis=1)
    y = np.nan_to_num(gap)
    x = slope / noise.scale[:, None] * noise.drift
    x = np.where(np.isnan(gap)[..., None], 0.0, np.nan_to_num(x))
    move, eye = np.zeros((len(y), drifts)), np.eye(drifts)
    precision = np.broadcast_to(eye, (len(y), drifts, drifts))
    for _ in range(_ROUNDS):
        rest = y - np.einsum("hmd,hd->hm", x, move)
        weight = (DEGREES_OF_FREEDOM + 1) / (DEGREES_OF_FREEDOM + rest**2)
        weighted = (x * weight[..., None]).swapaxes(1, 2)
        precision = weighted @ x + eye
        move = np.linalg.solve(precision, weighted @ y[..., None])[..., 0]
    rest = y - np.einsum("hmd,hd->hm", x, move)
    total = compute_log_t(rest).sum(axis=1) - (move**2).sum(axis=1) / 2
    total -= np.linalg.slogdet(precision)[1] / 2
    return np.where(failed, -np.inf, total)


def compute_posterior(log_weight: Floats) -> Floats:
    """(H) probabilities of log weights."""
    weight = np.exp(log_weight - log_weight.max())
    return weight / weight.sum()


def sum_over_groups(probability: Floats, group: Ints) -> Floats:
    """(G) probability of each group of hypotheses (H)."""
    return np.eye(group.max() + 1)[group].T @ probability


def compute_entropy(probability: Floats) -> Floats:
    """(...) [nats] over the last axis."""
    p = np.maximum(probability, 1e-300)
    return -(p * np.log(p)).sum(axis=-1)


@dataclass(frozen=True)
class CandidateAction:
    """What an action would show.

    Attributes:
        predicted: (H, K, M) values by each hypothesis and each of K robots that it may
            be; NaN where the simulation failed.
        scale: (M) of their residuals.
        effective_share: share of the values that tell something of their own.
    """

    predicted: Floats
    scale: Floats
    effective_share: float = 1.0


def score_outcomes(candidate: CandidateAction, measured: Floats) -> Floats:
    """(..., H) log likelihood of measured values (..., M), over all likely robots.

    -inf where no robot could be simulated.
    """
    z = (measured[..., None, None, :] - candidate.predicted) / candidate.scale
    failed = (np.isnan(z) & ~np.isnan(measured[..., None, None, :])).any(axis=-1)
    fit = candidate.effective_share * compute_log_t(z).sum(axis=-1)
    fit = np.where(failed, -np.inf, fit)
    with np.errstate(divide="ignore"):
        return np.logaddexp.reduce(fit, axis=-1) - np.log(fit.shape[-1])


def widen_scale(scale: Floats, slope: Floats, drift: float) -> Floats:
    """Widen the scale of residuals where the drift is not known yet.

        scale' = sqrt(scale^2 + drift^2 |slope|^2)

    Args:
        scale: (M) without the drift, in units of the values.
        slope: (M, D) change of the values with each of D drifts, per [deg] of it.
        drift: standard deviation of each drift [deg]; see `ResidualNoise`.

    Returns:
        (M) widened scale.
    """
    return np.sqrt(scale**2 + drift**2 * (np.nan_to_num(slope) ** 2).sum(axis=-1))


def choose_action(
    candidates: Sequence[CandidateAction],
    log_weight: Floats,
    group: Ints,
    rng: np.random.Generator,
) -> tuple[int, float]:
    """The action after which the damage can be expected to be known best.

    Args:
        log_weight: (H) belief so far.
        group: (H) hypotheses of one group need not be distinguished.
        rng: draws the outcomes that are imagined.

    Returns:
        Its index, and the entropy over groups that is expected after it [nats].
    """
    # at even distances: hypotheses are drawn as often as they are believed
    sums = np.cumsum(compute_posterior(log_weight))
    marks = (rng.random() + np.arange(_DRAWS)) / _DRAWS
    truth = np.minimum(np.searchsorted(sums, marks * sums[-1]), len(group) - 1)
    members = np.eye(group.max() + 1)[group]
    expected = np.empty(len(candidates))
    for k, c in enumerate(candidates):
        robot = rng.integers(c.predicted.shape[1], size=_DRAWS)
        noise = rng.standard_t(DEGREES_OF_FREEDOM, size=(_DRAWS, len(c.scale)))
        measured = c.predicted[truth, robot] + c.scale * noise
        pieces = -(-_DRAWS * c.predicted.size // _AT_ONCE)
        fits = [score_outcomes(c, some) for some in np.array_split(measured, pieces)]
        weight = log_weight + np.concatenate(fits)
        weight = np.exp(weight - weight.max(axis=1, keepdims=True))
        share = weight @ members
        expected[k] = compute_entropy(share / share.sum(axis=1, keepdims=True)).mean()
    best = int(np.argmin(expected))
    return best, float(expected[best])
