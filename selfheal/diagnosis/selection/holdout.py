"""Names tested in held-out episodes: takes hypotheses, gives what holds there.

A validation set that no fit saw: hypotheses are compared in it, and each name has to
help there.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from ...recording.data import Floats
from ..effects.terms import is_distinct
from ..estimation.candidate_fit import fit_candidate
from ..estimation.fit import Fit
from ..estimation.least_squares import fit_parameters
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.marginalization import (
    keep_informative,
    marginalize_initial_states,
)
from ..estimation.noise import normalize_rms
from ..estimation.problem import Problem
from ..estimation.reweighting import downweight_unscored
from ..estimation.settings import FIT
from ..simulation.dataset import (
    LONG_SEGMENTS,
    SHORT_SEGMENT,
    Dataset,
    cut_readable_segments,
)
from .backward import (
    compute_worst_growth,
    fit_without,
)
from .criteria import significant_prior_penalty
from .cross_validation import ScoredFit
from .evidence import find_uncertain
from .hypotheses import Hypothesis, NamedEffect
from .screening import mean_seconds
from .settings import SELECTION

# a hypothesis, and labels of the names that were refuted
Tested = tuple[Hypothesis, tuple[str, ...]]


def choose_hypothesis(dataset: Dataset, hypotheses: Sequence[Hypothesis]) -> Hypothesis:
    """The hypothesis that predicts held-out episodes best."""
    if len(hypotheses) == 1:
        return hypotheses[0]
    return hypotheses[int(np.argmin(_held_out_errors(dataset, hypotheses)))]


def _held_out_errors(dataset: Dataset, hypotheses: Sequence[Hypothesis]) -> list[float]:
    """Held-out squared error [1] of each, with the weights of the first one.

    The geometric mean over segments of several lengths, as long as these inform: the
    longer ones show what builds up slowly.
    """
    fit = hypotheses[0].final.fit
    sigma = downweight_unscored(fit)
    held_out = (
        _build_held_out(dataset, sigma, seconds)
        for seconds in (SHORT_SEGMENT, *LONG_SEGMENTS)
    )
    problems = keep_informative(held_out, fit.terms, fit.values)
    errors = np.array([
        [squared_error_with_own_states(p, h.final.fit) for p in problems]
        for h in hypotheses
    ])  # fmt: skip
    return [float(x) for x in np.exp(np.log(errors + FIT.tiny).mean(axis=1))]


def _build_held_out(dataset: Dataset, sigma: Floats, seconds: float) -> Problem:
    """Held-out segments with residuals in standard deviations.

    Args:
        dataset: with the held-out episodes.
        sigma: (C) standard deviations [unit of each column].
        seconds: length of a segment [s].
    """
    segments = cut_readable_segments(dataset.held_out, seconds)
    return Problem(dataset.held_out, segments, sigma)


def keep_predictive(
    dataset: Dataset, refined: Hypothesis, searched: Hypothesis
) -> Hypothesis:
    """The last fit, unless the search's predicts held-out episodes better by 5 %.

    Over long segments a small error of the model, as of its time step, can grow so far
    that the values make up for it. Not in the segments of the search.

    Args:
        dataset: with the held-out episodes.
        refined: the hypothesis after its last fit.
        searched: the same one as the search fitted it.
    """
    if refined.problem.segments is searched.problem.segments:
        return refined
    new, old = _held_out_errors(dataset, [refined, searched])
    return searched if old < new / SELECTION.worse_replay_ratio**2 else refined


def drop_refuted(dataset: Dataset, hypothesis: Hypothesis) -> Tested:
    """Keep the names alone that help in the held-out episodes.

    Backward elimination by held-out error, the weakest name first. An equivalent of a
    name that goes takes its place, if it helps.
    """
    refuted: list[str] = []
    problem = hypothesis.problem
    as_read = _build_held_out(dataset, problem.sigma, mean_seconds(problem))
    while hypothesis.named:
        fit = hypothesis.final.fit
        held_out = marginalize_initial_states(as_read, fit.terms, fit.values)
        weakest = _find_weakest(hypothesis, held_out)
        if weakest is None:
            break
        name, less = weakest
        refuted.append(name.term.label)
        substitutes, best = try_equivalents(held_out, name, less)
        named = [[n] if n is not name else substitutes for n in hypothesis.named]
        hypothesis = replace(
            hypothesis,
            final=ScoredFit.from_fit(best),
            named=tuple(chain(*named)),
        )
    return hypothesis, tuple(refuted)


def _find_weakest(
    hypothesis: Hypothesis, held_out: Problem
) -> tuple[NamedEffect, Fit] | None:
    """The name that helps least in held-out episodes, if it does not help enough.

    Where more than noise is left, it must not be a trifle beside all names together,
    unless it removes a tenth of the error, or helps one scored column. A name that
    brings nominal values back to the prior need not help. Nor is a name refuted whose
    absence changes held-out predictions far less than fitted ones, as a rotor's inertia
    where nothing moves fast.

    Args:
        hypothesis: with names.
        held_out: segments of the held-out episodes, with the initial states that the
            hypothesis asks for.

    Returns:
        The name, and the fit without it.
    """
    fit = hypothesis.final.fit
    predicted = held_out.residuals_at(fit.terms, fit.values)
    error = float(predicted @ predicted)
    least = SELECTION.min_held_out_gain * error
    if normalize_rms(held_out, predicted) > FIT.unexplained_ratio:
        before = squared_error_reestimated(held_out, hypothesis.nominal.fit)
        trifle = SELECTION.min_held_out_share * (before - error)
        least = max(least, min(trifle, SELECTION.max_trifle * error))
    values = fit.values_by_term
    weakest, smallest = None, least
    base = LinearizedFit.from_fit(fit)
    uncertain = find_uncertain(fit)
    for name in hypothesis.named:
        less = fit_without(base, name.term)
        without = held_out.residuals_at(less.terms, less.values)
        gain = squared_error_reestimated(held_out, less, without) - error
        if name.term in uncertain or name.term.is_negligible(values[name.term]):
            return name, less
        relief = less.prior_penalty - fit.prior_penalty
        if relief > significant_prior_penalty(fit) and gain > -least:
            continue
        change = float(((without - predicted) ** 2).sum()) / error
        if change < SELECTION.min_held_out_effect * (less.cost / fit.cost - 1):
            continue
        growth = compute_worst_growth(held_out, predicted, without)
        if gain > 0 and growth > 1 + SELECTION.removal_tolerance:
            continue
        if gain < smallest:
            weakest, smallest = (name, less), gain
    return weakest


def try_equivalents(
    held_out: Problem, refuted: NamedEffect, less: Fit
) -> tuple[list[NamedEffect], Fit]:
    """The equivalent of a name that helps most in held-out episodes, if one does.

    Args:
        held_out: segments of the held-out episodes.
        refuted: the name.
        less: the fit without it.

    Returns:
        The name in its place, or none, and the fit.
    """
    substitutes, best = [], less
    limit = (1 - SELECTION.min_held_out_gain) * squared_error(held_out, less)
    for term in refuted.equivalent:
        if not is_distinct(term, less.terms):
            continue
        tried = fit_candidate(LinearizedFit.from_fit(less), term)
        fit = fit_parameters(less.problem, tried.terms, tried.values, iterations=6)
        if (error := squared_error(held_out, fit)) < limit:
            others = tuple(t for t in refuted.equivalent if t is not term)
            substitutes = [replace(refuted, term=fit.terms[-1], equivalent=others)]
            best, limit = fit, error
    return substitutes, best


def squared_error(problem: Problem, fit: Fit) -> float:
    """Squared error [1] of a fit in a problem that it was not fitted to."""
    return float((problem.residuals_at(fit.terms, fit.values) ** 2).sum())


def squared_error_with_own_states(problem: Problem, fit: Fit) -> float:
    """Squared error [1] of a fit, less what errors of its initial states explain."""
    return squared_error(
        marginalize_initial_states(problem, fit.terms, fit.values), fit
    )


def squared_error_reestimated(
    problem: Problem, fit: Fit, residuals: Floats | None = None
) -> float:
    """Squared error [1] of a fit with the initial states that are likeliest for it.

    Those of the problem where none had to be searched for.

    Args:
        problem: that the fit was not fitted to.
        fit: to be judged.
        residuals: (R) [1] from the problem's initial states, if they are known.
    """
    if problem.initial_state_shift is not None:
        return squared_error_with_own_states(problem, fit)
    if residuals is None:
        return squared_error(problem, fit)
    return float(residuals @ residuals)
