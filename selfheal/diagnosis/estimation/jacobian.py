"""Jacobians: takes a problem and values, gives the slopes of its residuals.

In parameters and in initial states. Those of kinematic trees that nothing couples are
stepped together, each by the residuals of its tree (Curtis, Powell and Reid 1974).
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

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
    steps = _choose_steps(problem, terms, values, difference_step)[first:]
    tree, rows = _find_independent_trees(
        problem,
        terms,
        find_value_trees,
        len(steps),
        partial(_step_values, problem, terms, values, steps),
    )

    def difference(columns: np.ndarray) -> None:
        """Set columns of the Jacobian, by their numbers, as many as memory holds."""
        batches = _group_columns(columns, tree)
        every = np.arange(len(problem.segments))
        count = max(1, int(FIT.max_difference_numbers / len(residuals)))
        for i in range(0, len(batches), count):
            some = batches[i : i + count]
            changes = _step_values(problem, terms, values, steps, every, some)
            changes -= residuals
            _set_columns(jacobian, some, changes, steps, tree, rows)

    difference(np.arange(len(steps)))
    if difference_step is None and not problem.regime.has_rough_cost:
        largest = FIT.max_difference * np.linalg.norm(residuals)
        changes = np.linalg.norm(jacobian, axis=0) * np.abs(steps)
        share = largest / np.maximum(changes, FIT.tiny)
        steps = steps * np.clip(share, FIT.min_difference_step_share, 1)
        if (share < 1).any():
            difference(np.flatnonzero(share < 1))
    return jacobian


def _choose_steps(
    problem: Problem,
    terms: Sequence[Term],
    values: Floats,
    difference_step: float | None = None,
) -> Floats:
    """(P) steps of all values, backward at an upper bound [units of the parameters].

    Arguments are those of `compute_jacobian`.
    """
    _, high, scale = stack_bounds(terms)
    reach = np.maximum(scale, FIT.min_difference_share * np.abs(values))
    steps = (difference_step or problem.regime.difference_step) * reach
    return np.where(values + steps > high, -steps, steps)


def _step_values(
    problem: Problem,
    terms: Sequence[Term],
    values: Floats,
    steps: Floats,
    chosen: np.ndarray,
    batches: Sequence[np.ndarray],
) -> Floats:
    """Residuals (n, R) in some segments, n sets of the last parameters stepped.

    Args:
        values: (P) from which they are stepped [units of the parameters].
        steps: (p) of the last of them.
        batches: n sets of these parameters, by their numbers.
    """
    points = np.tile(values, (len(batches), 1))
    points[:, len(values) - len(steps) :] += steps * _mark(batches, len(steps))
    return problem.select(chosen).compute_residuals(terms, points)


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

    tree, rows = _find_independent_trees(problem, terms, find_state_trees, width, step)
    batches = _group_columns(np.arange(width), tree)
    moves, middle = _mark([np.zeros(0, int), *batches], width), slice(1)
    if problem.regime.is_nonsmooth:
        pair = np.full((1, width), FIT.antithetic_offset)
        moves, middle = np.concatenate([moves, pair, -pair]), slice(len(moves), None)
    residuals = compute(np.arange(count), moves)
    response = np.zeros((residuals.shape[1], width))
    changes = residuals[1 : 1 + len(batches)] - residuals[middle].mean(axis=0)
    _set_columns(response, batches, changes, np.ones(width), tree, rows)
    split = problem.split_by_segment
    return list(zip(split(residuals[0]), split(response), strict=True))


def _mark(batches: Sequence[np.ndarray], width: int) -> Floats:
    """(n, width) ones in n sets of columns."""
    marked = np.zeros((len(batches), width))
    for row, columns in zip(marked, batches, strict=True):
        row[columns] = 1.0
    return marked


def _find_independent_trees(
    problem: Problem, terms: Sequence[Term], find_trees: Find, count: int, step: Step
) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """The tree of each value, and the residuals (R) of each tree that is alone.

    That nothing couples them is measured in some segments: steps of all values of a
    tree must change no residual of another one. Of what may touch, none is alone.

    Args:
        find_trees: gives the tree of each value.
        count: of the last values, which are to be stepped.
        step: gives residuals with sets of values stepped.

    Returns:
        (count) numbers of trees, `NO_TREE` of what has to be stepped alone.
    """
    alone = np.full(count, NO_TREE)
    if count < LEAST_TOGETHER or problem.regime.is_nonsmooth:
        return alone, {}
    of_value = find_trees(problem.simulator, terms)[-count:]
    of_column = find_column_trees(problem.simulator, terms)
    trees = [int(t) for t in np.unique(of_value) if t != NO_TREE]
    columns = [np.flatnonzero(of_value == t) for t in trees]
    together = max((len(c) for c in columns), default=0)
    if NO_TREE in of_column or together + len(trees) >= (of_value != NO_TREE).sum():
        return alone, {}  # nothing to gain
    last = len(problem.segments) - 1
    some = np.linspace(0, last, min(last + 1, FIT.coupling_segments)).astype(int)
    before, *after = step(some, [np.zeros(0, int), *columns])
    for residuals, tree in zip(after, trees, strict=True):
        change = (residuals - before).reshape(-1, len(of_column))
        leaked = np.linalg.norm(change[:, of_column != tree])
        own = np.linalg.norm(change[:, of_column == tree])
        if leaked > FIT.max_tree_coupling * own:
            return alone, {}
    of_residual = np.tile(of_column, len(problem.segments.readings))
    return of_value, {t: of_residual == t for t in trees}


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


def _group_columns(columns: np.ndarray, tree: np.ndarray) -> list[np.ndarray]:
    """Columns that are differenced together: of each tree one, or one alone.

    Args:
        tree: (P) of each parameter.
    """
    alone = [np.array([c]) for c in columns if tree[c] == NO_TREE]
    by_tree = [columns[tree[columns] == t] for t in np.unique(tree) if t != NO_TREE]
    longest = max(map(len, by_tree), default=0)
    sets = [np.array([c[i] for c in by_tree if i < len(c)]) for i in range(longest)]
    return alone + sets
