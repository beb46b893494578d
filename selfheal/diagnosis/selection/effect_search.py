"""From equation errors to simulations: takes a search's state, gives it with effects.

Which effects are missing, and about how large they are, the linear model tells. Their
values are then fitted to simulations, in segments as long as the robot can be
predicted, and what these do not ask for is removed.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import numpy as np

from ...recording.data import Floats
from ..estimation.least_squares import fit_parameters
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.problem import Problem
from ..linear.fit import LinearFit, refine, remove_terms, start_fit
from ..linear.measurement import is_measured, measure_motion
from ..linear.search import Search
from ..linear.segment_errors import SegmentErrors
from ..linear.torque_balance import TorqueBalance, can_be_linear
from ..simulation.cache import OutOfTime
from .judge import is_clearly_better
from .lengthening import fit_longer
from .search_record import SearchRecord
from .search_state import (
    Claim,
    Evidence,
    SearchState,
    reweight_and_fit,
    reweight_repeatedly,
)
from .settings import SELECTION
from .subsampling import mean_seconds
from .time_left import Stage

MIN_WINDOWS = 20  # for a likelihood of equation errors; a few a block


def search_effects(
    state: SearchState,
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> list[SearchState]:
    """States with more and more effects that linear models ask for, fitted.

    By the balance of torques where all joints are read often; what that cannot show, or
    where it cannot be had, by predictions of segments. One that explains everything
    ends the search.

    Args:
        state: in which nothing has a name.
        longer: the problem in longer and longer segments.
        record: of what was tried and found.
    """
    states = [state]
    if balance := _balance_torques(state, rng, record):
        shown = [t for t in state.candidates if can_be_linear(t)]
        states += _walk(Search(balance, shown, record), state, longer, rng, record)
        if states[-1].is_explained:
            record.add_tried(state.candidates)  # nothing is left for others
            return states
        hidden = [t for t in state.candidates if not can_be_linear(t)]
        if not hidden:
            return states
        states[-1] = states[-1].with_candidates(hidden)
    record.enter(Stage.DERIVATIVES, "predicting segments")
    regime = state.problem.regime
    if regime.has_rough_cost or regime.has_single_readings:
        return _alternate(states, longer, rng, record)
    search = _search_segments(state.problem, states[-1], record)
    return [*states, *_walk(search, states[-1], longer, rng, record)]


def _search_segments(
    problem: Problem, state: SearchState, record: SearchRecord
) -> Search:
    """The search for more effects by predictions of segments.

    Args:
        problem: its segments; in longer ones what is missing has grown, and hides more.
        state: whose effects and values to begin with.
        record: of what was tried and found.
    """
    fit, count = state.best, state.nominal_count
    errors = SegmentErrors(problem)
    start = start_fit(errors, fit.terms[:count], fit.terms[count:], fit.values)
    return Search(start, state.candidates, record)


def _alternate(
    states: Sequence[SearchState],
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> list[SearchState]:
    """States with one move more each, fitted to simulations before the next one.

    Where something touches slopes are rough, and a linear model holds near its values
    alone. Moves worth nearly as much as the best one are fitted beside it, and made
    where they predict clearly better (the judge).
    """
    found = list(states)
    while not found[-1].is_explained:
        search = _search_segments(states[0].problem, found[-1], record)
        with _keep_unfinished(search, found[-1], rng, record):
            is_moved = search.make_move()
            record.add_tried(search.candidates)
            state = found[-1] = _keep_ranking(found[-1], search)
            if not is_moved:
                break
            search.finish()
            moves = (search.fit, *search.near)
            tried = [_fit_set(search, x, state, longer, rng, record) for x in moves]
            found.append(_choose(states[0].problem, tried))
    return found


def _choose(problem: Problem, states: Sequence[SearchState]) -> SearchState:
    """The first state, or a later one that predicts segments clearly better."""
    best, *others = states
    least = _log_errors(problem, best) if others else []
    for state in others:
        errors = _log_errors(problem, state)
        if is_clearly_better(errors, least):
            best, least = state, errors
    return best


def _log_errors(problem: Problem, state: SearchState) -> list[Floats]:
    """Errors (W) [nats] of a state's predictions of each segment, for the judge."""
    fit, segment = state.best, problem.segment_of_residual
    posed = marginalize_initial_states(problem, fit.terms, fit.values)
    squares = posed.residuals_at(fit.terms, fit.values) ** 2
    return [0.5 * np.log(np.bincount(segment, squares, len(problem.segments)))]


