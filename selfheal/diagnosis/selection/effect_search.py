"""From equation errors to simulations: takes a search's state, gives it with effects.

Which effects are missing, and about how large they are, the linear model tells. Their
values are then fitted to simulations, in segments as long as the robot can be
predicted, and what these do not ask for is removed.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
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
from .search_record import SearchRecord
from .search_state import (
    Claim,
    Evidence,
    SearchState,
    fit_longer,
    reweight_and_fit,
)
from .settings import SELECTION
from .subsampling import mean_seconds
from .time_left import Stage

MIN_WINDOWS = 20  # for a likelihood of equation errors; a few a block


@dataclass(frozen=True, eq=False)
class EffectSearch:
    """Adds to states the effects that linear models ask for, fitted to simulations.

    Attributes:
        longer: the problem in longer and longer segments.
        rng: draws noise and resamples.
        record: of what was tried and found.
    """

    longer: Sequence[Problem]
    rng: np.random.Generator
    record: SearchRecord

    def run(self, state: SearchState) -> list[SearchState]:
        """States with more and more effects, from one in which nothing has a name.

        By the balance of torques where all joints are read often; what that cannot
        show, or where it cannot be had, by predictions of segments. One that explains
        everything ends the search.
        """
        states = [state]
        if balance := self._balance_torques(state):
            shown = [t for t in state.candidates if can_be_linear(t)]
            states += self._walk(Search(balance, shown, self.record), state)
            if states[-1].is_explained:
                self.record.add_tried(state.candidates)  # nothing is left for others
                return states
            hidden = [t for t in state.candidates if not can_be_linear(t)]
            if not hidden:
                return states
            states[-1] = replace(states[-1], candidates=hidden)
        self.record.enter(Stage.DERIVATIVES, "predicting segments")
        regime = state.problem.regime
        if regime.has_rough_cost or regime.has_single_readings:
            return self._alternate(states)
        search = self._search_segments(state.problem, states[-1])
        return [*states, *self._walk(search, states[-1])]

    def _balance_torques(self, state: SearchState) -> LinearFit | None:
        """The model as given in the balance of torques; None where it cannot be had.

        Or where short segments are explained: what builds up slowly no window shows.
        """
        simulator = state.problem.simulator
        is_slow = mean_seconds(state.problem) >= SELECTION.long_segment
        if is_slow or not is_measured(simulator):
            return None
        self.record.enter(Stage.DERIVATIVES, "measuring accelerations")
        motion = measure_motion(simulator.native, self.rng)
        if len(motion.windows) < MIN_WINDOWS:
            return None
        return start_fit(TorqueBalance(motion), state.best.terms[: state.nominal_count])

    def _search_segments(self, problem: Problem, state: SearchState) -> Search:
        """The search for more effects by predictions of segments.

        Args:
            problem: its segments; in longer ones what is missing has grown, and hides
                more.
            state: whose effects and values to begin with.
        """
        fit, count = state.best, state.nominal_count
        errors = SegmentErrors(problem)
        start = start_fit(errors, fit.terms[:count], fit.terms[count:], fit.values)
        return Search(start, state.candidates, self.record)

    def _alternate(self, states: Sequence[SearchState]) -> list[SearchState]:
        """States with one move more each, fitted to simulations before the next one.

        Where something touches slopes are rough, and a linear model holds near its
        values alone. Moves worth nearly as much as the best one are fitted beside it,
        and made where they predict clearly better (the judge).
        """
        found, problem = list(states), states[0].problem
        while not found[-1].is_explained:
            search = self._search_segments(problem, found[-1])
            with self._keep_unfinished(search, found[-1]):
                is_moved = search.make_move()
                self.record.add_tried(search.candidates)
                state = found[-1] = _keep_ranking(found[-1], search)
                if not is_moved:
                    break
                search.finish()
                moves = (search.fit, *search.near)
                found.append(
                    _choose(problem, [self._fit(search, x, state) for x in moves])
                )
        return found

    def _walk(self, search: Search, state: SearchState) -> list[SearchState]:
        """States with the sets of effects that a search reaches, fitted to simulations.

        One that explains everything stands alone.
        """
        with self._keep_unfinished(search, state):
            search.run()
            self.record.add_tried(search.candidates)
            state = _keep_ranking(state, search)
            found, seen = [], {frozenset(t.key for t in state.named)}
            for linear in reversed(search.path):
                keys = frozenset(t.key for t in linear.named)
                if keys in seen:
                    continue
                seen.add(keys)
                found.append(self._fit(search, refine(linear), state))
                if found[-1].is_explained:
                    return found[-1:]
        return found[::-1]

    @contextmanager
    def _keep_unfinished(self, search: Search, state: SearchState) -> Iterator[None]:
        """Have what a search found fitted to short segments, where time is over.

        Not if it had fitted some of it already.
        """
        before = self.record.state
        try:
            yield
        except OutOfTime:
            linear = search.reached
            if self.record.state is before and linear.named:
                short = replace(self, longer=())
                self.record.finish = partial(short._fit, search, linear, state)
            raise

    def _fit(
        self, search: Search, linear: LinearFit, state: SearchState
    ) -> SearchState:
        """The state with the effects of a linear fit in segments that inform."""
        for term in linear.named:
            less = remove_terms(linear, [linear.terms.index(term)])
            evidence = Evidence(*search.weigh(linear, less, term, self.rng))
            claim = Claim(evidence, search.find_rivals(linear, less, term))
            state = replace(state, claims={**state.claims, term.key: claim})
        names = f"fitting {len(linear.named)} effects to simulations"
        self.record.enter(Stage.FITS, names)
        terms, values = linear.terms, linear.values[: linear.count]
        problem = marginalize_initial_states(state.problem, terms, values)
        fit = fit_parameters(problem, terms, values, iterations=4)
        for _ in range(SELECTION.reweightings_of_all):
            # by the errors of the model as given one joint would outweigh all others
            fit = reweight_and_fit(fit, 4)
        self.record.keep(replace(state, best=fit))
        fit = reweight_and_fit(fit_longer(fit, self.longer), 4)
        self.record.keep(state := replace(state, best=fit))
        return state


def _keep_ranking(state: SearchState, search: Search) -> SearchState:
    """The state with the first ranking of all."""
    return replace(state, first_round=state.first_round or search.first_ranking)


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
    fit = state.best
    posed = marginalize_initial_states(problem, fit.terms, fit.values)
    squares = posed.residuals_at(fit.terms, fit.values) ** 2
    return [0.5 * np.log(problem.sum_by_segment(squares))]
