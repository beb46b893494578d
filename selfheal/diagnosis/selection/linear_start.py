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
from ..linear.fit import start_fit
from ..linear.motion import is_measured, measure_motion
from ..linear.search import Search
from ..linear.segment_errors import SegmentErrors
from ..linear.torque_balance import TorqueBalance, can_be_linear
from .backward import exchange_equivalent
from .criteria import Claim
from .cross_validation import ScoredFit
from .screening import Progress
from .search_record import SearchRecord
from .search_state import SearchState, reweight_and_fit
from .settings import SELECTION
from .stepwise import keep_significant, remove_and_exchange
from .whole_drives import fit_longer

MIN_WINDOWS = 20  # for a likelihood of equation errors; a few a block


def search_linear_model(
    state: SearchState,
    longer: Sequence[Problem],
    rng: np.random.Generator,
    record: SearchRecord,
) -> SearchState:
    """The state with the effects that the linear model asks for, fitted and tested.

    Args:
        state: in which nothing has a name.
        longer: the problem in longer and longer segments.
        rng: draws resamples.
        record: of what was tried and found.
    """
    searches = _search(state, rng, record)
    linear = searches[-1].fit
    record.add_tried(state.candidates)
    state = replace(state, direction="linear", first_round=searches[0].first_ranking)
    if not linear.named:
        return state
    record(f"fitting {len(linear.named)} effects to simulations", 0.0)
    terms, values = linear.terms, linear.values[: linear.count]
    problem = marginalize_initial_states(state.problem, terms, values)
    fit = fit_parameters(problem, terms, values, iterations=4)
    for _ in range(SELECTION.reweightings_of_all):
        fit = reweight_and_fit(fit, 4, tries_multiples=False).fit
    record.keep(state.with_fit(ScoredFit.from_fit(fit)))
    fit = fit_longer(fit, longer)
    state = state.with_fit(reweight_and_fit(fit, 4, tries_multiples=False))
    record.keep(state)
    state, _ = remove_and_exchange(state)
    rivals = {t.key: _find_rivals(searches, t) for t in linear.named}
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


def _find_rivals(searches: Sequence[Search], term: Term) -> tuple[Term, ...]:
    """Candidates that explain as much in a name's place, in any of some searches."""
    each = [s.find_rivals(term) for s in searches if term in s.fit.named]
    return tuple({t.key: t for rivals in each for t in rivals}.values())


def _search(
    state: SearchState, rng: np.random.Generator, say: Progress
) -> list[Search]:
    """Searches for what is missing, of which the last one has found it.

    By the balance of torques where all joints are read often; what that cannot show, or
    else everything, by predictions of segments.

    Args:
        state: in which nothing has a name.
        rng: draws noise.
        say: called with a message and a share (0 to 1).
    """
    problem, left = state.problem, state.candidates
    stated = state.best.fit.terms[: state.nominal_count]
    named: tuple[Term, ...] = ()
    values, searches = state.best.fit.values, []
    if is_measured(problem.simulator):
        say("measuring accelerations", 0.0)
        motion = measure_motion(problem.simulator.native, rng)
        if len(motion.windows) >= MIN_WINDOWS:
            shown = [t for t in left if can_be_linear(t)]
            left = [t for t in left if not can_be_linear(t)]
            searches = [Search(start_fit(TorqueBalance(motion), stated), shown, say)]
            found = searches[0].run()
            named, values = found.named, found.values[: found.count]
    if left:
        say("predicting segments", 0.0)
        start = start_fit(SegmentErrors(problem), stated, named, values)
        searches.append(Search(start, left, say))
        searches[-1].run()
    return searches
