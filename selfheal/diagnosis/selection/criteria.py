"""Which of some candidates earns a name: takes their fits, gives one or none.

A candidate has to pass a likelihood-ratio test of held-out residuals, to remove enough
error, to generalize across episodes, and to be usual enough for what it explains.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effects.base import Term, implements
from ..effects.terms import find_overridden
from ..estimation.candidate_fit import fit_candidate
from ..estimation.fit import Fit
from ..estimation.jacobian import compute_jacobian
from ..estimation.least_squares import fit_parameters, refine_undamped
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.noise import noise_ratio
from ..estimation.quadratic_model import prior_precision
from ..estimation.reweighting import reestimate_initial_states
from ..estimation.settings import FIT
from .cross_validation import ScoredFit, fit_and_score, generalizes_across_episodes
from .evidence import (
    Evidence,
    bic,
    bootstrap_stability,
    gain_nats,
    improvement_p_value,
    is_as_good,
)
from .screening import Progress
from .settings import SELECTION


@dataclass(frozen=True, eq=False)
class Claim:
    """What speaks for a name, and which terms may stand in its place.

    Attributes:
        evidence: for the name.
        rivals: terms that cannot be told from it.
        others: terms that may take its place beside later effects.
    """

    evidence: Evidence
    rivals: tuple[Term, ...] = ()
    others: tuple[Term, ...] = ()


def fit_finalists(fits: Sequence[Fit], progress: Progress) -> list[ScoredFit]:
    """Score candidates; those that predict best with all other values fitted again.

    Args:
        fits: with one candidate each, from the screening.
        progress: called with a message and a share (0 to 1).
    """
    scored = [ScoredFit.from_fit(fit) for fit in fits]
    scored.sort(key=lambda s: s.error)
    for i in range(min(SELECTION.max_finalists, len(scored))):
        old = scored[i]
        progress(f"fitting {old.candidate.label}", i / SELECTION.max_finalists)
        new = _fit_on(old)
        # no fit that converged predicts so well, unless the cost is rough
        if new.error < new.fit.cost and not new.fit.problem.regime.has_rough_cost:
            new = _fit_on(new)
        scored[i] = _score_reestimated(new if new.error < old.error else old)
    return scored


def _fit_on(scored: ScoredFit) -> ScoredFit:
    """A fit after three more iterations, scored."""
    fit = scored.fit
    return fit_and_score(
        fit.problem, fit.terms, fit.values, iterations=3, jacobian=fit.jacobian
    )


def _score_reestimated(old: ScoredFit) -> ScoredFit:
    """The fit with initial states estimated from its values, if it predicts better."""
    problem, terms, values = old.fit.problem, old.fit.terms, old.fit.values
    reestimated = reestimate_initial_states(problem, terms, values)
    if reestimated is problem:
        return old
    jacobian = old.fit.transfer_jacobian(reestimated)
    new = fit_and_score(reestimated, terms, values, iterations=4, jacobian=jacobian)
    new = replace(new, is_reestimated=True)
    return new if new.error < old.error else old


def fit_damages(
    base: LinearizedFit,
    nominal_count: int,
    candidates: Sequence[Term],
    progress: Progress,
) -> list[ScoredFit]:
    """Score what readings may show without a screening: lost limbs and jammed joints.

    Args:
        base: the fit without a candidate.
        nominal_count: number of nominal terms, which stand first.
        candidates: terms, of which those are tried.
        progress: called with a message and a share (0 to 1).
    """
    if base.problem.regime.has_single_readings:
        return []
    damages = [t for t in candidates if t.effect.is_damage(t)]
    fits = [fit_candidate(base, t) for t in damages if t.parameters]
    lost = [t for t in damages if not t.parameters]
    return [
        *_fit_parameterless(base, nominal_count, lost, progress),
        *fit_finalists(fits, progress),
    ]


def is_clear(old: ScoredFit, new: ScoredFit) -> bool:
    """Whether no other candidate can be likelier than a damage that earns its name.

    Args:
        old: the fit without it.
        new: the fit with it, which has no parameter or is seen in the readings.
    """
    if new.error >= SELECTION.large_gain_error_ratio * old.error:
        return False
    is_shown = new.candidate.effect.is_directly_observed(new.candidate)
    return is_shown or noise_ratio(new.fit) <= FIT.unexplained_ratio


def _fit_parameterless(
    base: LinearizedFit,
    nominal_count: int,
    candidates: Sequence[Term],
    progress: Progress,
) -> list[ScoredFit]:
    """Score candidates without a parameter, such as a lost limb.

    Nominal values and initial states that were fitted without a lost limb are so far
    off that it seems of no use there. So it is compared with nominal values as given
    and initial states as read. Those that remove most of the error are fitted from
    there.

    Args:
        base: the fit without a candidate.
        nominal_count: number of nominal terms, which stand first.
        candidates: terms without a parameter.
        progress: called with a message and a share (0 to 1).
    """
    problem, fit = base.problem, base.fit
    if not candidates:
        return []
    as_read = problem.with_measured_states
    values = np.append(np.ones(nominal_count), fit.values[nominal_count:])
    before = as_read.residuals_at(fit.terms, values)
    ratios = {}
    for term in candidates:
        after = as_read.residuals_at((*fit.terms, term), values)
        ratios[term] = float(after @ after) / float(before @ before)
    best = sorted(candidates, key=lambda t: ratios[t])[: SELECTION.max_parameterless]
    scored = []
    for term in [t for t in best if ratios[t] < SELECTION.large_gain_error_ratio]:
        progress(f"fitting {term.label}", 0.0)
        terms = (*fit.terms, term)
        reestimated = marginalize_initial_states(as_read, terms, values)
        new = fit_and_score(reestimated, terms, values, iterations=4)
        scored.append(replace(new, is_reestimated=True))
    return scored


def choose_winner(
    old: ScoredFit, finalists: Sequence[ScoredFit], tried: float
) -> tuple[ScoredFit, Claim] | None:
    """The candidate that earns a name, and its claim to it; None: no one does.

    Args:
        old: the fit without a candidate.
        finalists: fits with one candidate each, to the same segments.
        tried: number of independent candidates (`screen_candidates`).
    """
    p_value = {s: improvement_p_value(old, s, tried) for s in finalists}
    least = old.fit.problem.regime.min_gain
    good = [
        s
        for s in finalists
        if p_value[s] < SELECTION.max_p_value
        and not s.candidate.is_negligible(s.values)
        and s.error < (1 - least) * old.error
        and is_plausible(old, s)
        and generalizes_across_episodes(old.fit, s.fit)
    ]
    if not good:
        return None
    best = _choose_likeliest(old, sorted(good, key=lambda s: s.error))
    others = [s for s in good if s is not best]
    margin = SELECTION.equivalence_margin
    equivalent = [s for s in others if is_as_good(s, best, margin)]
    evidence = Evidence(
        gain_nats(old, best),
        p_value[best],
        bootstrap_stability(good, [best, *equivalent]),
    )
    return best, Claim(
        evidence,
        tuple(s.candidate for s in equivalent[: SELECTION.max_rivals]),
        tuple(s.candidate for s in others),
    )


def find_relieving(
    base: LinearizedFit, old: ScoredFit, candidates: Sequence[Term], progress: Progress
) -> tuple[ScoredFit, Claim] | None:
    """The candidate that brings nominal values back to where the prior has them.

    Several values at their bounds can stand for one that had to leave them. A
    likelihood-ratio test of the penalized cost, with p the candidate's parameters:

        fall of the prior penalty - rise of the cost,  compared with chi-square of p
        degrees

    Its p-value is corrected for the number of candidates (Bonferroni). No one is chosen
    where the readings do not fit: what is missing has pushed the values there.

    Args:
        base: the fit without a candidate.
        old: the same, scored.
        candidates: terms that restate a nominal value.
        progress: called with a message and a share (0 to 1).
    """
    from scipy.stats import chi2

    if noise_ratio(old.fit) >= FIT.strictly_unexplained_ratio:
        return None
    # in contact the cost is too rough to follow a valley
    is_rough = base.problem.regime.has_rough_cost
    refine = (lambda f: f) if is_rough else refine_undamped
    before = refine(old.fit)
    fits = []
    for i, term in enumerate(candidates):
        progress(f"trying {term.label}", i / len(candidates))
        fits.append(_fit_freed(before, term))
    fits.sort(key=lambda f: f.cost + f.prior_penalty)
    best_fits = fits[: SELECTION.max_finalists]
    scored = [ScoredFit.from_fit(refine(f)) for f in best_fits]
    relief = {
        s: before.prior_penalty
        - s.fit.prior_penalty
        - max(s.fit.cost - before.cost, 0.0)
        for s in scored
    }
    p_value = {
        s: float(len(candidates) * chi2.sf(relief[s], len(s.candidate.parameters)))
        for s in scored
        if not s.candidate.is_negligible(s.values)
    }
    best = min(p_value, key=lambda s: p_value[s], default=None)
    if best is None or p_value[best] >= SELECTION.max_p_value:
        return None
    good = [s for s in p_value if p_value[s] < SELECTION.max_p_value]
    rivals = tuple(s.candidate for s in good if s is not best)
    stability = bootstrap_stability([old, *scored], [best])
    evidence = Evidence(gain_nats(old, best), p_value[best], stability)
    return best, Claim(evidence, rivals, rivals)


def _fit_freed(fit: Fit, term: Term) -> Fit:
    """One iteration from a fit; a term begins at the fitted value that it restates.

    The readings fit there; the prior tells how far the value has to go from there.

    Args:
        fit: without the term.
        term: that restates a nominal value.
    """
    problem = fit.problem
    factors = {t.targets[0]: v for t, v in zip(fit.terms, fit.values, strict=True)}
    target = term.targets[0]
    restated = [
        p.nominal * factors.get(f"{target}/{p.name}", 1.0) for p in term.parameters
    ]
    terms, start = (*fit.terms, term), np.append(fit.values, restated)
    residuals = problem.residuals_at(terms, start)
    columns = compute_jacobian(problem, terms, start, residuals, len(fit.values))
    jacobian = np.hstack([fit.jacobian, columns])
    jacobian[:, find_overridden(term, fit.terms)] = 0.0
    return fit_parameters(problem, terms, start, iterations=1, jacobian=jacobian)


def _choose_likeliest(old: ScoredFit, good: Sequence[ScoredFit]) -> ScoredFit:
    """The candidate that gets the name, of some that earn it.

    Of candidates that the data cannot rank, those go first that leave nominal values
    far from the prior; of the rest the usual one with the fewest parameters stays.

    Args:
        old: the fit without a candidate.
        good: fits with one candidate each, the best first.
    """
    for s in good:
        is_observed = s.candidate.effect.is_directly_observed(s.candidate)
        if is_observed and s.error < SELECTION.large_gain_error_ratio * old.error:
            return s
    margin = SELECTION.equivalence_margin
    if old.fit.problem.regime.has_single_readings:
        good = sorted(good, key=bic, reverse=True)
        near = [s for s in good if is_as_good(s, good[0], margin)]
        # a pose that is read once tells nothing of when a command arrives
        return min(
            near, key=lambda s: implements(s.candidate.effect, "transform_command")
        )
    near = [s for s in good if is_as_good(s, good[0], margin)]
    usual = [s for s in near if not _rank_rarity(s)[0]] or near
    near = [s for s in usual if is_as_good(s, usual[0], margin)]
    limit = min(s.fit.prior_penalty for s in near)
    limit += significant_prior_penalty(near[0].fit)
    near = [s for s in near if s.fit.prior_penalty < limit]
    return min(near, key=_rank_rarity)


def _rank_rarity(s: ScoredFit) -> tuple:
    """Sort key of what the data cannot rank: rarity, free parameters, error."""
    term = s.candidate
    columns = s.fit.jacobian[:, len(s.fit.values) - len(term.parameters) :]
    # what does nothing here, as a shift along a joint's axis, is no choice
    free = (np.linalg.norm(columns * term.scale, axis=0) > 1).sum()
    return term.effect.rate_rarity(term, s.values), free, s.error


def significant_prior_penalty(fit: Fit) -> float:
    """Prior penalty [variances] that is no accident.

    Impacts make the cost rough, which drives every nominal value some way.
    """
    values = np.count_nonzero(prior_precision(fit.terms))
    by_roughness = fit.problem.regime.prior_penalty_of_value * values
    return SELECTION.significant_prior_penalty + by_roughness


def is_plausible(old: ScoredFit, new: ScoredFit) -> bool:
    """Whether an effect is usual enough for what it explains.

    Where much stays unexplained, an effect that is rare, or says that the model's own
    numbers are far off, is more likely to stand for something else. So is one whose
    value ends at a bound: it would be larger yet than any robot has it.

    Args:
        old: the fit without the effect, or with another one.
        new: the fit with the effect as its last term.
    """
    is_usual = not is_rare_or_restating(new.candidate)
    is_large = new.error < SELECTION.large_gain_error_ratio * old.error
    is_likely = (is_usual or is_large) and not new.candidate.is_at_bound(new.values)
    return is_likely or noise_ratio(new.fit) < FIT.strictly_unexplained_ratio


def is_rare_or_restating(term: Term) -> bool:
    """Whether an effect is rare, or says that what the model states is not so."""
    return bool(term.effect.rarity or term.effect.restates_nominal)