@contextmanager
def _keep_unfinished(
    search: Search, state: SearchState, rng: np.random.Generator, record: SearchRecord
) -> Iterator[None]:
    """Have what a search found fitted to short segments, where time is over meanwhile.

    Not if it had fitted some of it already.
    """
    before = record.state
    try:
        yield
    except OutOfTime:
        linear = search.reached
        if record.state is before and linear.named:
            record.finish = partial(_fit_set, search, linear, state, (), rng, record)
        raise


def _keep_ranking(state: SearchState, search: Search) -> SearchState:
    """The state with the first ranking of all."""
    if state.first_round:
        return state
    return replace(state, first_round=search.first_ranking)


def _balance_torques(
    state: SearchState, rng: np.random.Generator, record: SearchRecord
) -> LinearFit | None:
    """The model as given in the balance of torques; None where it cannot be had.

    Or where short segments are explained: what builds up slowly no window shows.
    """
    simulator = state.problem.simulator
    is_slow = mean_seconds(state.problem) >= SELECTION.long_segment
    if is_slow or not is_measured(simulator):
        return None
    record.enter(Stage.DERIVATIVES, "measuring accelerations")
    motion = measure_motion(simulator.native, rng)
    if len(motion.windows) < MIN_WINDOWS:
        return None
    return start_fit(TorqueBalance(motion), state.best.terms[: state.nominal_count])


def _walk(
    search: Search,
    state: SearchState,
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> list[SearchState]:
    """States with the sets of effects that a search reaches, fitted to simulations.

    One that explains everything stands alone.
    """
    with _keep_unfinished(search, state, rng, record):
        search.run()
        record.add_tried(search.candidates)
        state = _keep_ranking(state, search)
        found, seen = [], {frozenset(t.key for t in state.named)}
        for linear in reversed(search.path):
            keys = frozenset(t.key for t in linear.named)
            if keys in seen:
                continue
            seen.add(keys)
            found.append(_fit_set(search, refine(linear), state, longer, rng, record))
            if found[-1].is_explained:
                return found[-1:]
    return found[::-1]


def _fit_set(
    search: Search,
    linear: LinearFit,
    state: SearchState,
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> SearchState:
    """The state with a set of effects fitted to simulations, and their claims."""
    for term in linear.named:
        less = remove_terms(linear, [linear.terms.index(term)])
        evidence = Evidence(*search.weigh(linear, less, term, rng))
        rivals = search.find_rivals(linear, less, term)
        state = state.with_claim(term, Claim(evidence, rivals))
    record.enter(Stage.FITS, f"fitting {len(linear.named)} effects to simulations")
    return _fit_to_simulations(state, linear, longer, record)


def _fit_to_simulations(
    state: SearchState,
    linear: LinearFit,
    longer: Sequence[Problem],
    record: SearchRecord,
) -> SearchState:
    """The state with the effects of a linear fit, in segments that inform."""
    terms, values = linear.terms, linear.values[: linear.count]
    problem = marginalize_initial_states(state.problem, terms, values)
    fit = reweight_repeatedly(fit_parameters(problem, terms, values, iterations=4), 4)
    record.keep(state.with_fit(fit))
    fit = fit_longer(fit, longer)
    state = state.with_fit(reweight_and_fit(fit, 4, tries_multiples=False))
    record.keep(state)
    return state
