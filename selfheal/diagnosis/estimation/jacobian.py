"""Jacobians: takes a problem and values, gives the slopes of its residuals.

In parameters and in initial states. Those of kinematic trees that nothing couples are
stepped together, each by the residuals of its tree (Curtis, Powell and Reid 1974).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..simulation.kinematic_trees import (
    NO_TREE,
    find_column_trees,
    find_state_trees,
    find_value_trees,
)
from ..simulation.simulator import Simulator
from .problem import Problem
from .quadratic_model import stack_bounds
from .settings import FIT

# parameters from which on fewer simulations can do, that of coupling counted: three in
# each of two trees, or two in each of three
LEAST_TOGETHER = 6

# gives residuals (n, R) in some segments, with n sets of columns stepped
Step = Callable[[np.ndarray, Sequence[np.ndarray]], Floats]
# gives the tree of each value or state
Find = Callable[[Simulator, Sequence[Term]], np.ndarray]


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

    Where motions are smooth, those of parameters whose residuals change by more than a
    share of the residuals are repeated over a smaller step: so far the residuals bend.

    Args:
        values: (P) where to linearize [units of the parameters].
        residuals: (R) at the values [standard deviations].
        first: number of the first parameter to difference by.
        difference_step: of each parameter [scales, or shares of a value many times as
            large]; None: as suits the problem.

    Returns:
        (R, P - first) [1 per unit of the parameter].
    """
    jacobian = np.zeros((len(residuals), len(values) - first))
    if not jacobian.size:
        return jacobian
    _, high, scale = stack_bounds(terms)
    reach = np.maximum(scale, FIT.min_difference_share * np.abs(values))
    steps = (difference_step or problem.regime.difference_step) * reach
    steps = np.where(values + steps > high, -steps, steps)[first:]

    def step(chosen: np.ndarray, batches: Sequence[np.ndarray]) -> Floats:
        """(n, R) residuals in segments `chosen`, n sets of values stepped."""
        points = np.tile(values, (len(batches), 1))
        points[:, first:] += steps * _mark(batches, len(steps))
        return problem.select(chosen).compute_residuals(terms, points)

    groups = _Groups.find(problem, terms, find_value_trees, len(steps), step)

    def difference(columns: np.ndarray) -> None:
        """Set columns of the Jacobian, by their numbers, as many as memory holds."""
        batches = groups.batch(columns)
        every = np.arange(len(problem.segments))
        count = max(1, int(FIT.max_difference_numbers / len(residuals)))
        for i in range(0, len(batches), count):
            some = batches[i : i + count]
            changes = step(every, some)
            changes -= residuals
            groups.set_columns(jacobian, some, changes, steps)

    difference(np.arange(len(steps)))
    if difference_step is None and not problem.regime.has_rough_cost:
        largest = FIT.max_difference * np.linalg.norm(residuals)
        changes = np.linalg.norm(jacobian, axis=0) * np.abs(steps)
        share = largest / np.maximum(changes, FIT.tiny)
        steps = steps * np.clip(share, FIT.min_difference_step_share, 1)
        if (share < 1).any():
            difference(np.flatnonzero(share < 1))
    return jacobian


def respond_to_initial_states(
    problem: Problem, terms: Sequence[Term], values: Floats, offset: Floats, std: Floats
) -> list[tuple[Floats, Floats]]:
    """Linearize the residuals in the initial states, by forward differences.

    In contact they are differences to the mean of two residuals slightly off, else the
    roughness of one would be in all slopes.

    Args:
        problem: of v segments, whose initial states are as read and certain.
        values: (P) of it [units of the parameters].
        offset: (v, 2 nv) of the states [standard deviations].
        std: (v, 2 nv) standard deviations [rad or m, and per s].

    Returns:
        Of each segment, residuals (R_w) and their response (R_w, 2 nv) to one standard
        deviation of each state [standard deviations].
    """
    count, width = offset.shape

    def compute(chosen: np.ndarray, moves: Floats) -> Floats:
        """(n, R) residuals in segments `chosen`, states moved by (n, 2 nv)."""
        offsets = (offset[chosen] + moves[:, None]) * std[chosen]
        rows = np.tile(values, (len(moves), 1))
        return problem.select(chosen).compute_residuals(terms, rows, offsets)

    def step(chosen: np.ndarray, batches: Sequence[np.ndarray]) -> Floats:
        """(n, R) residuals in segments `chosen`, n sets of states moved."""
        return compute(chosen, _mark(batches, width))

    groups = _Groups.find(problem, terms, find_state_trees, width, step)
    batches = groups.batch(np.arange(width))
    moves, middle = _mark([np.zeros(0, int), *batches], width), slice(1)
    if problem.regime.is_nonsmooth:
        pair = np.full((1, width), FIT.antithetic_offset)
        moves, middle = np.concatenate([moves, pair, -pair]), slice(len(moves), None)
    residuals = compute(np.arange(count), moves)
    response = np.zeros((residuals.shape[1], width))
    changes = residuals[1 : 1 + len(batches)] - residuals[middle].mean(axis=0)
    groups.set_columns(response, batches, changes, np.ones(width))
    split = problem.split_by_segment
    return list(zip(split(residuals[0]), split(response), strict=True))


