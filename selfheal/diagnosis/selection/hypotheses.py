"""Which physics is missing: takes a fit of the nominal model, gives hypotheses."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.robot_summary import RobotSummary
from ..effects.base import Effect, Term
from ..effects.measurement import Quantization
from ..estimation.fit import Fit
from ..estimation.least_squares import fit_parameters
from ..estimation.problem import Problem
from .change_point import locate_change_point, set_onset
from .effect_search import EffectSearch
from .search_record import SearchRecord
from .search_state import (
    Evidence,
    SearchState,
    lengthen_segments,
    start_state,
)
from .settings import SELECTION
from .subsampling import draw_segments, find_overlooked_segments


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """An effect that earned its name.

    Attributes:
        term: the effect at its place.
        evidence: what speaks for it.
        equivalent: terms that explain as much, most likely first.
        growth: ratio [1] of the error in held-out episodes without it, all else fitted
            anew, to that with it; NaN where none was measured.
    """

    term: Term
    evidence: Evidence
    equivalent: tuple[Term, ...]
    growth: float = np.nan


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What a search ended with.

    Attributes:
        nominal: the fit of the nominal model's values alone.
        final: the fit with the named effects.
        named: the effects.
        ranking: candidates beside the model as given, each with the mean square error
            that it leaves, as a share of that without it.
    """

    nominal: Fit
    final: Fit
    named: tuple[NamedEffect, ...]
    ranking: tuple[tuple[Term, float], ...]

    @property
    def problem(self) -> Problem:
        """The segments of the fit with the named effects, weighted as there."""
        return self.final.problem


def start_search(
    problem: Problem,
    robot: RobotSummary,
    nominal_terms: Sequence[Term],
    effects: Iterable[Effect],
    rng: np.random.Generator,
) -> SearchState:
    """The state of a search in which nothing has a name yet.

    Args:
        problem: all segments that may be used.
        rng: draws the segments of the search.
    """
    searched = [effect for effect in effects if not isinstance(effect, Quantization)]
    candidates = tuple(
        term for effect in searched for term in effect.propose_terms(robot)
    )
    chosen = draw_segments(problem, _count_search_steps(len(nominal_terms)), rng)
    state = start_state(problem, nominal_terms, candidates, chosen)
    if state.is_explained:
        overlooked = find_overlooked_segments(problem, chosen, state.best)
        if len(overlooked):
            chosen = np.union1d(chosen, overlooked)
            state = start_state(problem, nominal_terms, candidates, chosen)
    return state


def _count_search_steps(nominal_count: int) -> int:
    """Simulation steps of a search, of a robot with so many nominal terms."""
    steps = int(SELECTION.search_jacobian_steps / max(nominal_count, 1))
    return min(SELECTION.search_steps, steps)


def name_effects(
    start: SearchState,
    problem: Problem,
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> list[Hypothesis]:
    """Find the effects without which the recordings cannot be explained.

    Those that set in are looked for first, then those always there. Several sets are
    found where none explains everything; held-out episodes decide.

    Args:
        start: state in which nothing has a name yet; its candidates may set in.
        problem: all segments that may be used.
        longer: longer and longer segments, in which slow effects show.
        record: of what was tried and found.
    """
    steps = _count_search_steps(start.nominal_count)
    has_onset = any(t.onset for t in start.candidates)
    if has_onset:  # it is where a segment begins
        longer = longer[:1]
    longer = [p.select(draw_segments(p, steps, rng)) for p in longer]
    start = lengthen_segments(start, longer)
    if start.is_complete:
        return [_finish_search(start, problem)]
    search, dated = EffectSearch(longer, rng, record), list[SearchState]()
    if has_onset:
        dated = search.run(start)
        if dated[-1].is_explained:
            return [_finish_search(dated[-1], problem)]
    always = replace(start, candidates=set_onset(start.candidates, None))
    found = search.run(always)
    found = found[-1:] if found[-1].is_explained else [*found, *dated[1:]]
    return [_finish_search(state, problem) for state in found]


def finish_early(
    record: SearchRecord, start: SearchState, problem: Problem
) -> list[Hypothesis]:
    """What a search that was stopped had found.

    Args:
        start: state in which nothing had a name yet.
        problem: all segments that may be used.
    """
    found = record.finish() if record.finish else record.state
    return [_finish_search(found or start, problem)]


def _finish_search(state: SearchState, whole: Problem) -> Hypothesis:
    """What a search found; `whole` has all segments, to date a change point in."""
    if any(t.onset for t in state.named):
        state = replace(state, best=locate_change_point(whole, state.best))
    terms, fit = state.named, state.best
    nominal = fit_parameters(
        state.problem, *fit.without_terms(*terms), jacobian=fit.jacobian_without(*terms)
    )
    keys = {t.key for t in terms}
    claims = [(t, state.claims[t.key]) for t in terms]
    rivals = [[r for r in c.rivals if r.key not in keys] for _, c in claims]
    named = tuple(
        NamedEffect(t, c.evidence, set_onset(r, t.onset))
        for (t, c), r in zip(claims, rivals, strict=True)
    )
    return Hypothesis(nominal, state.best, named, state.first_round)
