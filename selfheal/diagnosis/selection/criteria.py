"""Which of some candidates earns a name: takes their fits, gives one or none."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..effects.base import Term, find_overridden, implements
from ..estimation.candidate_fit import LinearizedFit
from ..estimation.least_squares import (
    Fit,
    compute_jacobian,
    fit_parameters,
    prior_precision,
    refine_undamped,
)
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.noise import LEFT, noise_ratio
from ..estimation.problem import Problem
from ..estimation.reweighting import reestimate_initial_states
from .cross_validation import ScoredFit, fit_and_score, generalizes_across_episodes
from .evidence import (
    Evidence,
    bic,
    bootstrap_stability,
    improvement_p_value,
    is_as_good,
)
from .screening import Progress
from .settings import SELECTION


@dataclass(frozen=True, eq=False)
class Claim:
    """What speaks for a name, and what else might have got it.

    Attributes:
        evidence: for it.
        rivals: what cannot be told from it.
        others: what else might take its place beside later effects.
    """

    evidence: Evidence
    rivals: tuple[Term, ...] = ()
    others: tuple[Term, ...] = ()


def fit_finalists(
    problem: Problem, fits: Sequence[Fit], progress: Progress
) -> list[ScoredFit]:
    """The candidates' predictions, the best ones' with everything else fitted anew."""
    found = [ScoredFit.from_fit(problem, f) for f in fits]
    found.sort(key=lambda s: s.error)
    for i in range(min(SELECTION.max_finalists, len(found))):
        old = found[i]
        progress(f"fitting {old.candidate.label}", i / SELECTION.max_finalists)
        at, near = old.fit.values, old.fit.jacobian
        new = fit_and_score(problem, old.fit.terms, at, rounds=3, known=near)
        if new.error < old.error:
            found[i] = new
        found[i] = _score_reestimated(problem, found[i])
    return found


def _score_reestimated(problem: Problem, found: ScoredFit) -> ScoredFit:
    """The same with the starts that its values ask for, if it is better there."""
    terms, values = found.fit.terms, found.fit.values
    reestimated = reestimate_initial_states(problem, terms, values)
    if reestimated is problem:
        return found
    near = problem.transfer_jacobian(reestimated, found.fit.jacobian)
    new = replace(
        fit_and_score(reestimated, terms, values, rounds=4, known=near),
        reestimated=reestimated,
    )
    return new if new.error < found.error else found


def fit_parameterless(
    base: LinearizedFit,
    nominal_terms: int,
    candidates: Sequence[Term],
    progress: Progress,
) -> list[ScoredFit]:
    """Predictions of what leaves nothing to fit, as a lost limb, begun from the start.

    Stated values and starts that were sought without it are so far off that it seems of
    no use there. So it is looked at with values as given and starts as read, and those
    that mend most of it are fitted from there.
    """
    whole = [t for t in candidates if not t.parameters]
    problem, found = base.problem, base.fit
    if not whole or problem.regime.has_single_readings:
        return []
    raw = replace(problem.unmarginalized, initial_state_shift=None)
    values = np.append(np.ones(nominal_terms), found.values[nominal_terms:])
    before = raw.residuals_at(found.terms, values)
    costs = {}
    for term in whole:
        after = raw.residuals_at((*found.terms, term), values)
        costs[term] = float(after @ after) / float(before @ before)
    order = sorted(whole, key=lambda t: costs[t])[: SELECTION.max_parameterless]
    scores = []
    for term in [t for t in order if costs[t] < SELECTION.large_gain_error_ratio]:
        progress(f"fitting {term.label}", 0.0)
        terms = (*found.terms, term)
        reestimated = marginalize_initial_states(raw, terms, values)
        scores.append(
            replace(
                fit_and_score(reestimated, terms, values, rounds=4),
                reestimated=reestimated,
            )
        )
    return scores


def choose_winner(
    problem: Problem, now: ScoredFit, finals: Sequence[ScoredFit], tried: float
) -> tuple[ScoredFit, Claim] | None:
    """The candidate that earns a name, and its claim to it."""
    p_value = {s: improvement_p_value(problem, now, s, tried) for s in finals}
    good = [
        s
        for s in finals
        if p_value[s] < SELECTION.max_p_value
        and not s.candidate.is_negligible(s.values)
        and s.error < (1 - problem.regime.min_gain) * now.error
        and is_plausible(problem, now, s)
        and generalizes_across_episodes(problem, now.fit, s.fit, s.reestimated)
    ]
    if not good:
        return None
    best = _choose_likeliest(problem, now, sorted(good, key=lambda s: s.error))
    others = [s for s in good if s is not best]
    also = [
        s for s in others if is_as_good(problem, s, best, SELECTION.equivalence_margin)
    ]
    evidence = Evidence(
        float(0.5 * np.log(now.error / max(best.error, 1e-300))),
        p_value[best],
        bootstrap_stability(problem, good, [best, *also]),
    )
    return best, Claim(
        evidence,
        tuple(s.candidate for s in also[: SELECTION.max_rivals]),
        tuple(s.candidate for s in others),
    )


def find_relieving(
    base: LinearizedFit, now: ScoredFit, candidates: Sequence[Term], progress: Progress
) -> tuple[ScoredFit, Claim] | None:
    """The candidate without which stated values are too far from what is believed.

    Several at their bounds can stand for one that had to leave them. Only where the
    readings fit as they are: else what is missing has pushed them there.
    """
    from scipy.stats import chi2

    problem = base.problem
    if noise_ratio(problem, now.fit.residuals) >= LEFT:
        return None
    # where something touches, the cost is too rough to follow a valley
    end = (
        partial(refine_undamped, problem)
        if not problem.regime.has_rough_cost
        else lambda f: f
    )
    before = end(now.fit)
    fits = []
    for i, term in enumerate(candidates):
        progress(f"trying {term.label}", i / len(candidates))
        fits.append(_fit_freed(problem, before, term))
    fits.sort(key=lambda f: f.cost + f.prior_penalty)
    found = [
        ScoredFit.from_fit(problem, end(f)) for f in fits[: SELECTION.max_finalists]
    ]
    relief = {
        s: before.prior_penalty
        - s.fit.prior_penalty
        - max(s.fit.cost - before.cost, 0.0)
        for s in found
    }
    p_value = {
        s: float(len(candidates) * chi2.sf(relief[s], len(s.candidate.parameters)))
        for s in found
        if not s.candidate.is_negligible(s.values)
    }
    best = min(p_value, key=lambda s: p_value[s], default=None)
    if best is None or p_value[best] >= SELECTION.max_p_value:
        return None
    gain = float(0.5 * np.log(now.error / max(best.error, 1e-300)))
    rivals = tuple(
        s.candidate
        for s in p_value
        if p_value[s] < SELECTION.max_p_value and s is not best
    )
    sure = Evidence(
        gain, p_value[best], bootstrap_stability(problem, [now, *found], [best])
    )
    return best, Claim(sure, rivals, rivals)


def _fit_freed(problem: Problem, found: Fit, term: Term) -> Fit:
    """One step from a fit, with what it made of the values that a term says anew.

    The readings fit there; how far it has to go from there, belief tells.
    """
    factor = {t.targets[0]: v for t, v in zip(found.terms, found.values, strict=True)}
    target = term.targets[0]
    own = [p.nominal * factor.get(f"{target}/{p.name}", 1.0) for p in term.parameters]
    terms, start = (*found.terms, term), np.append(found.values, own)
    r = problem.residuals_at(terms, start)
    new = compute_jacobian(problem, terms, start, r, len(found.values))
    near = np.hstack([found.jacobian, new])
    near[:, find_overridden(term, found.terms)] = 0.0
    return fit_parameters(problem, terms, start, rounds=1, known=near)


def _choose_likeliest(
    problem: Problem, now: ScoredFit, good: Sequence[ScoredFit]
) -> ScoredFit:
    """Of candidates, the best first, the one that gets the name."""
    for s in good:
        if (
            s.candidate.effect.is_directly_observed(s.candidate)
            and s.error < SELECTION.large_gain_error_ratio * now.error
        ):
            return s
    if problem.regime.has_single_readings:
        good = sorted(good, key=partial(bic, problem), reverse=True)
        near = [
            s
            for s in good
            if is_as_good(problem, s, good[0], SELECTION.equivalence_margin)
        ]
        # a pose that is read once tells nothing of when a command arrives
        return min(
            near, key=lambda s: implements(s.candidate.effect, "transform_command")
        )
    close = [
        s for s in good if is_as_good(problem, s, good[0], SELECTION.equivalence_margin)
    ]
    usual = [s for s in close if not _rank_rarity(s)[0]] or close
    near = [
        s
        for s in usual
        if is_as_good(problem, s, usual[0], SELECTION.equivalence_margin)
    ]
    most = min(s.fit.prior_penalty for s in near) + significant_prior_penalty(
        problem, near[0].fit
    )
    near = [s for s in near if s.fit.prior_penalty < most]
    # of those that the data cannot rank, a usual one, with the least to choose
    return min(near, key=_rank_rarity)


def _rank_rarity(s: ScoredFit) -> tuple:
    """By what those go that the data cannot rank, the least odd first."""
    term = s.candidate
    own = s.fit.jacobian[:, len(s.fit.values) - len(term.parameters) :]
    # what does nothing here, as a shift along a joint's axis, is no choice
    free = (np.linalg.norm(own * term.scale, axis=0) > 1).sum()
    return term.effect.rate_rarity(term, s.values), free, s.error


def significant_prior_penalty(problem: Problem, found: Fit) -> float:
    """Strain [variances] that is no accident.

    Impacts make the cost rough, which drives every stated value some way.
    """
    values = np.count_nonzero(prior_precision(found.terms))
    return (
        SELECTION.significant_prior_penalty
        + problem.regime.prior_penalty_of_value * values
    )


def is_plausible(problem: Problem, now: ScoredFit, new: ScoredFit) -> bool:
    """Whether an effect is usual enough for what it explains.

    Where much stays unexplained, one that is rare, or says that the model's own numbers
    are far off, is more likely to stand for something else.
    """
    usual = not is_rare_or_restating(new.candidate)
    mostly = new.error < SELECTION.large_gain_error_ratio * now.error
    return usual or mostly or noise_ratio(problem, new.fit.residuals) < LEFT


def is_rare_or_restating(term: Term) -> bool:
    """Whether an effect is rare, or says that what the model states is not so."""
    return bool(term.effect.rarity or term.effect.restates_nominal)
