"""Evidence for an effect: takes held-out residuals of two fits, gives what they prove.

Likelihood-ratio tests (Wilks 1938) with an effective sample size, BIC (Schwarz 1978) of
single readings, and the stability of a choice under a block bootstrap.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..estimation.covariance import effective_sample_size, standard_errors
from ..estimation.fit import Fit
from ..estimation.noise import noise_ratio
from ..estimation.problem import assign_blocks
from ..estimation.settings import FIT
from ..simulation.model_variants import split_values
from .cross_validation import ScoredFit
from .settings import SELECTION


@dataclass(frozen=True, eq=False)
class Evidence:
    """Why an effect is named.

    Attributes:
        gain: [nats] per effective sample that it adds to held-out predictions.
        p_value: of that gain, corrected for all candidates tried.
        stability: share of resamples of the blocks in which it, or what cannot be told
            from it, comes first.
    """

    gain: float
    p_value: float
    stability: float


def improvement_p_value(old: ScoredFit, new: ScoredFit, tried: float) -> float:
    """p-value that a fit predicts better than another one with fewer parameters.

    A likelihood-ratio test of the held-out errors E, with n the effective sample size:

        2 nats = n log(E_old / E_new),  compared with chi-square

    The degrees of freedom are the new parameters. The p-value is corrected for the
    number of candidates (Bonferroni). No single segment makes a name, for the gain must
    exceed its standard error over the blocks. Nor does one take a name away. The test
    is repeated without two blocks: the one that speaks most for the new fit and the one
    that speaks most against it. The better test counts at twice its p-value. Of single
    readings the less of two likelihood ratios counts.

    Args:
        old: the fit with fewer parameters.
        new: the fit with more of them, to the same segments.
        tried: number of independent candidates of which `new` is one.
    """
    from scipy.stats import chi2

    problem = old.fit.problem
    if problem.regime.has_single_readings:
        tests = 1
        nats = min(_log_likelihoods(new) - _log_likelihoods(old))
        nats = nats if old.error > new.error else 0.0
    else:
        block, gains = assign_blocks(problem), old.held_out_errors - new.held_out_errors
        by_block = np.bincount(block, gains)
        trimmed = ~np.isin(block, [by_block.argmin(), by_block.argmax()])
        tests = 2
        nats = max(_significant_nats(old, new, w) for w in (block >= 0, trimmed))
    degrees = max(1, len(new.fit.values) - len(old.fit.values))
    return float(min(1.0, tests * tried * chi2.sf(2 * max(nats, 0.0), degrees)))


def weigh_name(
    less: ScoredFit, best: ScoredFit, tried: int, rng: np.random.Generator
) -> Evidence:
    """What speaks for a name, by the error with it and without it.

    Args:
        less: the fit without it.
        best: the fit with it, to the same segments.
        tried: number of names that were tried together (Bonferroni).
        rng: draws resamples of the blocks.
    """
    p_value = improvement_p_value(less, best, tried)
    if less.error > (1 + SELECTION.max_uncertain_removal) * best.error:
        # few blocks can have most of the error, and speak for all
        others = most_blocks_p_value(less, best, tried)
        p_value = min(1.0, 2 * min(p_value, others))
    gains = np.bincount(
        assign_blocks(less.fit.problem), less.held_out_errors - best.held_out_errors
    )
    draws = rng.integers(len(gains), size=(SELECTION.bootstrap_resamples, len(gains)))
    stability = float((gains[draws].sum(axis=1) > 0).mean())
    return Evidence(gain_nats(less, best), p_value, stability)


def most_blocks_p_value(old: ScoredFit, new: ScoredFit, tried: float) -> float:
    """p-value that a fit predicts most blocks of segments better than another one.

    A paired t test of the logarithms of the blocks' held-out errors, in which no block
    counts more than another. Where a robot is hard to predict, one can have most of the
    error.

    Args:
        old: the fit with fewer parameters.
        new: the fit with more of them, to the same segments.
        tried: number of independent candidates of which `new` is one (Bonferroni).
    """
    from scipy.stats import ttest_1samp

    block = assign_blocks(old.fit.problem)
    before, after = (
        np.log(np.maximum(np.bincount(block, f.held_out_errors), FIT.tiny))
        for f in (old, new)
    )
    if len(before) < 2 or np.ptp(before - after) == 0:
        return 1.0
    test = ttest_1samp(before - after, 0, alternative="greater")
    return float(min(1.0, tried * test.pvalue))


def _significant_nats(old: ScoredFit, new: ScoredFit, used: np.ndarray) -> float:
    """Log-likelihood ratio [nats] of two fits in some segments; 0 if it is not steady.

    Args:
        old: the fit with fewer parameters.
        new: the fit with more of them, to the same segments.
        used: (W) which segments count.
    """
    problem = old.fit.problem
    _, block = np.unique(assign_blocks(problem)[used], return_inverse=True)
    gains = np.bincount(block, (old.held_out_errors - new.held_out_errors)[used])
    if len(gains) < 2:
        return 0.0
    least = SELECTION.min_gain_standard_errors * gains.std(ddof=1) * len(gains) ** 0.5
    if gains.sum() <= least:
        return 0.0
    before, after = (s.held_out_errors[used].sum() for s in (old, new))
    # the larger residuals are the old ones, and the more alike their neighbors
    residuals = old.fit.residuals * used[problem.segment_of_residual]
    samples = effective_sample_size(problem, residuals)
    return float(0.5 * samples * np.log(before / max(after, FIT.tiny)))


def _log_likelihoods(scored: ScoredFit) -> Floats:
    """Two log-likelihoods [nats] of held-out single readings, of unknown scale.

    Of segments w with m_w readings and squared errors E_w, up to a constant:

        normal:     -M/2 log(E / M),  M and E the sums over all segments
        Student's:  -M/2 log(s) - sum_w (nu + m_w)/2 log(1 + E_w / (nu s))

    By the first a pose in which the robot tips tells most; by the second, with nu
    degrees of freedom shared by a segment's columns, it may be an accident. Its scale s
    is iterated by eq. 6 of Lange, Little and Taylor (1989).

    Returns:
        (2) [nats] normal, Student's t.
    """
    problem, errors = scored.fit.problem, scored.held_out_errors
    is_known = np.isfinite(problem.segments.readings)
    count = np.zeros(len(errors))
    for channel in problem.simulator.channels:
        is_read = is_known[:, channel.columns].all(axis=1)
        count += (
            np.bincount(problem.segments.segment_of_sample, is_read, len(errors))
            * channel.free_columns
        )
    freedom = SELECTION.student_degrees_of_freedom
    scale = mean = max(errors.sum() / count.sum(), FIT.tiny)
    least = SELECTION.student_min_scale**2 * mean
    for _ in range(SELECTION.student_iterations):
        weight = (freedom + count) / (freedom + errors / scale)
        scale = max(float((weight * errors).sum() / count.sum()), least)
    tails = (freedom + count) / 2 * np.log1p(errors / scale / freedom)
    normal = -count.sum() / 2 * np.log(mean)
    return np.array([normal, -count.sum() / 2 * np.log(scale) - tails.sum()])


def bic(scored: ScoredFit) -> float:
    """Normal log-likelihood of single readings less half the BIC penalty [nats].

    log L - k/2 log(M) with k parameters and M readings: minus half of the Bayesian
    information criterion (Schwarz 1978), so that more is better.
    """
    readings = np.isfinite(scored.fit.problem.segments.readings).sum()
    penalty = 0.5 * np.log(readings) * len(scored.fit.values)
    return float(_log_likelihoods(scored)[0] - penalty)


def is_as_good(
    other: ScoredFit,
    lead: ScoredFit,
    margin: float = SELECTION.exchange_margin,
) -> bool:
    """Whether the segments do not tell that a fit predicts worse than the leading one.

    Where the leading fit leaves little but noise, the likelihood ratio tells, if not by
    one segment alone. Where both models are wrong, the difference of held-out errors
    has to exceed its standard errors over the blocks.

    Args:
        other: that may be as good.
        lead: that predicts best, in the same segments.
        margin: [standard errors or nats] by which the other one may be worse.
    """
    problem = lead.fit.problem
    if problem.regime.has_single_readings:
        return bic(lead) - bic(other) < margin
    if _is_clearly_likelier(lead, other):
        return False
    losses = np.bincount(
        assign_blocks(problem), other.held_out_errors - lead.held_out_errors
    )
    error = losses.std(ddof=1) * np.sqrt(len(losses)) if len(losses) > 1 else np.inf
    ratio = other.error / max(lead.error, FIT.tiny)
    samples = effective_sample_size(problem, lead.fit.residuals)
    nats = 0.5 * samples * np.log(max(ratio, FIT.tiny))
    is_within_errors = losses.sum() <= margin * error
    is_close = ratio < SELECTION.max_equivalent_error_ratio
    return bool(is_within_errors and is_close) or bool(nats < margin)


def _is_clearly_likelier(lead: ScoredFit, other: ScoredFit) -> bool:
    """Whether a fit surely predicts better, by more than it leaves beside the noise.

    The segment that speaks most for it does not count.

    Args:
        lead: the fit that may be better.
        other: the fit that may be worse, to the same segments.
    """
    losses = other.held_out_errors - lead.held_out_errors
    rest = np.arange(len(losses)) != np.argmax(losses)
    before, after = (s.held_out_errors[rest].sum() for s in (other, lead))
    ratio = before / max(after, FIT.tiny)
    left = noise_ratio(lead.fit) ** 2
    samples = effective_sample_size(lead.fit.problem, lead.fit.residuals)
    nats = 0.5 * samples * np.log(max(ratio, FIT.tiny))
    least = max(left, 1 + SELECTION.certain_error_excess)
    return bool(nats > SELECTION.certain_nats and ratio > least)


def bootstrap_stability(
    tried: Sequence[ScoredFit], winners: Sequence[ScoredFit]
) -> float:
    """Share of bootstraps of the blocks in which one of the winners comes first.

    A block bootstrap (Kuensch 1989) of the choice, in the sense of stability selection
    (Meinshausen and Buehlmann 2010).

    Args:
        tried: fits with one candidate each, to the same segments.
        winners: the one that got the name, and those that cannot be told from it.
    """
    rng = np.random.default_rng(0)
    block = assign_blocks(tried[0].fit.problem)
    errors = np.array([np.bincount(block, s.held_out_errors) for s in tried])
    blocks = errors.shape[1]
    draws = rng.integers(blocks, size=(SELECTION.bootstrap_resamples, blocks))
    first = errors[:, draws].sum(axis=-1).argmin(axis=0)
    keys = {s.candidate.key for s in winners}
    return float(np.mean([tried[i].candidate.key in keys for i in first]))


def gain_nats(old: ScoredFit, new: ScoredFit) -> float:
    """Gain [nats] per effective sample of held-out predictions: log(old / new) / 2."""
    return float(0.5 * np.log(old.error / max(new.error, FIT.tiny)))


def find_uncertain(fit: Fit) -> list[Term]:
    """Effects whose values are all within their standard errors of nominal ones.

    A Wald test (1943). The errors count those of the time step and of the commands'
    clock, which a likelihood ratio does not. In contact, and of single readings, none
    could be trusted.

    Args:
        fit: with a Jacobian near its values.
    """
    regime = fit.problem.regime
    if regime.has_rough_cost or regime.has_single_readings:
        return []
    errors = split_values(fit.terms, standard_errors(fit))
    found = []
    for (term, values), limits in zip(fit.values_by_term.items(), errors, strict=True):
        each = zip(term.parameters, values, limits, strict=True)
        is_near = [
            abs(v - p.nominal) <= SELECTION.min_standard_errors * error
            for p, v, error in each
        ]
        if is_near and all(is_near) and term.effect.name != "stated":
            found.append(term)
    return found
