"""Which of some candidates earns a name: takes their fits, gives one or none."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from .evidence import (
    LEFT,
    Evidence,
    Scored,
    as_good,
    better,
    carries_over,
    economy,
    scored,
    seated,
    stability,
)
from .fit import Fit, believed, fit, jacobian, rested
from .noise import above
from .problem import Problem, whitened
from .screen import Progress
from .terms import Term, does, replaced
from .trial import Base

FITTED = 5  # of the last ones, with every other value fitted anew; chosen
SURE = 0.01  # p-value, corrected for every candidate tried, that earns a name; chosen
# least share of the held-out squared error that a name removes; and where impacts make
# the cost rough; chosen
WORTH, ROUGH = 0.02, 0.1
STRAINED = 12.0  # [variances] of stated values, that a sure name may take away; chosen
DRASTIC = 2  # at most, of what leaves nothing to fit, that are fitted; chosen
MOSTLY = 0.5  # of the held-out squared error, what a rare effect has to remove; chosen


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


def finalists(
    problem: Problem, fits: Sequence[Fit], progress: Progress
) -> list[Scored]:
    """The candidates' predictions, the best ones' with everything else fitted anew."""
    found = [Scored.of(problem, f) for f in fits]
    found.sort(key=lambda s: s.error)
    for i in range(min(FITTED, len(found))):
        old = found[i]
        progress(f"fitting {old.last.label}", i / FITTED)
        at, near = old.fit.values, old.fit.jacobian
        new = scored(problem, old.fit.terms, at, rounds=3, known=near)
        if new.error < old.error:
            found[i] = new
        found[i] = _in_seat(problem, found[i])
    return found


def _in_seat(problem: Problem, found: Scored) -> Scored:
    """The same with the starts that its values ask for, if it is better there."""
    terms, values = found.fit.terms, found.fit.values
    seat = seated(problem, terms, values)
    if seat is problem:
        return found
    near = problem.carried(seat, found.fit.jacobian)
    new = replace(scored(seat, terms, values, rounds=4, known=near), seat=seat)
    return new if new.error < found.error else found


def drastic(
    base: Base, stated: int, candidates: Sequence[Term], progress: Progress
) -> list[Scored]:
    """Predictions of what leaves nothing to fit, as a lost limb, begun from the start.

    Stated values and starts that were sought without it are so far off that it seems of
    no use there. So it is looked at with values as given and starts as read, and those
    that mend most of it are fitted from there.
    """
    whole = [t for t in candidates if not t.parameters]
    problem, found = base.problem, base.fit
    if not whole or problem.windows.is_single:
        return []
    raw = replace(problem.raw, shift=None)
    values = np.append(np.ones(stated), found.values[stated:])
    before = raw.at(found.terms, values)
    costs = {}
    for term in whole:
        after = raw.at((*found.terms, term), values)
        costs[term] = float(after @ after) / float(before @ before)
    order = sorted(whole, key=lambda t: costs[t])[:DRASTIC]
    scores = []
    for term in [t for t in order if costs[t] < MOSTLY]:
        progress(f"fitting {term.label}", 0.0)
        terms = (*found.terms, term)
        seat = whitened(raw, terms, values)
        scores.append(replace(scored(seat, terms, values, rounds=4), seat=seat))
    return scores


def winner(
    problem: Problem, now: Scored, finals: Sequence[Scored], tried: float
) -> tuple[Scored, Claim] | None:
    """The candidate that earns a name, and its claim to it."""
    p_value = {s: better(problem, now, s, tried) for s in finals}
    least = ROUGH if problem.is_rough else WORTH
    good = [
        s
        for s in finals
        if p_value[s] < SURE
        and not s.last.is_faint(s.values)
        and s.error < (1 - least) * now.error
        and is_plausible(problem, now, s)
        and carries_over(problem, now.fit, s.fit, s.seat)
    ]
    if not good:
        return None
    best = _likeliest(problem, now, sorted(good, key=lambda s: s.error))
    others = [s for s in good if s is not best]
    also = [s for s in others if as_good(problem, s, best, 2.0)]
    evidence = Evidence(
        float(0.5 * np.log(now.error / max(best.error, 1e-300))),
        p_value[best],
        stability(problem, good, [best, *also]),
    )
    return best, Claim(
        evidence, tuple(s.last for s in also[:3]), tuple(s.last for s in others)
    )


def relieving(
    base: Base, now: Scored, candidates: Sequence[Term], progress: Progress
) -> tuple[Scored, Claim] | None:
    """The candidate without which stated values are too far from what is believed.

    Several at their bounds can stand for one that had to leave them. Only where the
    readings fit as they are: else what is missing has pushed them there.
    """
    from scipy.stats import chi2

    problem = base.problem
    if above(problem, now.fit.residuals) >= LEFT:
        return None
    # where something touches, the cost is too rough to follow a valley
    end = partial(rested, problem) if not problem.world.touches else lambda f: f
    before = end(now.fit)
    fits = []
    for i, term in enumerate(candidates):
        progress(f"trying {term.label}", i / len(candidates))
        fits.append(_freed(problem, before, term))
    fits.sort(key=lambda f: f.cost + f.strain)
    found = [Scored.of(problem, end(f)) for f in fits[:FITTED]]
    relief = {
        s: before.strain - s.fit.strain - max(s.fit.cost - before.cost, 0.0)
        for s in found
    }
    p_value = {
        s: float(len(candidates) * chi2.sf(relief[s], len(s.last.parameters)))
        for s in found
        if not s.last.is_faint(s.values)
    }
    best = min(p_value, key=lambda s: p_value[s], default=None)
    if best is None or p_value[best] >= SURE:
        return None
    gain = float(0.5 * np.log(now.error / max(best.error, 1e-300)))
    rivals = tuple(s.last for s in p_value if p_value[s] < SURE and s is not best)
    sure = Evidence(gain, p_value[best], stability(problem, [now, *found], [best]))
    return best, Claim(sure, rivals, rivals)


def _freed(problem: Problem, found: Fit, term: Term) -> Fit:
    """One step from a fit, with what it made of the values that a term says anew.

    The readings fit there; how far it has to go from there, belief tells.
    """
    factor = {t.targets[0]: v for t, v in zip(found.terms, found.values, strict=True)}
    target = term.targets[0]
    own = [p.absent * factor.get(f"{target}/{p.name}", 1.0) for p in term.parameters]
    terms, start = (*found.terms, term), np.append(found.values, own)
    r = problem.at(terms, start)
    new = jacobian(problem, terms, start, r, len(found.values))
    near = np.hstack([found.jacobian, new])
    near[:, replaced(term, found.terms)] = 0.0
    return fit(problem, terms, start, rounds=1, known=near)


def _likeliest(problem: Problem, now: Scored, good: Sequence[Scored]) -> Scored:
    """Of candidates, the best first, the one that gets the name."""
    for s in good:
        if s.last.effect.is_seen(s.last) and s.error < MOSTLY * now.error:
            return s
    if problem.windows.is_single:
        good = sorted(good, key=partial(economy, problem), reverse=True)
        near = [s for s in good if as_good(problem, s, good[0], 2.0)]
        # a pose that is read once tells nothing of when a command arrives
        return min(near, key=lambda s: does(s.last.effect, "command"))
    close = [s for s in good if as_good(problem, s, good[0], 2.0)]
    usual = [s for s in close if not _oddity(s)[0]] or close
    near = [s for s in usual if as_good(problem, s, usual[0], 2.0)]
    most = min(s.fit.strain for s in near) + strain_of_note(problem, near[0].fit)
    near = [s for s in near if s.fit.strain < most]
    # of those that the data cannot rank, a usual one, with the least to choose
    return min(near, key=_oddity)


def _oddity(s: Scored) -> tuple:
    """By what those go that the data cannot rank, the least odd first."""
    term = s.last
    own = s.fit.jacobian[:, len(s.fit.values) - len(term.parameters) :]
    # what does nothing here, as a shift along a joint's axis, is no choice
    free = (np.linalg.norm(own * term.scale, axis=0) > 1).sum()
    return term.effect.oddity(term, s.values), free, s.error


def strain_of_note(problem: Problem, found: Fit) -> float:
    """Strain [variances] that is no accident.

    Impacts make the cost rough, which drives every stated value some way.
    """
    values = np.count_nonzero(believed(found.terms))
    return STRAINED + (values if problem.world.touches else 0)


def is_plausible(problem: Problem, now: Scored, new: Scored) -> bool:
    """Whether an effect is usual enough for what it explains.

    Where much stays unexplained, one that is rare, or says that the model's own numbers
    are far off, is more likely to stand for something else.
    """
    usual = not is_odd(new.last)
    mostly = new.error < MOSTLY * now.error
    return usual or mostly or above(problem, new.fit.residuals) < LEFT


def is_odd(term: Term) -> bool:
    """Whether an effect is rare, or says that what the model states is not so."""
    return bool(term.effect.rare or term.effect.restates)
