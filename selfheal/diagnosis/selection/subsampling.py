"""Segments that stand for all of them: takes a problem, gives it in fewer segments."""

from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..estimation.fit import Fit
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.problem import Problem
from ..estimation.settings import FIT
from .settings import SELECTION


def count_native_steps(problem: Problem) -> int:
    """Lengths of the segments in sum [steps of the given model]."""
    return int(problem.segments.lengths.sum() * problem.simulator.coarsening)


def mean_seconds(problem: Problem) -> float:
    """Mean length of the segments [s]."""
    return float(problem.segments.lengths.mean() * problem.simulator.timestep)


def draw_segments(problem: Problem, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Draw segments that have about so many simulation steps in sum.

    Args:
        steps: [steps of the given model] of the segments in sum, about.

    Returns:
        (v) numbers of segments, in order.
    """
    size = len(problem.segments)
    wanted = steps / (count_native_steps(problem) / size)
    least, seconds = SELECTION.min_search_segments, mean_seconds(problem)
    if seconds >= SELECTION.long_segment:
        least = int(SELECTION.min_search_seconds / seconds)
        least = max(least, SELECTION.min_long_segments)
    count = int(np.clip(wanted, min(least, size), size))
    if count >= SELECTION.nearly_all_segments * size:
        return np.arange(size)
    return np.sort(rng.permutation(size)[:count])


def find_overlooked_segments(
    problem: Problem, chosen: np.ndarray, fit: Fit
) -> np.ndarray:
    """Find segments that were not drawn and that a fit explains much worse.

    What shows rarely, as a stop does, may be in none of the segments that were drawn.
    In contact none are looked for: a segment may be an outlier by an impact alone.

    Args:
        chosen: (v) numbers of the segments that were drawn.
        fit: the fit to these segments, weighted by their residuals.

    Returns:
        (w) numbers of the segments, the worst ones first.
    """
    others = np.setdiff1d(np.arange(len(problem.segments)), chosen)
    regime = problem.regime
    if regime.has_rough_cost or regime.has_single_readings or not len(others):
        return others[:0]
    part = fit.problem
    rest = replace(problem.select(others), sigma=part.sigma, simulator=part.simulator)
    rest = marginalize_initial_states(rest, fit.terms, fit.values)
    predicted = rest.residuals_at(fit.terms, fit.values)
    left, usual = (
        _mean_squares(p, r) for p, r in ((rest, predicted), (part, fit.residuals))
    )
    worst = np.argsort(-left)[: len(usual) // 2]
    return others[worst[left[worst] > FIT.outlier_ratio * np.median(usual)]]


def _mean_squares(problem: Problem, residuals: Floats) -> Floats:
    """(W) [1] mean square of the residuals (R) of each segment, missing ones aside."""
    count = problem.sum_by_segment((residuals != 0).astype(float))
    return problem.sum_by_segment(residuals**2) / np.maximum(count, 1)
