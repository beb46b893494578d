"""Names tried where nothing was fitted: takes namings, gives what holds there."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from ..recording.data import Floats
from .case import WINDOW, Case, pieces_of
from .choose import strain_of_note
from .evidence import Scored, for_score
from .fit import Fit, fit
from .name import Named, Naming
from .plant import parts
from .problem import Problem, whitened
from .prune import without
from .terms import is_new
from .trial import Base, try_term

CLEARLY = 0.8  # of a hypothesis' held-out squared error, that of a better one; chosen
# least share of the squared error in held-out episodes that a name removes, and of what
# all of them together do; chosen
HELPS, TRIFLE = 0.01, 0.003
UNSEEN = 0.1  # of what a name removes in fitted episodes, what it changes in those held
# out, relative to the error there: less cannot refute it; chosen

Upheld = tuple[Naming, tuple[str, ...]]  # a hypothesis, and labels of what was refuted


def likeliest(case: Case, hypotheses: Sequence[Upheld]) -> Upheld:
    """Of several the first, unless held-out episodes speak for another.

    Clearly, if that one says more or rarer things.
    """
    if len(hypotheses) == 1:
        return hypotheses[0]
    errors = _errors(case, [naming for naming, _ in hypotheses])
    best = int(np.argmin(errors))
    new, old = _sizes(hypotheses[best][0]), _sizes(hypotheses[0][0])
    simpler = all(n <= o for n, o in zip(new, old, strict=True))
    margin = 1.0 if simpler else CLEARLY
    return hypotheses[best if errors[best] < margin * errors[0] else 0]


def _sizes(naming: Naming) -> tuple[int, int]:
    """How many rare effects a hypothesis names, and numbers of all of them."""
    terms = [n.term for n in naming.named]
    return sum(t.effect.rare for t in terms), sum(len(t.parameters) for t in terms)


def in_question(case: Case, namings: Sequence[Naming]) -> list[Naming]:
    """The first of several, and those that are as good in the held-out episodes."""
    errors = _errors(case, namings) if len(namings) > 1 else [0.0]
    return [n for n, e in zip(namings, errors, strict=True) if e <= errors[0]]


def _errors(case: Case, namings: Sequence[Naming]) -> list[float]:
    """Squared residuals in held-out episodes, weighed as the first one's score."""
    sigma = for_score(namings[0].problem, namings[0].final.fit)
    held = Problem(case.held, pieces_of(case.held, WINDOW), sigma)
    return [error_of(held, naming.final.fit) for naming in namings]


def upheld(case: Case, naming: Naming) -> Upheld:
    """Only the names that help in the held-out episodes, and labels of the others.

    A name that makes far less difference there than where it was fitted, as that of a
    rotor's inertia where nothing moves fast, is not refuted. What could not be told
    from one that is refuted takes its place, if it helps.
    """
    gone: list[str] = []
    start = Problem(case.held, pieces_of(case.held, WINDOW), naming.problem.sigma)
    while naming.named:
        found, alone = naming.final.fit, naming.stated.fit
        held = whitened(start, found.terms, found.values)
        told = held.at(found.terms, found.values)
        error = float(told @ told)
        before = own_error(held, alone)
        least = max(HELPS * error, TRIFLE * (before - error))
        weakest = None
        values = dict(zip(found.terms, parts(found.terms, found.values), strict=True))
        for name in naming.named:
            less = without(naming.problem, found, name.term)
            other = held.at(less.terms, less.values)
            gain = own_error(held, less, other) - error
            if name.term.is_faint(values[name.term]):
                weakest = -np.inf, name, less
                break
            relief = less.strain - found.strain
            if relief > strain_of_note(held, found) and gain > -least:
                continue
            changed = float(((other - told) ** 2).sum()) / error
            if changed < UNSEEN * (less.cost / found.cost - 1):
                continue
            if gain < least and (weakest is None or gain < weakest[0]):
                weakest = gain, name, less
        if weakest is None:
            break
        _, name, less = weakest
        gone.append(name.term.label)
        instead, best = in_its_place(naming.problem, held, name, less)
        named = [[n] if n is not name else instead for n in naming.named]
        naming = replace(
            naming, final=Scored.of(naming.problem, best), named=tuple(chain(*named))
        )
    return naming, tuple(gone)


def in_its_place(
    problem: Problem, held: Problem, refuted: Named, less: Fit
) -> tuple[list[Named], Fit]:
    """Of what was equivalent to a name, what helps the most if anything does."""
    instead, best, least = [], less, (1 - HELPS) * error_of(held, less)
    for term in refuted.equivalent:
        if not is_new(term, less.terms):
            continue
        tried = try_term(Base.of(problem, less), term)
        found = fit(problem, tried.terms, tried.values, rounds=6)
        if (error := error_of(held, found)) < least:
            others = tuple(t for t in refuted.equivalent if t is not term)
            instead = [replace(refuted, term=found.terms[-1], equivalent=others)]
            best, least = found, error
    return instead, best


def error_of(problem: Problem, found: Fit) -> float:
    """Sum of squared residuals of a fit in other windows than its own."""
    return float((problem.at(found.terms, found.values) ** 2).sum())


def own_error(problem: Problem, found: Fit, told: Floats | None = None) -> float:
    """The same; where starts were sought, from those likeliest for this fit.

    `told`: (R) residuals from the problem's own starts, if they are known.
    """
    if problem.shift is not None:
        return error_of(whitened(problem, found.terms, found.values), found)
    return error_of(problem, found) if told is None else float(told @ told)
