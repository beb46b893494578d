"""From equation errors to simulations: takes a search's state, gives it with effects.

Which effects are missing, and about how large they are, the linear model tells. Their
values are then fitted to simulations, in segments as long as the robot can be
predicted, and what these do not ask for is removed.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..effects.base import Term
from ..estimation.least_squares import fit_parameters
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.problem import Problem
from ..linear.fit import LinearFit, start_fit
from ..linear.measurement import is_measured, measure_motion
from ..linear.search import Search
from ..linear.segment_errors import SegmentErrors
from ..linear.torque_balance import TorqueBalance, can_be_linear
from .backward import exchange_equivalent
from .criteria import Claim
from .cross_validation import ScoredFit
from .lengthening import fit_longer
from .search_record import SearchRecord
from .search_state import SearchState, reweight_and_fit, reweight_repeatedly
from .stepwise import keep_significant, remove_and_exchange

MIN_WINDOWS = 20  # for a likelihood of equation errors; a few a block


def search_linear_model(
    state: SearchState,
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> SearchState:
    """The state with the effects that linear models ask for, fitted and tested.

    By the balance of torques where all joints are read often, by predictions of
    segments else.

    Args:
        state: in which nothing has a name.
        longer: the problem in longer and longer segments.
        rng: draws noise and resamples.
        record: of what was tried and found.
    """
    simulator, problem = state.problem.simulator, state.problem
    stated = state.best.fit.terms[: state.nominal_count]
    if is_measured(simulator):
        record("measuring accelerations", 0.0)
        motion = measure_motion(simulator.native, rng)
        if len(motion.windows) >= MIN_WINDOWS:
            start = start_fit(TorqueBalance(motion), stated)
            shown = [t for t in state.candidates if can_be_linear(t)]
            state = _search(state, start, shown, longer, rng, record)
            if state.named and state.is_explained:  # nothing is left for others
                record.add_tried(state.candidates)
            return state
    record("predicting segments", 0.0)
    values = state.best.fit.values
    start = start_fit(SegmentErrors(problem), stated, state.named, values)
    return _search(state, start, state.candidates, longer, rng, record)


def _search(
    state: SearchState,
    start: LinearFit,
    candidates: Sequence[Term],
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> SearchState:
    """The state with what an error model asks for, fitted to simulations and tested.

    Args:
        state: to begin with.
        start: fit to errors, with the same names.
        candidates: that may be added.
        longer: the problem in longer and longer segments.
        rng: draws resamples.
        record: of what was tried and found.
    """
    search = Search(start, candidates, record)
    linear = search.run()
    record.add_tried(candidates)
    if not state.first_round:
        state = replace(state, first_round=search.first_ranking)
    if not linear.named or {t.key for t in linear.named} == {
        t.key for t in state.named
    }:
        return state
    record(f"fitting {len(linear.named)} effects to simulations", 0.0)
    state = _fit_to_simulations(state, linear, longer, record)
    state, _ = remove_and_exchange(state)
    rivals = {t.key: search.find_rivals(t) for t in linear.named}
    for term in state.named:  # over longer segments they may differ
        best = exchange_equivalent(state.best, term, rivals.get(term.key, ()))
        if best is not state.best:
            rest = (t for t in rivals[term.key] if t.key != best.candidate.key)
            rivals[best.candidate.key] = (term, *rest)
            state = state.with_fit(best)
    state = keep_significant(state, state.named, rng)
    for term in state.named:
        evidence = state.claims[term.key].evidence
        others = rivals.get(term.key, ())
        state = state.with_claim(term, Claim(evidence, others, others))
    record.keep(state)
    return state


def _fit_to_simulations(
    state: SearchState,
    linear: LinearFit,
    longer: Sequence[Problem],
    record: SearchRecord,
) -> SearchState:
    """The state with the effects of a linear fit, in segments as long as they inform.

    Args:
        state: whose segments are fitted first.
        linear: with effects and their values.
        longer: the problem in longer and longer segments.
        record: of what was found.
    """
    terms, values = linear.terms, linear.values[: linear.count]
    problem = marginalize_initial_states(state.problem, terms, values)
    fit = reweight_repeatedly(fit_parameters(problem, terms, values, iterations=4), 4)
    record.keep(state.with_fit(ScoredFit.from_fit(fit)))
    fit = fit_longer(fit, longer)
    state = state.with_fit(reweight_and_fit(fit, 4, tries_multiples=False))
    record.keep(state)
    return state
