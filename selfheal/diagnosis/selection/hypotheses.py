"""Which physics is missing: takes a fitted model, gives effects that earn a name."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..data.robot_summary import RobotSummary
from ..effects.base import Term
from ..estimation.problem import Problem
from .change_point import locate_change_point, set_onset
from .cross_validation import ScoredFit, fit_and_score
from .evidence import Evidence
from .screening import (
    Progress,
    draw_segments,
    find_overlooked_segments,
    subsample_problem,
)
from .settings import SELECTION
from .stepwise import StepwiseSearch


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """An effect that earned its name.

    Attributes:
        term: with its place.
        evidence: for it.
        equivalent: terms that explain as much, most likely first.
    """

    term: Term
    evidence: Evidence
    equivalent: tuple[Term, ...]


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What a search ended with.

    Attributes:
        problem: the windows, weighted as in the end.
        stated: the fit of what the model states alone.
        final: the fit with the named effects.
        named: the effects.
        ranking: candidates of the first round and the cost each left, of 1.
    """

    problem: Problem
    nominal: ScoredFit
    final: ScoredFit
    named: tuple[NamedEffect, ...]
    ranking: tuple[tuple[Term, float], ...]


def start_search(
    problem: Problem,
    robot: RobotSummary,
    nominal_terms: Sequence[Term],
    effects: Iterable,
    *,
    rng: np.random.Generator,
    progress: Progress = lambda what, share: None,
) -> StepwiseSearch:
    """A search in which nothing has a name yet.

    Args:
        problem: all windows that may be used.
        robot: of the robot.
        nominal_terms: terms of what the model states.
        effects: the catalogue.
        rng: chooses the windows on which candidates are tried first.
        progress: told what is being done and how far it is.
    """
    kinds = [effect for effect in effects if not effect.rounds_readings]
    candidates = tuple(term for effect in kinds for term in effect.propose_terms(robot))
    progress("refitting what the model states", 0.0)
    some = draw_segments(problem, _search_steps(len(nominal_terms)), rng)
    begin = partial(
        StepwiseSearch.from_segments, problem, nominal_terms, candidates, rng, progress
    )
    search = begin(some)
    if search.is_done:
        odd = find_overlooked_segments(problem, some, search.problem, search.best.fit)
        search = begin(np.union1d(some, odd)) if len(odd) else search
    return search


def _search_steps(nominal_terms: int) -> int:
    """Steps of simulation in a search, of a robot of which so many terms are stated."""
    return min(
        SELECTION.screening_steps[-1],
        int(SELECTION.search_jacobian_steps / max(nominal_terms, 1)),
    )


def name_effects(
    search: StepwiseSearch, problem: Problem, longer: Problem
) -> list[Hypothesis]:
    """Find the effects without which the recordings cannot be explained.

    Forward, with a look back after each step: what a later effect makes needless goes.
    Where that leaves something (more than a tenth, if something touches: the cost is
    rough there), once more from all the usual ones at once: the first one named alone
    may have stood for several. And in longer pieces, if the starts allow it: slow
    effects show there.

    Args:
        search: in which nothing has a name yet.
        problem: all windows that may be used.
        longer: the same in longer pieces.

    Returns:
        One hypothesis, or what both searches found, the likelier first.
    """
    start, candidates = replace(search), search.candidates
    search.run_forward()
    # poses do not show what most robots have
    if search.is_done or problem.regime.has_single_readings:
        return [_finish(search, problem)]
    # what the first search set aside for a name, the second one tries in its place
    likely = [t for t in candidates if t in search.candidates or t.effect.is_usual(t)]
    other = replace(
        start,
        claims=dict(search.claims),
        first_round=search.first_round,
        candidates=likely,
    )
    longer = replace(
        subsample_problem(longer, _search_steps(search.nominal_count), search.rng),
        sigma=search.problem.sigma,
        simulator=search.problem.simulator,
    )
    if not other.run_from_usual(longer, {t.key for t in search.named}):
        return [_finish(search, problem)]
    both = (other, search) if other.predicts_better_than(search) else (search, other)
    return [_finish(s, problem) for s in both]


def _finish(search: StepwiseSearch, whole: Problem) -> Hypothesis:
    """What a search found, in some of the `whole`'s windows."""
    terms = search.named
    if any(t.onset for t in terms):
        search.best = locate_change_point(search.problem, whole, search.best)
        terms = search.named
    own = search.best.fit
    alone = fit_and_score(
        search.problem, *own.without_terms(*terms), known=own.jacobian_without(*terms)
    )
    claims = [(t, search.claims[t.key]) for t in terms]
    named = tuple(
        NamedEffect(t, c.evidence, set_onset(c.rivals, t.onset)) for t, c in claims
    )
    return Hypothesis(search.problem, alone, search.best, named, search.first_round)
