"""Jacobians: takes a problem and values, gives the slopes of its residuals."""

from collections.abc import Sequence

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from .problem import Problem
from .quadratic_model import stack_bounds
from .settings import FIT


def compute_jacobian(
    problem: Problem,
    terms: Sequence[Term],
    values: Floats,
    residuals: Floats,
    first: int = 0,
    *,
    difference_step: float | None = None,
) -> Floats:
    """Jacobian of the residuals by forward differences, backward at an upper bound.

    All P - first simulations are one batch. Where motions are smooth, those whose
    residuals change by more than a share of the residuals are repeated over a smaller
    step: so far the residuals bend.

    Args:
        problem: of the residuals.
        terms: P parameters in all.
        values: (P) where to linearize [units of the parameters].
        residuals: (R) at the values [standard deviations].
        first: number of the first parameter to difference by.
        difference_step: of each parameter [scales, or shares of a value many times as
            large]; None: as suits the problem.

    Returns:
        (R, P - first) [1 per unit of the parameter].
    """
    _, high, scale = (x[first:] for x in stack_bounds(terms))
    differenced = values[first:]
    reach = np.maximum(scale, FIT.min_difference_share * np.abs(differenced))
    steps = (difference_step or problem.regime.difference_step) * reach
    jacobian = np.zeros((len(residuals), len(steps)))

    def difference(columns: np.ndarray) -> None:
        """Set columns of the Jacobian, by their numbers."""
        if not len(columns):
            return
        is_beyond = differenced + steps > high
        signed = np.where(is_beyond, -steps, steps)[columns]
        points = np.tile(values, (len(columns), 1))
        points[np.arange(len(columns)), first + columns] += signed
        changes = problem.compute_residuals(terms, points) - residuals
        jacobian[:, columns] = (changes / signed[:, None]).T

    difference(np.arange(len(steps)))
    if difference_step is None and not problem.regime.has_rough_cost:
        largest = FIT.max_difference * np.linalg.norm(residuals)
        changes = np.linalg.norm(jacobian, axis=0) * steps
        share = largest / np.maximum(changes, FIT.tiny)
        steps = steps * np.clip(share, FIT.min_difference_step_share, 1)
        difference(np.flatnonzero(share < 1))
    return jacobian
