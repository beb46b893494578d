"""Evidence that a fit is right: takes its residuals, gives what they prove of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..estimation.covariance import effective_sample_size
from ..estimation.noise import noise_ratio
from ..estimation.problem import Problem, assign_blocks
from ..estimation.reweighting import TAILS
from .cross_validation import ScoredFit
from .settings import SELECTION


@dataclass(frozen=True, eq=False)
class Evidence:
    """Why an effect is named.

    Attributes:
        gain: nats per effective sample that it adds to held-out predictions.
        p_value: of that gain, corrected for all candidates tried.
        stability: share of resamples of the windows in which it, or what cannot be
            told from it, comes first.
    """

    gain: float
    p_value: float
    stability: float


def improvement_p_value(
    problem: Problem, old: ScoredFit, new: ScoredFit, tried: float
) -> float:
    """p-value that `new` predicts better than `old`, paying for `tried` tries.

    A likelihood ratio of held-out residuals with as many samples as are independent,
    and only where the gain is no single piece's; nor does one piece take a name away:
    also without the block that speaks most for it and the one that does so most against
    it. Of single readings, the less of two.
    """
    from scipy.stats import chi2

    if problem.regime.has_single_readings:
        tries = 1
        nats = min(_log_likelihoods(problem, new) - _log_likelihoods(problem, old))
        nats = nats if old.error > new.error else 0.0
    else:
        block, gains = assign_blocks(problem), old.held_out_errors - new.held_out_errors
        each = np.bincount(block, gains)
        trimmed = ~np.isin(block, [each.argmin(), each.argmax()])
        tries = 2
        nats = max(_steady_gain(problem, old, new, w) for w in (block >= 0, trimmed))
    free = max(1, len(new.fit.values) - len(old.fit.values))
    return float(min(1.0, tries * tried * chi2.sf(2 * max(nats, 0.0), free)))


def _steady_gain(
    problem: Problem, old: ScoredFit, new: ScoredFit, of: np.ndarray
) -> float:
    """Nats by which `new` predicts some windows (W) better; 0 if that is not steady."""
    _, block = np.unique(assign_blocks(problem)[of], return_inverse=True)
    gains = np.bincount(block, (old.held_out_errors - new.held_out_errors)[of])
    if (
        len(gains) < 2
        or gains.sum()
        <= SELECTION.min_gain_standard_errors * gains.std(ddof=1) * len(gains) ** 0.5
    ):
        return 0.0
    ratio = old.held_out_errors[of].sum() / max(new.held_out_errors[of].sum(), 1e-300)
    # the larger residuals are the old ones, and the more alike their neighbors
    r = old.fit.residuals * of[problem.segment_of_residual]
    return float(0.5 * effective_sample_size(problem, r) * np.log(ratio))


def _log_likelihoods(problem: Problem, fit: ScoredFit) -> Floats:
    """Log-likelihoods (2) [nats] of windows' squared residuals, of unknown scale.

    Of a normal error, by which a pose in which the robot tips tells most, and of one
    with Student's tails that a window's columns share, by which it may be an accident.
    The scale of the latter by Lange, Little, Taylor (1989), eq. 6.
    """
    known, held = np.isfinite(problem.segments.readings), fit.held_out_errors
    count = np.zeros(len(held))
    for c in problem.simulator.channels:
        whole = known[:, c.columns].all(axis=1)
        count += (
            np.bincount(problem.segments.segment_of_sample, whole, len(held))
            * c.free_columns
        )
    square = mean = max(held.sum() / count.sum(), 1e-300)
    for _ in range(SELECTION.student_iterations):
        weight = (TAILS + count) / (TAILS + held / square)
        square = max(
            float((weight * held).sum() / count.sum()),
            SELECTION.student_min_scale**2 * mean,
        )
    apart = (TAILS + count) / 2 * np.log1p(held / square / TAILS)
    normal = -count.sum() / 2 * np.log(mean)
    return np.array([normal, -count.sum() / 2 * np.log(square) - apart.sum()])


def bic(problem: Problem, fit: ScoredFit) -> float:
    """Log-likelihood [nats] of single readings, for which each number costs (BIC)."""
    readings = np.isfinite(problem.segments.readings).sum()
    price = 0.5 * np.log(readings) * len(fit.fit.values)
    return float(_log_likelihoods(problem, fit)[0] - price)


def is_as_good(
    problem: Problem,
    other: ScoredFit,
    lead: ScoredFit,
    errors: float = SELECTION.exchange_margin,
) -> bool:
    """Whether the windows do not tell that `other` predicts worse than `lead`.

    Where little but noise is left, likelihoods tell, if not by one window alone; a
    model that is wrong for both has to be so by more than it varies.
    """
    if problem.regime.has_single_readings:
        return bic(problem, lead) - bic(problem, other) < errors
    if _is_clearly_likelier(problem, lead, other):
        return False
    apart = np.bincount(
        assign_blocks(problem), other.held_out_errors - lead.held_out_errors
    )
    noise = apart.std(ddof=1) * np.sqrt(len(apart)) if len(apart) > 1 else np.inf
    ratio = other.error / max(lead.error, 1e-300)
    nats = (
        0.5
        * effective_sample_size(problem, lead.fit.residuals)
        * np.log(max(ratio, 1e-300))
    )
    return bool(
        apart.sum() <= errors * noise and ratio < SELECTION.max_equivalent_error_ratio
    ) or bool(nats < errors)


def _is_clearly_likelier(problem: Problem, lead: ScoredFit, other: ScoredFit) -> bool:
    """Whether `other` surely leaves more, by more than `lead` leaves beside noise."""
    rest = np.arange(len(lead.held_out_errors)) != np.argmax(
        other.held_out_errors - lead.held_out_errors
    )
    ratio = other.held_out_errors[rest].sum() / max(
        lead.held_out_errors[rest].sum(), 1e-300
    )
    left = noise_ratio(problem, lead.fit.residuals) ** 2
    nats = (
        0.5
        * effective_sample_size(problem, lead.fit.residuals)
        * np.log(max(ratio, 1e-300))
    )
    return bool(
        nats > SELECTION.certain_nats
        and ratio > max(left, 1 + SELECTION.certain_error_excess)
    )


def bootstrap_stability(
    problem: Problem, tried: Sequence[ScoredFit], winners: Sequence[ScoredFit]
) -> float:
    """Share of bootstraps of the blocks in which one of the winners comes first."""
    rng = np.random.default_rng(0)
    block = assign_blocks(problem)
    sums = np.array([np.bincount(block, s.held_out_errors) for s in tried])
    draws = rng.integers(
        sums.shape[1], size=(SELECTION.bootstrap_resamples, sums.shape[1])
    )
    first = sums[:, draws].sum(axis=-1).argmin(axis=0)
    keys = {s.candidate.key for s in winners}
    return float(np.mean([tried[i].candidate.key in keys for i in first]))
