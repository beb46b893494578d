"""Jacobians: takes a problem and values, gives the slopes of its residuals."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..simulation.kinematic_trees import NO_TREE, find_trees
from .problem import Problem
from .quadratic_model import stack_bounds
from .settings import FIT

# parameters from which on fewer simulations can do, that of coupling counted: three in
# each of two trees, or two in each of three
LEAST_TOGETHER = 6


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

    Parameters of kinematic trees that nothing couples are differenced together, each by
    the residuals of its tree (Curtis, Powell and Reid 1974). Where motions are smooth,
    those whose residuals change by more than a share of the residuals are repeated over
    a smaller step: so far the residuals bend.

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
    jacobian = np.zeros((len(residuals), len(differenced)))
    if not jacobian.size:
        return jacobian
    reach = np.maximum(scale, FIT.min_difference_share * np.abs(differenced))
    steps = (difference_step or problem.regime.difference_step) * reach
    steps = np.where(differenced + steps > high, -steps, steps)

    def measure_changes(batches: Sequence[np.ndarray]) -> Floats:
        """(n, R) changes of the residuals by steps of n sets of parameters."""
        points = np.tile(values, (len(batches), 1))
        for point, columns in zip(points, batches, strict=True):
            point[first + columns] += steps[columns]
        return problem.compute_residuals(terms, points) - residuals

    tree, rows = _find_independent_trees(problem, terms, first, measure_changes)

    def difference(columns: np.ndarray) -> None:
        """Set columns of the Jacobian, by their numbers."""
        batches = _group_columns(columns, tree)
        _set_columns(jacobian, batches, measure_changes(batches), steps, tree, rows)

    difference(np.arange(len(steps)))
    if difference_step is None and not problem.regime.has_rough_cost:
        largest = FIT.max_difference * np.linalg.norm(residuals)
        changes = np.linalg.norm(jacobian, axis=0) * np.abs(steps)
        share = largest / np.maximum(changes, FIT.tiny)
        steps = steps * np.clip(share, FIT.min_difference_step_share, 1)
        if (share < 1).any():
            difference(np.flatnonzero(share < 1))
    return jacobian


def _set_columns(
    jacobian: Floats,
    batches: Sequence[np.ndarray],
    changes: Floats,
    steps: Floats,
    tree: np.ndarray,
    rows: Mapping[int, np.ndarray],
) -> None:
    """Set columns of a Jacobian (R, P), from steps that were made together.

    Args:
        jacobian: changed.
        batches: n sets of columns, of each tree one.
        changes: (n, R) of the residuals.
        steps: (P) of the parameters.
        tree: (P) of each parameter.
        rows: (R) whether a residual is of a tree.
    """
    for change, batch in zip(changes, batches, strict=True):
        for c in batch:
            own = rows[tree[c]] if len(batch) > 1 else slice(None)
            jacobian[own, c] = change[own] / steps[c]


def _find_independent_trees(
    problem: Problem,
    terms: Sequence[Term],
    first: int,
    measure_changes: Callable[[Sequence[np.ndarray]], Floats],
) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """The tree of each parameter, and the residuals (R) of each tree that is alone.

    That nothing couples them is measured: steps of all parameters of a tree must change
    no residual of another one.

    Args:
        problem: of the residuals.
        terms: P parameters in all.
        first: number of the first parameter to difference by.
        measure_changes: gives the changes of the residuals by steps of parameters.

    Returns:
        (P - first) numbers of trees, `NO_TREE` of what has to be stepped alone.
    """
    alone = np.full(sum(len(t.parameters) for t in terms) - first, NO_TREE)
    if len(alone) < LEAST_TOGETHER:
        return alone, {}
    of_value, of_column = find_trees(problem.simulator, terms)
    of_value = of_value[first:]
    trees = [int(t) for t in np.unique(of_value) if t != NO_TREE]
    columns = [np.flatnonzero(of_value == t) for t in trees]
    together = max((len(c) for c in columns), default=0)
    if NO_TREE in of_column or together + len(trees) >= (of_value != NO_TREE).sum():
        return alone, {}  # nothing to gain
    of_residual = np.tile(of_column, len(problem.segments.readings))
    rows = {t: of_residual == t for t in trees}
    for change, own in zip(measure_changes(columns), rows.values(), strict=True):
        leaked = np.linalg.norm(change[~own])
        if leaked > FIT.max_tree_coupling * np.linalg.norm(change[own]):
            return alone, {}
    return of_value, rows


def _group_columns(columns: np.ndarray, tree: np.ndarray) -> list[np.ndarray]:
    """Columns that are differenced together: of each tree one, or one alone.

    Args:
        columns: numbers of parameters.
        tree: (P) of each parameter.
    """
    alone = [np.array([c]) for c in columns if tree[c] == NO_TREE]
    by_tree = [columns[tree[columns] == t] for t in np.unique(tree) if t != NO_TREE]
    longest = max(map(len, by_tree), default=0)
    sets = [np.array([c[i] for c in by_tree if i < len(c)]) for i in range(longest)]
    return alone + sets
