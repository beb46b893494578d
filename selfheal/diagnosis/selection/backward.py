"""Names taken away, or given to another: takes fits of several terms, gives fits."""

from collections.abc import Sequence

import numpy as np

from ..effects.base import Term, is_distinct
from ..estimation.candidate_fit import LinearizedFit, fit_candidate
from ..estimation.least_squares import Fit, fit_parameters
from ..estimation.problem import Problem
from .criteria import is_plausible, is_rare_or_restating
from .cross_validation import ScoredFit, fit_and_score, predict_held_out
from .evidence import is_as_good
from .settings import SELECTION


def compute_removal_costs(base: LinearizedFit, nominal_terms: int) -> dict[Term, float]:
    """What each effect's absence would make of the cost, of 1, if all were linear.

    What is absent at infinity (a limit) is as good as absent at its bound.
    """
    found = base.fit
    ends = np.cumsum([0, *(len(t.parameters) for t in found.terms)])
    prices = {}
    for i, term in enumerate(found.terms[nominal_terms:], nominal_terms):
        own = np.arange(ends[i], ends[i + 1])
        absent = np.array([p.nominal for p in term.parameters])
        absent = np.clip(absent, term.low, term.high)
        back = found.jacobian[:, own] @ (absent - found.values[own])
        left, _ = base.minimize(found.residuals + back, hold=own)
        prices[term] = left / found.cost
    return prices


def eliminate_backward(problem: Problem, found: Fit, nominal_terms: int) -> Fit:
    """Without the effects that cost next to nothing to take away, a half at a time."""
    while len(found.terms) > nominal_terms:
        prices = compute_removal_costs(
            LinearizedFit.from_fit(problem, found), nominal_terms
        )
        order = sorted(prices, key=lambda t: prices[t])[: max(1, len(prices) // 2)]
        gone = [t for t in order if prices[t] < 1 + SELECTION.removal_tolerance]
        if not gone:
            break
        found = fit_parameters(
            problem,
            *found.without_terms(*gone),
            rounds=2,
            known=found.jacobian_without(*gone),
        )
    return found


def exchange_term(
    problem, now: ScoredFit, term: Term, others: Sequence[Term]
) -> ScoredFit:
    """The fit with another term in one's place, if that predicts better.

    What looked best alone need not do so beside a later effect; and where the data do
    not tell, the usual effect with the least to choose is the one.
    """
    kept, _ = now.fit.without_terms(term)
    others = [t for t in others if is_distinct(t, kept)]
    if not others:
        return now
    base = LinearizedFit.from_fit(problem, fit_without(problem, now.fit, term))
    tried = [fit_candidate(base, other) for other in others]
    tried.sort(key=lambda f: predict_held_out(problem, f).sum())
    for found in tried[: SELECTION.max_exchange_trials]:
        near = found.jacobian
        full = fit_and_score(problem, found.terms, found.values, rounds=6, known=near)
        if full.error < SELECTION.exchange_error_ratio * now.error:
            if is_rare_or_restating(term) or is_plausible(problem, now, full):
                return full
        elif is_simpler(full.candidate, term) and is_as_good(problem, full, now):
            return full
    return now


def is_simpler(new: Term, old: Term) -> bool:
    """Whether an effect is to be preferred where the data do not tell."""
    if new.effect.rarity != old.effect.rarity:
        return new.effect.rarity < old.effect.rarity
    return len(new.parameters) < len(old.parameters)


def fit_without(problem: Problem, found: Fit, term: Term) -> Fit:
    """The fit of all terms but one."""
    return fit_parameters(
        problem,
        *found.without_terms(term),
        rounds=3,
        known=found.jacobian_without(term),
    )
