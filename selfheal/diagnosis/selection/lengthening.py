"""Longer segments: takes fits, gives fits in which slow effects show.

Segments are as long as the robot can be predicted.
"""

from collections.abc import Sequence
from dataclasses import replace

from ..estimation.fit import Fit
from ..estimation.least_squares import fit_parameters
from ..estimation.marginalization import (
    is_horizon_informative,
    marginalize_initial_states,
)
from ..estimation.problem import Problem
from .search_state import SearchState, reweight_and_fit


def fit_longer(fit: Fit, longer: Sequence[Problem]) -> Fit:
    """The fit repeated in longer and longer segments, as far as these inform.

    Args:
        longer: the problem in longer and longer segments.
    """
    for other in longer:
        problem = fit.problem
        other = replace(other, sigma=problem.sigma, simulator=problem.simulator)
        if not is_horizon_informative(other, problem, fit.terms, fit.values):
            break
        other = marginalize_initial_states(other, fit.terms, fit.values)
        fit = fit_parameters(other, fit.terms, fit.values, iterations=5)
    return fit


def lengthen_segments(state: SearchState, longer: Sequence[Problem]) -> SearchState:
    """The state fitted in longer segments, while these inform and nothing is left.

    What builds up slowly is not seen in short segments, as the loss of energy of a
    free pendulum.

    Args:
        state: in which short segments are explained, or not.
        longer: the problem in longer and longer segments.
    """
    steps = state.problem.segments.lengths.mean()
    for other in longer:
        if not state.is_explained:
            break
        if other.segments.lengths.mean() <= steps:
            continue
        fit = fit_longer(state.best, [other])
        if fit is state.best:
            break
        state = state.with_fit(reweight_and_fit(fit, 4))
    return state