def _mark(batches: Sequence[np.ndarray], width: int) -> Floats:
    """(n, width) ones in n sets of columns."""
    marked = np.zeros((len(batches), width))
    for row, columns in zip(marked, batches, strict=True):
        row[columns] = 1.0
    return marked


@dataclass(frozen=True, eq=False)
class _Groups:
    """Which columns of a Jacobian are differenced together.

    Attributes:
        tree: (P) number of each parameter's tree, `NO_TREE` of what is stepped alone.
        rows: (R) whether each residual is of a tree, by its number.
    """

    tree: np.ndarray
    rows: dict[int, np.ndarray]

    @classmethod
    def find(
        cls, problem: Problem, terms: Sequence[Term], find: Find, count: int, step: Step
    ) -> "_Groups":
        """Find those of the last `count` values or states.

        That nothing couples two trees is measured in some segments: steps of all values
        of a tree must change no residual of another one. Of what may touch, none is
        alone.

        Args:
            find: gives the tree of each value.
            step: gives residuals with sets of values stepped.
        """
        alone = cls(np.full(count, NO_TREE), {})
        if count < LEAST_TOGETHER or problem.regime.is_nonsmooth:
            return alone
        of_value = find(problem.simulator, terms)[-count:]
        of_column = find_column_trees(problem.simulator, terms)
        trees = [int(t) for t in np.unique(of_value) if t != NO_TREE]
        columns = [np.flatnonzero(of_value == t) for t in trees]
        together = max((len(c) for c in columns), default=0)
        if NO_TREE in of_column or together + len(trees) >= (of_value != NO_TREE).sum():
            return alone  # nothing to gain
        # where nothing touches, what couples trees acts at all times
        before, *after = step(np.zeros(1, int), [np.zeros(0, int), *columns])
        for residuals, tree in zip(after, trees, strict=True):
            change = (residuals - before).reshape(-1, len(of_column))
            leaked = np.linalg.norm(change[:, of_column != tree])
            own = np.linalg.norm(change[:, of_column == tree])
            if leaked > FIT.max_tree_coupling * own:
                return alone
        of_residual = np.tile(of_column, len(problem.segments.readings))
        return cls(of_value, {t: of_residual == t for t in trees})

    def batch(self, columns: np.ndarray) -> list[np.ndarray]:
        """Columns that are differenced together: of each tree one, or one alone."""
        tree = self.tree
        alone = [np.array([c]) for c in columns if tree[c] == NO_TREE]
        by_tree = [columns[tree[columns] == t] for t in np.unique(tree) if t != NO_TREE]
        longest = max(map(len, by_tree), default=0)
        sets = [np.array([c[i] for c in by_tree if i < len(c)]) for i in range(longest)]
        return alone + sets

    def set_columns(
        self,
        jacobian: Floats,
        batches: Sequence[np.ndarray],
        changes: Floats,
        steps: Floats,
    ) -> None:
        """Set columns of a Jacobian (R, P) by changes (n, R) of the residuals.

        Args:
            steps: (P) of the parameters, of which n batches were made together.
        """
        for change, batch in zip(changes, batches, strict=True):
            for c in batch:
                own = self.rows[self.tree[c]] if len(batch) > 1 else slice(None)
                jacobian[own, c] = change[own] / steps[c]
