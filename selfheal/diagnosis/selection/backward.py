"""Effects removed or exchanged: takes fits with several effects, gives fits.

Backward elimination and exchange, the steps that follow each forward step of a stepwise
regression (Efroymson 1960).
"""

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import repeat_by_column
from ..effects.base import Term
from ..effects.terms import is_distinct, start_beside
from ..estimation.candidate_fit import fit_candidate, spread_around
from ..estimation.fit import Fit
from ..estimation.least_squares import fit_parameters
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.noise import normalize_rms
from ..estimation.problem import Problem
from ..estimation.settings import FIT
from .criteria import is_plausible, is_rare_or_restating
from .cross_validation import ScoredFit, fit_and_score, predict_held_out
from .evidence import improvement_p_value, is_as_good
from .settings import SELECTION

# of the cost, by which a lower bound may be too high [1]; chosen: above its rounding
ROUNDING = 1e-6


def compute_removal_costs(
    base: LinearizedFit, terms: Iterable[Term], removed: Iterable[Term] = ()
) -> dict[Term, float]:
    """Penalized cost without each effect, as a share of that with all, to first order.

    The effect's values move to their nominal ones while all others are re-fitted. A
    value that is nominal at infinity (a limit) moves to its bound. Of the cost of all
    columns and, near the noise, those of each scored column, the one that grows most
    counts: what one joint lacks hardly shows among the readings of many.

    Args:
        base: the fit with all effects.
        terms: the effects to take away, one at a time.
        removed: effects that are without in any case.

    Returns:
        [1] of each of the terms.
    """
    fit, (squares, gradients, curvatures) = base.fit, base.restored.by_column
    counted = _find_counted_columns(base.problem, fit.residuals)
    costs = {}
    for term in terms:
        step = base.step_without([*removed, term])
        after = squares + 2 * gradients @ step + curvatures @ step @ step
        penalty = base.prior @ (fit.values + step - 1) ** 2
        costs[term] = max(
            float(after.sum() + penalty) / (fit.cost + fit.prior_penalty),
            float((after[counted] / squares[counted]).max(initial=0.0)),
        )
    return costs


def is_needless(fit: ScoredFit, less: ScoredFit) -> bool:
    """Whether a fit without an effect predicts as well, in each scored column too.

    Args:
        fit: with the effect.
        less: without it, in the same problem.
    """
    before, after = fit.fit, less.fit
    growth = compute_worst_growth(before.problem, before.residuals, after.residuals)
    limit = 1 + SELECTION.removal_tolerance
    return less.error < limit * fit.error and growth < limit


def compute_worst_growth(problem: Problem, before: Floats, after: Floats) -> float:
    """Largest ratio of squared residuals after and before, of counted columns [1].

    Args:
        problem: of the residuals.
        before: (R) [standard deviations].
        after: (R) [standard deviations].
    """
    counted = _find_counted_columns(problem, before)
    old, new = (
        (r.reshape(-1, len(counted)) ** 2).sum(axis=0)[counted] for r in (before, after)
    )
    return float((new / old).max(initial=0.0))


def _find_counted_columns(problem: Problem, residuals: Floats) -> np.ndarray:
    """(C) whether a column's error counts for itself: a scored one, near the noise.

    Where more than noise is left, an effect may stand for what is missing in one.
    """
    scored = repeat_by_column(problem.simulator.channels, "is_scored")
    is_far = normalize_rms(problem, residuals) > FIT.strictly_unexplained_ratio
    squares = (residuals.reshape(-1, len(scored)) ** 2).sum(axis=0)
    return scored & (squares > 0) & (not is_far)


def find_negligible(fit: Fit) -> set[Term]:
    """Terms of a fit whose values are as good as nominal."""
    return {t for t, values in fit.values_by_term.items() if t.is_negligible(values)}


def eliminate_backward(fit: Fit, nominal_count: int) -> Fit:
    """Remove effects that together cost next to nothing, up to half of them at a time.

    One after the other in the linearized fit, for of two that do the same one has to
    stay; then all others are fitted again.

    Args:
        fit: with all effects.
        nominal_count: number of nominal terms, which stand first.
    """
    limit = (1 + SELECTION.removal_tolerance) * (fit.cost + fit.prior_penalty)
    while removed := _list_needless(fit, nominal_count, limit):
        fit = fit_parameters(
            fit.problem,
            *fit.without_terms(*removed),
            iterations=1,
            jacobian=fit.restore(removed).jacobian_without(*removed),
        )
    return fit


