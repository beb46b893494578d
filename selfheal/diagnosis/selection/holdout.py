"""Names tried where nothing was fitted: takes namings, gives what holds there."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from ...recording.data import Floats
from ..effects.base import is_distinct
from ..estimation.candidate_fit import LinearizedFit, fit_candidate
from ..estimation.least_squares import Fit, fit_parameters
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.problem import Problem
from ..estimation.reweighting import downweight_unscored
from ..simulation.dataset import WINDOW, Dataset, cut_readable_segments
from ..simulation.model_variants import split_values
from .backward import fit_without
from .criteria import significant_prior_penalty
from .cross_validation import ScoredFit
from .hypotheses import Hypothesis, NamedEffect

CLEARLY = 0.8  # of a hypothesis' held-out squared error, that of a better one; chosen
# least share of the squared error in held-out episodes that a name removes, and of what
# all of them together do; chosen
HELPS, TRIFLE = 0.01, 0.003
UNSEEN = 0.1  # of what a name removes in fitted episodes, what it changes in those held
# out, relative to the error there: less cannot refute it; chosen

Tested = tuple[
    Hypothesis, tuple[str, ...]
]  # a hypothesis, and labels of what was refuted


def choose_hypothesis(dataset: Dataset, hypotheses: Sequence[Tested]) -> Tested:
    """Of several the first, unless held-out episodes speak for another.

    Clearly, if that one says more or rarer things.
    """
    if len(hypotheses) == 1:
        return hypotheses[0]
    errors = _held_out_errors(dataset, [hypothesis for hypothesis, _ in hypotheses])
    best = int(np.argmin(errors))
    new, old = _complexity(hypotheses[best][0]), _complexity(hypotheses[0][0])
    simpler = all(n <= o for n, o in zip(new, old, strict=True))
    margin = 1.0 if simpler else CLEARLY
    return hypotheses[best if errors[best] < margin * errors[0] else 0]


def _complexity(hypothesis: Hypothesis) -> tuple[int, int]:
    """How many rare effects a hypothesis names, and numbers of all of them."""
    terms = [n.term for n in hypothesis.named]
    return sum(t.effect.rarity for t in terms), sum(len(t.parameters) for t in terms)


def keep_competitive(
    dataset: Dataset, hypotheses: Sequence[Hypothesis]
) -> list[Hypothesis]:
    """The first of several, and those that are as good in the held-out episodes."""
    errors = _held_out_errors(dataset, hypotheses) if len(hypotheses) > 1 else [0.0]
    return [n for n, e in zip(hypotheses, errors, strict=True) if e <= errors[0]]


def _held_out_errors(dataset: Dataset, hypotheses: Sequence[Hypothesis]) -> list[float]:
    """Squared residuals in held-out episodes, weighed as the first one's score."""
    sigma = downweight_unscored(hypotheses[0].problem, hypotheses[0].final.fit)
    held = Problem(
        dataset.held_out, cut_readable_segments(dataset.held_out, WINDOW), sigma
    )
    return [squared_error(held, hypothesis.final.fit) for hypothesis in hypotheses]


def drop_refuted(dataset: Dataset, hypothesis: Hypothesis) -> Tested:
    """Only the names that help in the held-out episodes, and labels of the others.

    A name that makes far less difference there than where it was fitted, as that of a
    rotor's inertia where nothing moves fast, is not refuted. What could not be told
    from one that is refuted takes its place, if it helps.
    """
    gone: list[str] = []
    start = Problem(
        dataset.held_out,
        cut_readable_segments(dataset.held_out, WINDOW),
        hypothesis.problem.sigma,
    )
    while hypothesis.named:
        found, alone = hypothesis.final.fit, hypothesis.nominal.fit
        held = marginalize_initial_states(start, found.terms, found.values)
        predicted = held.residuals_at(found.terms, found.values)
        error = float(predicted @ predicted)
        before = squared_error_reestimated(held, alone)
        least = max(HELPS * error, TRIFLE * (before - error))
        weakest = None
        values = dict(
            zip(found.terms, split_values(found.terms, found.values), strict=True)
        )
        for name in hypothesis.named:
            less = fit_without(hypothesis.problem, found, name.term)
            other = held.residuals_at(less.terms, less.values)
            gain = squared_error_reestimated(held, less, other) - error
            if name.term.is_negligible(values[name.term]):
                weakest = -np.inf, name, less
                break
            relief = less.prior_penalty - found.prior_penalty
            if relief > significant_prior_penalty(held, found) and gain > -least:
                continue
            changed = float(((other - predicted) ** 2).sum()) / error
            if changed < UNSEEN * (less.cost / found.cost - 1):
                continue
            if gain < least and (weakest is None or gain < weakest[0]):
                weakest = gain, name, less
        if weakest is None:
            break
        _, name, less = weakest
        gone.append(name.term.label)
        instead, best = try_equivalents(hypothesis.problem, held, name, less)
        named = [[n] if n is not name else instead for n in hypothesis.named]
        hypothesis = replace(
            hypothesis,
            final=ScoredFit.from_fit(hypothesis.problem, best),
            named=tuple(chain(*named)),
        )
    return hypothesis, tuple(gone)


def try_equivalents(
    problem: Problem, held: Problem, refuted: NamedEffect, less: Fit
) -> tuple[list[NamedEffect], Fit]:
    """Of what was equivalent to a name, what helps the most if anything does."""
    instead, best, least = [], less, (1 - HELPS) * squared_error(held, less)
    for term in refuted.equivalent:
        if not is_distinct(term, less.terms):
            continue
        tried = fit_candidate(LinearizedFit.from_fit(problem, less), term)
        found = fit_parameters(problem, tried.terms, tried.values, rounds=6)
        if (error := squared_error(held, found)) < least:
            others = tuple(t for t in refuted.equivalent if t is not term)
            instead = [replace(refuted, term=found.terms[-1], equivalent=others)]
            best, least = found, error
    return instead, best


def squared_error(problem: Problem, found: Fit) -> float:
    """Sum of squared residuals of a fit in other windows than its own."""
    return float((problem.residuals_at(found.terms, found.values) ** 2).sum())


def squared_error_reestimated(
    problem: Problem, found: Fit, predicted: Floats | None = None
) -> float:
    """The same; where starts were sought, from those likeliest for this fit.

    `predicted`: (R) residuals from the problem's own starts, if they are known.
    """
    if problem.initial_state_shift is not None:
        return squared_error(
            marginalize_initial_states(problem, found.terms, found.values), found
        )
    return (
        squared_error(problem, found)
        if predicted is None
        else float(predicted @ predicted)
    )
