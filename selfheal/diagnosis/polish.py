"""A last fit: takes a naming, gives the same names with the values that suit them."""

from dataclasses import replace

import numpy as np

from ..recording.data import Floats
from .case import LONG, WINDOW, Case, pieces_of
from .evidence import ABOVE, Scored, for_score, reseated
from .fit import Fit, fit, rested
from .name import Naming
from .noise import above
from .plant import parts
from .problem import Problem, is_told, whitened
from .prune import is_plainer, swapped
from .rough import eased, looked_about, looked_along
from .screen import STEPS, fewer
from .terms import Term
from .trial import Base

# steps of simulation in the last fit, about, and in all differences of it; chosen: a
# minute at 1 ms, and no more for a robot of which much is stated
POLISHED, SLOPES = 40000, 1e6


def polished(case: Case, naming: Naming) -> Naming:
    """The same names, fitted to more pieces, to longer ones if those can be told."""
    found = naming.final.fit
    sigma = for_score(naming.problem, found)
    rng = np.random.default_rng(2)
    steps = int(np.clip(SLOPES / max(len(found.values), 1), STEPS[-1], POLISHED))
    short, long = (
        fewer(Problem(case.world, pieces_of(case.world, seconds), sigma), steps, rng)
        for seconds in (WINDOW, LONG)
    )
    problem = long if is_told(long, short, found.terms, found.values) else short
    return _refitted(whitened(problem, found.terms, found.values), naming)


def _refitted(problem: Problem, naming: Naming) -> Naming:
    """The same names in other windows."""
    found, stated = naming.final.fit, naming.stated.fit
    alone = fit(problem, stated.terms, stated.values, rounds=6)
    final = alone
    if naming.named:
        start = looked_about(problem, found.terms, found.values)
        final = fit(problem, found.terms, start, rounds=6)
        if problem.is_rough:  # the cost has many minima
            final = replace(final, values=looked_along(problem, final))
            problem, final = eased(problem, final)
        elif not problem.world.touches:
            problem, final = reseated(problem, final)
    # where something touches, or is left, the cost is too rough for it
    if not problem.world.touches and above(problem, final.residuals) <= ABOVE:
        final = rested(problem, final)
    whole = Scored.of(problem, final)
    less = Scored.of(problem, alone) if naming.named else whole
    return replace(naming, problem=problem, stated=less, final=whole)


def plainest(naming: Naming) -> Naming:
    """The same; what cannot be told from a name has its place if it is plainer.

    In more pieces than those that named it a number may turn out to do nothing, as the
    speed at which a motor's torque ends.
    """
    problem = naming.problem
    for name in naming.named:
        plainer = [t for t in name.equivalent if is_plainer(t, name.term)]
        final = swapped(problem, naming.final, name.term, plainer)
        if final is naming.final:
            continue
        rest = tuple(t for t in name.equivalent if t.key != final.last.key)
        new = replace(name, term=final.last, equivalent=(name.term, *rest))
        named = tuple(new if n is name else n for n in naming.named)
        naming = replace(naming, final=final, named=named)
    return naming


def stepped(base: Base) -> Fit:
    """The same effects, with stated values that suit the model's own time step.

    What a user sees who replays the model: half a step early, and damped otherwise
    than in continuous time. A fit in continuous time gives the effects' truth.
    """
    problem, found = base.problem, base.fit
    plain = replace(problem.raw, centered=False)
    plain = whitened(plain, found.terms, found.values)
    near = problem.carried(plain, found.jacobian)
    fixed = [
        t if t.effect.name == "stated" else _fixed(t, v)
        for t, v in zip(found.terms, parts(found.terms, found.values), strict=True)
    ]
    best = fit(plain, fixed, found.values, rounds=2, known=near)
    return replace(best, terms=found.terms)


def _fixed(term: Term, values: Floats) -> Term:
    """The term with no other values than these."""
    parameters = tuple(
        replace(p, low=float(v), high=float(v))
        for p, v in zip(term.parameters, values, strict=True)
    )
    return replace(term, parameters=parameters)