def _list_needless(fit: Fit, nominal_count: int, limit: float) -> list[Term]:
    """Up to half of the effects of a fit that together cost next to nothing.

    Args:
        fit: with all effects.
        nominal_count: number of nominal terms, which stand first.
        limit: of the penalized cost without them [1].
    """
    base, effects = LinearizedFit.from_fit(fit), fit.terms[nominal_count:]
    share = limit / (fit.cost + fit.prior_penalty)
    removed: list[Term] = []
    while len(removed) < max(1, len(effects) // 2):
        left = [t for t in effects if t not in removed]
        needless = _find_most_needless(base, left, removed, share)
        if needless is None:
            break
        removed.append(needless)
    return removed


def _find_most_needless(
    base: LinearizedFit, terms: Sequence[Term], removed: Sequence[Term], limit: float
) -> Term | None:
    """The effect without which the cost is least, if that is not above a limit.

    Of two that do the same, the one that is as good as absent. Costs are computed of
    few: the others' lower bounds are above those.

    Args:
        base: the fit with all effects.
        terms: effects, of which one may go.
        removed: effects that are without in any case.
        limit: of the cost, as a share of that with all [1].
    """
    fit, negligible = base.fit, find_negligible(base.fit)
    bounds = base.bound_removal_costs(terms, removed)
    whole = fit.cost + fit.prior_penalty
    queue = [
        (t not in negligible, bounds[t] / whole - ROUNDING, i, False)
        for i, t in enumerate(terms)
    ]
    heapq.heapify(queue)
    while queue:
        counts, cost, i, is_known = heapq.heappop(queue)
        if is_known:
            return terms[i]
        if cost <= limit:
            (cost,) = compute_removal_costs(base, [terms[i]], removed).values()
        if cost <= limit:
            heapq.heappush(queue, (counts, cost, i, True))
    return None


def exchange_term(old: ScoredFit, term: Term, others: Sequence[Term]) -> ScoredFit:
    """The fit with another term in one's place, if that predicts better.

    What looked best alone need not do so beside a later effect. Where the data do not
    tell two terms apart, the simpler one stays.

    Args:
        old: the fit with the term.
        term: that may be exchanged.
        others: terms that may take its place.
    """
    problem, (kept, _) = old.fit.problem, old.fit.without_terms(term)
    others = [
        start_beside(t, old.fit.terms, old.fit.values)
        for t in others
        if is_distinct(t, kept)
    ]
    others = _keep_promising(old.fit, term, others)
    if not others:
        return old
    less = fit_without(LinearizedFit.from_fit(old.fit), term)
    base = LinearizedFit.from_fit(less)
    tried = [fit_candidate(base, other) for other in others]
    tried.sort(key=lambda f: predict_held_out(f).sum())
    for fit in tried[: SELECTION.max_exchange_trials]:
        fit_from = partial(fit_and_score, problem, fit.terms, jacobian=fit.jacobian)
        quick = fit_from(fit.values, iterations=3, only_updates=True)
        is_promising = quick.error < old.error or (
            is_simpler(quick.candidate, term) and is_as_good(quick, old)
        )
        if not is_promising and fit.cost > old.fit.cost:
            continue
        new = fit_from(quick.fit.values, iterations=6)
        if not new.candidate.effect.is_consistent(new.values):
            continue
        grows = len(new.fit.values) > len(old.fit.values)
        p_value = improvement_p_value(old, new, len(others)) if grows else 0.0
        if p_value >= SELECTION.max_p_value:
            continue
        if new.error < SELECTION.exchange_error_ratio * old.error:
            if is_rare_or_restating(term) or is_plausible(old, new):
                return new
        elif is_simpler(new.candidate, term) and is_as_good(new, old):
            return new
    return old


def _keep_promising(fit: Fit, term: Term, others: Sequence[Term]) -> list[Term]:
    """Those of some terms that are simpler than a term, or may predict better.

    In its place none can lower the cost by more than beside it. That is estimated by a
    score test (Rao 1948), from the responses to its initial values and around them.

    Args:
        fit: with the term.
        term: that may be exchanged.
        others: terms that may take its place.
    """
    base = LinearizedFit.from_fit(fit)
    kept, values = fit.without_terms(term)
    least = SELECTION.min_score_gain * (1 - SELECTION.exchange_error_ratio) * fit.cost
    promising = []
    for other in others:
        if not is_simpler(other, term):
            around = spread_around(other, np.array(other.initial_values[0]))
            starts = np.vstack([other.initial_values, around])
            points = np.hstack([np.tile(values, (len(starts), 1)), starts])
            residuals = fit.problem.compute_residuals((*kept, other), points)
            if base.estimate_gain(residuals) < least:
                continue
        promising.append(other)
    return promising


def is_simpler(new: Term, old: Term) -> bool:
    """Whether a term is less rare, or as rare with fewer parameters."""
    if new.effect.rarity != old.effect.rarity:
        return new.effect.rarity < old.effect.rarity
    return len(new.parameters) < len(old.parameters)


def estimate_without(
    base: LinearizedFit, removed: Sequence[Term]
) -> tuple[ScoredFit, Floats]:
    """The fit without some terms to first order, and the step (P) to it."""
    fit = base.fit.restore(removed)
    step = base.step_without(removed) if removed else np.zeros(len(fit.values))
    kept, values = replace(fit, values=fit.values + step).without_terms(*removed)
    residuals = fit.residuals + fit.jacobian @ step
    less = Fit(fit.problem, kept, values, residuals, fit.jacobian_without(*removed))
    return ScoredFit(less, predict_held_out(less, linearly=True)), step


def fit_without(base: LinearizedFit, term: Term) -> Fit:
    """Fit all terms but one, from where the linearization of all of them leads.

    Where that leaves much more, a closer fit would not change the answer.

    Args:
        base: the fit with all terms.
        term: to leave out.
    """
    problem, fit = base.problem, base.fit.restore([term])
    jacobian = fit.jacobian_without(term)
    predicted = compute_removal_costs(base, [term])[term] * fit.cost
    moved = replace(fit, values=fit.values + base.step_without([term]))
    kept, start = moved.without_terms(term)
    if predicted > SELECTION.clear_removal_error_ratio * fit.cost:
        residuals = problem.residuals_at(kept, start)
        less = Fit(problem, kept, start, residuals, jacobian)
        if less.cost > SELECTION.clear_removal_error_ratio * fit.cost:
            return less
    less = fit_parameters(
        problem, kept, start, iterations=3, jacobian=jacobian, only_updates=True
    )
    limit = (1 + SELECTION.removal_tolerance) * fit.cost
    if less.cost <= limit:
        return less
    if min(less.cost, predicted) < (1 + SELECTION.max_uncertain_removal) * fit.cost:
        less = fit_parameters(
            problem, kept, less.values, iterations=3, jacobian=less.jacobian
        )
    return less
