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
from ..estimation.candidate_fit import LinearizedFit, fit_candidate
from ..estimation.least_squares import Fit, fit_parameters
from ..estimation.marginalization import (
    keep_informative,
    marginalize_initial_states,
)
from ..estimation.noise import noise_ratio
from ..estimation.problem import Problem
from ..estimation.reweighting import downweight_unscored
from ..estimation.settings import FIT
from ..simulation.dataset import (
    LONG_SEGMENTS,
    SHORT_SEGMENT,
    Dataset,
    cut_readable_segments,
)
from .backward import compute_worst_growth, eliminate_backward, fit_without
from .criteria import significant_prior_penalty
from .cross_validation import ScoredFit
from .evidence import weigh_name
from .hypotheses import Hypothesis, NamedEffect
from .screening import mean_seconds
from .settings import SELECTION

# a hypothesis, and labels of the names that were refuted
Tested = tuple[Hypothesis, tuple[str, ...]]


def choose_hypothesis(dataset: Dataset, hypotheses: Sequence[Tested]) -> Tested:
    """The first of several hypotheses, unless held-out episodes speak for another.

    One with more parameters or rarer effects must be clearly better.
    """
    if len(hypotheses) == 1:
        return hypotheses[0]
    errors = _held_out_errors(dataset, [hypothesis for hypothesis, _ in hypotheses])
    best = int(np.argmin(errors))
    new, old = _complexity(hypotheses[best][0]), _complexity(hypotheses[0][0])
    is_simpler = all(n <= o for n, o in zip(new, old, strict=True))
    ratio = 1.0 if is_simpler else SELECTION.complex_hypothesis_error_ratio
    return hypotheses[best if errors[best] < ratio * errors[0] else 0]


def _complexity(hypothesis: Hypothesis) -> tuple[int, int]:
    """Rarity of the effects that a hypothesis names, in sum, and their parameters."""
    terms = [n.term for n in hypothesis.named]
    return sum(t.effect.rarity for t in terms), sum(len(t.parameters) for t in terms)


def keep_competitive(
    dataset: Dataset, hypotheses: Sequence[Hypothesis]
) -> list[Hypothesis]:
    """The first hypothesis, and those that are as good in the held-out episodes."""
    errors = _held_out_errors(dataset, hypotheses) if len(hypotheses) > 1 else [0.0]
    return [h for h, e in zip(hypotheses, errors, strict=True) if e <= errors[0]]


def _held_out_errors(dataset: Dataset, hypotheses: Sequence[Hypothesis]) -> list[float]:
    """Held-out squared error [1] of each, with the weights of the first one.

    The geometric mean over segments of several lengths, as long as these inform: the
    longer ones show what builds up slowly.
    """
    first = hypotheses[0]
    sigma, fit = downweight_unscored(first.problem, first.final.fit), first.final.fit
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


def hand_over_plain(dataset: Dataset, tested: Tested) -> Tested | None:
    """All usual effects that stand on evidence, where their fit predicts better.

    The fit of all usual effects at once is what an engineer would try first. Where it
    predicts held-out episodes better than a hypothesis, the search missed something.

    Args:
        dataset: with the held-out episodes.
        tested: a hypothesis, and what was refuted.

    Returns:
        The other hypothesis; None where the first one is about as good or better.
    """
    hypothesis, plain = tested[0], tested[0].plain
    if plain is None:
        return None
    problem, count = hypothesis.problem, len(hypothesis.nominal.fit.terms)
    all_usual = replace(hypothesis, final=ScoredFit.from_fit(problem, plain))
    limit, error = _held_out_errors(dataset, [hypothesis, all_usual])
    limit /= SELECTION.worse_replay_ratio**2
    if error >= limit:
        return None
    fit = eliminate_backward(problem, plain, count)
    other = replace(hypothesis, final=ScoredFit.from_fit(problem, fit))
    other, refuted = _keep_proven(dataset, other, len(plain.terms) - count)
    if _held_out_errors(dataset, [hypothesis, other])[1] >= limit:
        return None
    return other, (*tested[1], *refuted)


def _keep_proven(dataset: Dataset, hypothesis: Hypothesis, tried: int) -> Tested:
    """The names that a likelihood-ratio test proves, in fitted or in held-out segments.

    What the fitted ones hardly tell, as friction under a load that is rare there,
    others can.

    Args:
        dataset: with the held-out episodes.
        hypothesis: whose terms beside the nominal ones are to be tested.
        tried: number of effects that were fitted together.
    """
    problem, fit = hypothesis.problem, hypothesis.final.fit
    held_out = _build_held_out(dataset, problem.sigma, mean_seconds(problem))
    held_out = marginalize_initial_states(held_out, fit.terms, fit.values)
    best, rng = _score_held_out(held_out, fit), np.random.default_rng(4)
    names, failed = [], []
    for term in fit.terms[len(hypothesis.nominal.fit.terms) :]:
        less = fit_without(LinearizedFit.from_fit(problem, fit), term)
        without = _score_held_out(held_out, less)
        old, new = (ScoredFit.from_fit(problem, f) for f in (less, fit))
        evidence = min(
            weigh_name(problem, old, new, 2 * tried, rng),
            weigh_name(held_out, without, best, 2 * tried, rng),
            key=lambda e: e.p_value,
        )
        if evidence.p_value < SELECTION.max_p_value:
            names.append(NamedEffect(term, evidence, ()))
        else:
            fit, best = less, without
            failed.append(term.label)
    scored = ScoredFit.from_fit(problem, fit)
    return replace(hypothesis, final=scored, named=tuple(names)), tuple(failed)


def _score_held_out(held_out: Problem, fit: Fit) -> ScoredFit:
    """A fit with the residuals and errors of segments that it was not fitted to."""
    residuals = held_out.residuals_at(fit.terms, fit.values)
    errors = held_out.sum_by_segment(residuals**2)
    return ScoredFit(replace(fit, residuals=residuals), errors)


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
        problem = hypothesis.problem
        substitutes, best = try_equivalents(problem, held_out, name, less)
        named = [[n] if n is not name else substitutes for n in hypothesis.named]
        hypothesis = replace(
            hypothesis,
            final=ScoredFit.from_fit(problem, best),
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
    if noise_ratio(held_out, predicted) > FIT.unexplained_ratio:
        before = squared_error_reestimated(held_out, hypothesis.nominal.fit)
        trifle = SELECTION.min_held_out_share * (before - error)
        least = max(least, min(trifle, SELECTION.max_trifle * error))
    values = fit.values_by_term
    weakest, smallest = None, least
    base = LinearizedFit.from_fit(hypothesis.problem, fit)
    for name in hypothesis.named:
        less = fit_without(base, name.term)
        without = held_out.residuals_at(less.terms, less.values)
        gain = squared_error_reestimated(held_out, less, without) - error
        if name.term.is_negligible(values[name.term]):
            return name, less
        relief = less.prior_penalty - fit.prior_penalty
        if relief > significant_prior_penalty(held_out, fit) and gain > -least:
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
    problem: Problem, held_out: Problem, refuted: NamedEffect, less: Fit
) -> tuple[list[NamedEffect], Fit]:
    """The equivalent of a name that helps most in held-out episodes, if one does.

    Args:
        problem: that is fitted.
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
        tried = fit_candidate(LinearizedFit.from_fit(problem, less), term)
        fit = fit_parameters(problem, tried.terms, tried.values, iterations=6)
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
    return (
        squared_error(problem, fit)
        if residuals is None
        else float(residuals @ residuals)
    )
