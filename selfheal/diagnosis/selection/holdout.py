"""Names tested in held-out episodes: takes hypotheses, gives what holds there.

A validation set that no fit saw: hypotheses are compared in it, and each name has to
help there.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from ..effects.base import Term
from ..effects.terms import is_distinct
from ..estimation.covariance import standard_errors
from ..estimation.fit import Fit
from ..estimation.least_squares import (
    fit_by_updates,
    fit_one_more,
    fit_parameters,
)
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.problem import Problem
from ..estimation.settings import FIT
from ..simulation.dataset import Dataset
from ..simulation.model_variants import split_values
from ..simulation.simulator import Simulator
from .hypotheses import Hypothesis, NamedEffect
from .judge import Judge, compare, is_clearly_better, is_outdone, measure_lead
from .settings import SELECTION
from .stated_values import release_bounds


def choose_hypothesis(
    held_out: Simulator, hypotheses: Sequence[Hypothesis]
) -> Hypothesis:
    """The fewest names that predict held-out episodes within a standard error of best.

    The rule of one standard error (Breiman et al. 1984), of paired differences. Where
    more than noise is left, each further effect explains some of it in the episodes
    that were fitted.
    """
    if len(hypotheses) == 1:
        return hypotheses[0]
    largest = max(hypotheses, key=lambda h: len(h.named))
    judge = Judge.build(held_out, largest.final)
    errors = [judge.log_errors(h.final) for h in hypotheses]
    means = [np.mean([e.mean() for e in each]) for each in errors]
    order = sorted(zip(hypotheses, errors, means, strict=True), key=lambda x: x[2])
    best = order[0]
    order.sort(key=lambda x: len(x[0].named))  # of as many names the best comes first
    return next(h for h, e, _ in order if compare(best[1], e).mean() <= 1)


def keep_predictive(
    held_out: Simulator, refined: Hypothesis, searched: Hypothesis
) -> Hypothesis:
    """The last fit, unless the search's predicts held-out episodes better.

    Over long segments a small error of the model, as of its time step, can grow so far
    that the values make up for it. Not in the segments of the search.

    Args:
        refined: the hypothesis after its last fit.
        searched: the same one as the search fitted it.
    """
    if refined.problem.segments is searched.problem.segments:
        return refined
    judge = Judge.build(held_out, refined.final)
    new, old = (judge.log_errors(h.final) for h in (refined, searched))
    return searched if compare(old, new).mean() > 0 else refined


def leave_bounds(dataset: Dataset, hypothesis: Hypothesis) -> Hypothesis:
    """The hypothesis without stated values at bounds, if it predicts no worse.

    Neither held-out episodes nor those fitted: few of the former tell little.
    """
    fit = hypothesis.final
    released = release_bounds(fit)
    if released is fit:
        return hypothesis
    for simulator in (dataset.held_out, dataset.training):
        judge = Judge.build(simulator, fit)
        if is_outdone(judge.log_errors(released), judge.log_errors(fit)):
            return hypothesis
    nominal = hypothesis.nominal if hypothesis.named else released
    return replace(hypothesis, final=released, nominal=nominal)


def drop_refuted(
    held_out: Simulator, hypothesis: Hypothesis
) -> tuple[Hypothesis, tuple[str, ...]]:
    """Keep the names that do no harm in the held-out episodes.

    Backward elimination, the worst name first. An equivalent of a name that goes
    takes its place, if it helps. The names that stay are in the order of how much the
    held-out error grows without each.

    Returns:
        The hypothesis, and labels of the names that go.
    """
    refuted: list[str] = []
    judge = Judge.build(held_out, hypothesis.final)
    while True:
        harmful, growth = _find_harmful(hypothesis, judge)
        if harmful is None:
            break
        name, less = harmful
        refuted.append(name.term.label)
        substitutes, best = try_equivalents(judge, name, less)
        named = [[n] if n is not name else substitutes for n in hypothesis.named]
        hypothesis = replace(hypothesis, final=best, named=tuple(chain(*named)))
    known = [replace(n, growth=growth[n.term.key]) for n in hypothesis.named]
    known.sort(key=lambda n: -n.growth)
    return replace(hypothesis, named=tuple(known)), tuple(refuted)


def _find_harmful(
    hypothesis: Hypothesis, judge: Judge
) -> tuple[tuple[NamedEffect, Fit] | None, dict[tuple, float]]:
    """A name that no episodes tell, or the one that harms most.

    That is the one without which held-out episodes are predicted best: clearly better,
    and by more nats of a segment than fitted ones are worse. A name whose values fitted
    episodes do not tell stays where held-out ones are predicted clearly worse without;
    one too small to matter never does.

    Returns:
        The name and the fit without it, or None; and by the key of each name's term
        the ratio [1] of the held-out error without it to that with it, which all are
        known of where none is harmful.
    """
    fit = hypothesis.final
    errors, values = judge.log_errors(fit), fit.values_by_term
    worst, most, growth = None, 0.0, dict[tuple, float]()
    uncertain = find_uncertain(fit)
    for name in hypothesis.named:
        if name.term.is_negligible(values[name.term]):
            return (name, _refit_without(fit, name.term, 0)), growth
        less = fit_without(fit, name.term)
        is_told = name.term not in uncertain
        without = judge.log_errors(less)
        growth[name.term.key] = float(np.exp(measure_lead(errors, without)))
        if is_told and not is_clearly_better(without, errors):
            continue
        less = fit_parameters(less.problem, less.terms, less.values, iterations=6)
        without = judge.log_errors(less)
        if not is_told and not is_outdone(without, errors):
            return (name, less), growth
        gained = 0.5 * np.log(max(less.cost, FIT.tiny) / max(fit.cost, FIT.tiny))
        lost = np.mean([(a - b).mean() for a, b in zip(errors, without, strict=True)])
        lead = float(compare(without, errors).mean())
        if is_clearly_better(without, errors) and lost > gained and lead > most:
            worst, most = (name, less), lead
    return worst, growth


def find_uncertain(fit: Fit) -> list[Term]:
    """Effects whose values are all within their standard errors of nominal ones.

    A Wald test (1943). The errors count those of the time step and of the commands'
    clock, which a likelihood ratio does not. In contact, and of single readings, none
    could be trusted; nor where there is no slope, as of a stop that is not met.

    Args:
        fit: with a Jacobian near its values.
    """
    regime = fit.problem.regime
    if regime.has_rough_cost or regime.has_single_readings:
        return []
    errors = split_values(fit.terms, standard_errors(fit))
    slopes = split_values(fit.terms, np.linalg.norm(fit.jacobian, axis=0))
    found = []
    for (term, values), limits, slope in zip(
        fit.values_by_term.items(), errors, slopes, strict=True
    ):
        if not (slope * term.scale > 1).any():
            continue
        each = zip(term.parameters, values, limits, strict=True)
        is_near = [
            abs(v - p.nominal) <= SELECTION.min_standard_errors * error
            for p, v, error in each
        ]
        if is_near and all(is_near) and term.effect.name != "stated":
            found.append(term)
    return found


def fit_without(fit: Fit, term: Term) -> Fit:
    """A fit of all terms but one, from where the linearization of all of them leads."""
    step = LinearizedFit.from_fit(fit).step_without(term)
    return _refit_without(replace(fit, values=fit.values + step), term, 3)


def _refit_without(fit: Fit, term: Term, iterations: int) -> Fit:
    """A fit of all terms but one from where the others are; 0 iterations move none."""
    restored = fit.restore([term])
    terms, values = restored.without_terms(term)
    jacobian = restored.jacobian_without(term)
    return fit_by_updates(fit.problem, terms, values, iterations, jacobian)


def try_equivalents(
    judge: Judge, refuted: NamedEffect, less: Fit
) -> tuple[list[NamedEffect], Fit]:
    """The equivalent of a name that clearly helps most in held-out episodes, if any.

    Returns:
        The name in its place, or none, and the fit.
    """
    substitutes, best, most = [], less, 0.0
    errors = judge.log_errors(less)
    for term in refuted.equivalent:
        if not is_distinct(term, less.terms):
            continue
        fit = fit_one_more(less, term, np.array(term.initial_values[0], float), 6)
        with_it = judge.log_errors(fit)
        lead = float(compare(with_it, errors).mean())
        if is_clearly_better(with_it, errors) and lead > most:
            others = tuple(t for t in refuted.equivalent if t is not term)
            substitutes = [replace(refuted, term=fit.terms[-1], equivalent=others)]
            best, most = fit, lead
    return substitutes, best


def squared_error(problem: Problem, fit: Fit) -> float:
    """Squared error [1] of a fit in a problem that it was not fitted to."""
    return float((problem.residuals_at(fit.terms, fit.values) ** 2).sum())


def squared_error_reestimated(problem: Problem, fit: Fit) -> float:
    """Squared error [1] of a fit with the initial states that are likeliest for it.

    Those of the problem where none had to be searched for.

    Args:
        problem: that the fit was not fitted to.
    """
    if problem.initial_state_shift is not None:
        problem = marginalize_initial_states(problem, fit.terms, fit.values)
    return squared_error(problem, fit)
