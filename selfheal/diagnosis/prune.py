"""Names taken away, or given to another: takes fits of several terms, gives fits."""

from collections.abc import Sequence

import numpy as np

from .choose import WORTH, is_odd, is_plausible
from .evidence import Scored, as_good, held_out, scored
from .fit import Fit, fit
from .problem import Problem
from .terms import Term, is_new
from .trial import Base, try_term

BETTER = 0.97  # of the held-out error, below which another hypothesis is better; chosen


def prices_of(base: Base, stated: int) -> dict[Term, float]:
    """What each effect's absence would make of the cost, of 1, if all were linear.

    What is absent at infinity (a limit) is as good as absent at its bound.
    """
    found = base.fit
    ends = np.cumsum([0, *(len(t.parameters) for t in found.terms)])
    prices = {}
    for i, term in enumerate(found.terms[stated:], stated):
        own = np.arange(ends[i], ends[i + 1])
        absent = np.array([p.absent for p in term.parameters])
        absent = np.clip(absent, term.low, term.high)
        back = found.jacobian[:, own] @ (absent - found.values[own])
        left, _ = base.settle(found.residuals + back, hold=own)
        prices[term] = left / found.cost
    return prices


def pruned(problem: Problem, found: Fit, stated: int) -> Fit:
    """Without the effects that cost next to nothing to take away, a half at a time."""
    while len(found.terms) > stated:
        prices = prices_of(Base.of(problem, found), stated)
        order = sorted(prices, key=lambda t: prices[t])[: max(1, len(prices) // 2)]
        gone = [t for t in order if prices[t] < 1 + WORTH]
        if not gone:
            break
        found = fit(problem, *found.but(*gone), rounds=2, known=found.near(*gone))
    return found


def swapped(problem, now: Scored, term: Term, others: Sequence[Term]) -> Scored:
    """The fit with another term in one's place, if that predicts better.

    What looked best alone need not do so beside a later effect; and where the data do
    not tell, the usual effect with the least to choose is the one.
    """
    kept, _ = now.fit.but(term)
    others = [t for t in others if is_new(t, kept)]
    if not others:
        return now
    base = Base.of(problem, without(problem, now.fit, term))
    tried = [try_term(base, other) for other in others]
    tried.sort(key=lambda f: held_out(problem, f).sum())
    for found in tried[:2]:
        near = found.jacobian
        full = scored(problem, found.terms, found.values, rounds=6, known=near)
        if full.error < BETTER * now.error:
            if is_odd(term) or is_plausible(problem, now, full):
                return full
        elif is_plainer(full.last, term) and as_good(problem, full, now):
            return full
    return now


def is_plainer(new: Term, old: Term) -> bool:
    """Whether an effect is to be preferred where the data do not tell."""
    if new.effect.rare != old.effect.rare:
        return new.effect.rare < old.effect.rare
    return len(new.parameters) < len(old.parameters)


def without(problem: Problem, found: Fit, term: Term) -> Fit:
    """The fit of all terms but one."""
    return fit(problem, *found.but(term), rounds=3, known=found.near(term))
