"""Which physics is missing: takes a fit of the nominal model, gives hypotheses.

The linear model says it where all joints are read (`linear_start`), and stepwise
searches by simulations what that cannot have, or all where it cannot be made.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.robot_summary import RobotSummary
from ..effects.base import Effect, Term
from ..estimation.fit import Fit
from ..estimation.problem import Problem
from ..estimation.settings import FIT
from .change_point import locate_change_point, set_onset
from .cross_validation import ScoredFit, fit_and_score
from .evidence import Evidence
from .linear_start import search_linear_model
from .screening import (
    Progress,
    draw_segments,
    find_overlooked_segments,
    subsample_problem,
)
from .search_record import SearchRecord
from .search_state import SearchState, start_state
from .settings import SELECTION
from .stepwise import predicts_better, search_forward, vet_untested
from .whole_drives import (
    fit_usual_effects,
    lengthen_segments,
    search_backward,
)


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """An effect that earned its name.

    Attributes:
        term: the effect at its place.
        evidence: what speaks for it.
        equivalent: terms that explain as much, most likely first.
    """

    term: Term
    evidence: Evidence
    equivalent: tuple[Term, ...]


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """What a search ended with.

    Attributes:
        nominal: the fit of the nominal model's values alone.
        final: the fit with the named effects.
        named: the effects.
        ranking: candidates of the first screening, each with the cost that it leaves,
            as a share of the cost without it.
        plain: the fit of all usual effects, of which none was chosen; None: not made.
    """

    nominal: ScoredFit
    final: ScoredFit
    named: tuple[NamedEffect, ...]
    ranking: tuple[tuple[Term, float], ...]
    plain: Fit | None = None

    @property
    def problem(self) -> Problem:
        """The segments of the fit with the named effects, weighted as there."""
        return self.final.fit.problem

    @property
    def has_unnamed(self) -> bool:
        """Whether the fit has effects that have no name."""
        count = len(self.nominal.fit.terms) + len(self.named)
        return len(self.final.fit.terms) > count


def start_search(
    problem: Problem,
    robot: RobotSummary,
    nominal_terms: Sequence[Term],
    effects: Iterable[Effect],
    *,
    rng: np.random.Generator,
    progress: Progress = lambda what, share: None,
) -> SearchState:
    """The state of a search in which nothing has a name yet.

    Args:
        problem: all segments that may be used.
        robot: where effects may act.
        nominal_terms: terms of the nominal model's values.
        effects: the catalogue.
        rng: draws the segments of the search.
        progress: called with a message and a share (0 to 1).
    """
    searched = [effect for effect in effects if not effect.rounds_readings]
    candidates = tuple(
        term for effect in searched for term in effect.propose_terms(robot)
    )
    progress("refitting what the model states", 0.0)
    chosen = draw_segments(problem, _count_search_steps(len(nominal_terms)), rng)
    state = start_state(problem, nominal_terms, candidates, chosen)
    if state.is_explained:
        overlooked = find_overlooked_segments(problem, chosen, state.best.fit)
        if len(overlooked):
            chosen = np.union1d(chosen, overlooked)
            state = start_state(problem, nominal_terms, candidates, chosen)
    return state


def _count_search_steps(nominal_count: int) -> int:
    """Simulation steps of a search, of a robot with so many nominal terms."""
    steps = int(SELECTION.search_jacobian_steps / max(nominal_count, 1))
    return min(SELECTION.screening_steps[-1], steps)


def name_effects(
    start: SearchState,
    problem: Problem,
    longer: Sequence[Problem],
    *,
    rng: np.random.Generator,
    record: SearchRecord,
) -> list[Hypothesis]:
    """Find the effects without which the recordings cannot be explained.

    What the linear model leaves is searched by simulations. Where there is none, two
    stepwise searches are made: one removes effects from all usual ones at once, the
    other adds effects to none.

    Args:
        start: state in which nothing has a name yet.
        problem: all segments that may be used.
        longer: longer and longer segments, in which slow effects show.
        rng: draws segments and resamples.
        record: of what was tried and found.

    Returns:
        One hypothesis, or what both searches found, the likelier first.
    """
    if problem.regime.has_single_readings:  # poses do not show what most robots have
        return [_finish_search(search_forward(start, rng, record), problem)]
    steps = _count_search_steps(start.nominal_count)
    if any(t.onset for t in start.candidates):  # it is where a segment begins
        longer = longer[:1]
    longer = [subsample_problem(p, steps, rng) for p in longer]
    start = lengthen_segments(start, longer)
    if start.is_complete:
        return [_finish_search(_add_plain(start, start, record), problem)]
    if not problem.regime.has_rough_cost:
        found = search_linear_model(start, longer, rng, record)
        return [_finish_search(found, problem)]
    states = _search_by_simulation(start, longer, rng, record)
    plain = states[0].plain or states[-1].plain
    return [_finish_search(replace(s, plain=plain), problem) for s in states]


def finish_early(
    record: SearchRecord,
    start: SearchState,
    problem: Problem,
    rng: np.random.Generator,
) -> list[Hypothesis]:
    """What a search that was stopped had found, with all of its names tested.

    Args:
        record: of the search.
        start: state in which nothing had a name yet.
        problem: all segments that may be used.
        rng: draws resamples.

    Returns:
        A hypothesis for each direction of the search, the last one first.
    """
    states = list(record.states.values())[::-1] or [start]
    return [_finish_search(vet_untested(state, rng), problem) for state in states]


def _search_by_simulation(
    start: SearchState,
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> list[SearchState]:
    """Search forward; backward only where that leaves something.

    Impacts, and states that are not read, make the cost rough, so that many values at
    once are the last resort: not for one channel's sake where names leave little. And
    what sets in while a robot is recorded is no usual effect of all its drives.

    Args:
        start: state in which nothing has a name yet.
        longer: longer and longer segments.
        rng: draws segments and resamples.
        record: of what was tried and found.

    Returns:
        The states at the end, the likelier first.
    """
    forward = _search_to_end(start, longer, rng, record)
    has_set_in = any(t.onset for t in forward.named)
    if has_set_in or (
        forward.is_quiet and (forward.named or not forward.has_bad_channel)
    ):
        return [_add_plain(forward, start, record)]
    # what the first search set aside for a name, this one tries in its place
    kept = {t.key for t in forward.candidates}
    likely = [t for t in start.candidates if t.key in kept or t.effect.is_usual(t)]
    backward = search_backward(start.with_candidates(likely), longer, rng, record)
    if backward is None:
        return [forward]
    backward = search_forward(backward.with_history_of(forward), rng, record)
    return _rank(backward, forward)


def _add_plain(
    state: SearchState, start: SearchState, record: SearchRecord
) -> SearchState:
    """The state with a fit of all usual effects, unless it leaves little but noise.

    Args:
        state: at the end of a search.
        start: state in which nothing has a name yet.
        record: of what was tried and found.
    """
    if state.noise_ratio <= FIT.unexplained_ratio:
        return state
    return replace(state, plain=fit_usual_effects(start, record))


def _search_to_end(
    state: SearchState,
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> SearchState:
    """Search forward, and go on in longer segments while these show something more."""
    state = search_forward(state, rng, record)
    for _ in longer:
        extended = lengthen_segments(state, longer)
        if extended is state or extended.is_explained:
            break
        state = search_forward(extended, rng, record)
    return state


def _rank(backward: SearchState, forward: SearchState) -> list[SearchState]:
    """Both states, the likelier first; of two with the same names the first one."""
    if {t.key for t in backward.named} == {t.key for t in forward.named}:
        return [backward]
    if predicts_better(backward, forward):
        return [backward, forward]
    return [forward, backward]


def _finish_search(state: SearchState, whole: Problem) -> Hypothesis:
    """What a search found; `whole` has all segments, to date a change point in."""
    if any(t.onset for t in state.named):
        state = state.with_fit(locate_change_point(whole, state.best))
    terms, fit = state.named, state.best.fit
    nominal = fit_and_score(
        state.problem, *fit.without_terms(*terms), jacobian=fit.jacobian_without(*terms)
    )
    keys = {t.key for t in terms}
    claims = [(t, state.claims[t.key]) for t in terms]
    rivals = [[r for r in c.rivals if r.key not in keys] for _, c in claims]
    named = tuple(
        NamedEffect(t, c.evidence, set_onset(r, t.onset))
        for (t, c), r in zip(claims, rivals, strict=True)
    )
    return Hypothesis(nominal, state.best, named, state.first_round, state.plain)
