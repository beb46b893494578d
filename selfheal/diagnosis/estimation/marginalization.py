"""Marginalization: takes a problem, gives one that allows for errors of its states.

Let s be the errors of a segment's initial state in standard deviations, and S the
linear response of the residuals r to them. The cost is |r + S s|^2 + |s|^2. Its minimum
over s is the Schur complement of s in the normal equations,

    s* = -(I + S'S)^-1 S'r,
    cost* = r'(I - S (I + S'S)^-1 S') r = r'(I + S S')^-1 r

(variable projection, Golub and Pereyra 1973). That is also the likelihood of r with s
integrated out. With S = U diag(z) V' it is the squared sum of marginalized residuals

    (I + S S')^-1/2 r = (I - U diag(1 - 1 / sqrt(1 + z^2)) U') r.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import repeat_by_column
from ..effects.base import Term
from .jacobian import respond_to_initial_states
from .problem import Problem, build_initial_state_offsets, initial_state_std
from .settings import FIT


def is_horizon_informative(
    problem: Problem, shorter: Problem, terms: Sequence[Term], values: Floats
) -> bool:
    """Whether segments are short enough for the errors of their initial states.

    What these errors cause must stay in the linear range, and must not be much more
    than in shorter segments. Where it grows too fast, longer segments tell less.

    Args:
        problem: with the segments in question.
        shorter: the problem with shorter segments.
        terms: of a hypothesis.
        values: (P) of it [units of the parameters].
    """
    response, response_if_shorter = (
        _measure_state_response(p, terms, values) for p in (problem, shorter)
    )
    return response < min(
        FIT.max_state_response, FIT.max_state_response_growth * response_if_shorter
    )


def keep_informative(
    problems: Iterable[Problem], terms: Sequence[Term], values: Floats
) -> list[Problem]:
    """The first problems, each with segments that still inform beside the one before.

    Args:
        problems: in longer and longer segments; the shortest ones always inform.
        terms: of a hypothesis.
        values: (P) of it [units of the parameters].
    """
    kept: list[Problem] = []
    for problem in problems:
        if kept and not is_horizon_informative(problem, kept[-1], terms, values):
            break
        kept.append(problem)
    return kept


def _measure_state_response(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> float:
    """Root mean square of what errors of the initial states cause, in some segments.

    Args:
        problem: with the segments in question.
        terms: of a hypothesis.
        values: (P) of it [units of the parameters].

    Returns:
        All 2 nv errors together, each of one standard deviation [standard deviations of
        the signals].
    """
    count = len(problem.segments)
    some = np.linspace(0, count - 1, min(count, FIT.state_response_segments))
    problem = problem.select(some.astype(int))
    offsets = build_initial_state_offsets(problem.simulator, problem.segments)
    predicted = problem.simulator.simulate(
        terms,
        np.tile(values, (len(offsets), 1)),
        problem.segments,
        initial_state_offset=offsets,
        centered=problem.centered,
    )
    spread = repeat_by_column(problem.simulator.channels, "spread")
    squared = ((predicted[1:] - predicted[0]) / spread) ** 2
    return float(np.sqrt(np.nanmean(squared.sum(axis=0))))


@dataclass(frozen=True, eq=False)
class _StateEstimates:
    """Initial states of W segments, and the linearization there.

    Attributes:
        offset: (W, 2 nv) from the states that were read [standard deviations].
        linearizations: of each segment, residuals r (R_w) and their response S
            (R_w, 2 nv) to one standard deviation of each state.
        cost: (W) |r + S s|^2 + |offset + s|^2 at the best step s.
        is_nonlinear: (W) whether a step of the states does not act linearly.
    """

    offset: Floats
    linearizations: list[tuple[Floats, Floats]]
    cost: Floats
    is_nonlinear: np.ndarray

    def keep_best(
        self, chosen: np.ndarray, other: "_StateEstimates"
    ) -> "_StateEstimates":
        """These, and where they cost less others of some segments, by number."""
        offset, cost = self.offset.copy(), self.cost.copy()
        linearizations = list(self.linearizations)
        for i in np.flatnonzero(other.cost < cost[chosen]):
            w = chosen[i]
            offset[w], cost[w] = other.offset[i], other.cost[i]
            linearizations[w] = other.linearizations[i]
        return _StateEstimates(offset, linearizations, cost, self.is_nonlinear)


def marginalize_initial_states(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> Problem:
    """The problem in which what errors of the initial states explain costs less.

    Each initial state has a normal prior: what was read, with its standard deviation.
    After an impact, and where dry friction decides whether a joint sticks, the response
    is not linear. There the states are first moved to where they are likeliest with
    these values, as in multiple shooting (Bock and Plitt 1984), and linearized anew.
    Outliers, and states that came to lie far from what was read, are searched from
    other states again.

    Args:
        problem: marginalized or not.
        terms: of a hypothesis.
        values: (P) of it [units of the parameters].
    """
    std = initial_state_std(problem.simulator, problem.segments)
    std = np.maximum(std, FIT.min_initial_state_std)
    plain = problem.with_measured_states
    start = (
        np.zeros_like(std)
        if problem.initial_state_shift is None
        else problem.initial_state_shift / std
    )
    states = _search_initial_states(plain, terms, values, start, std)
    count = plain.sum_by_segment(np.ones(len(plain.segment_of_residual)))
    mean_squares = states.cost / np.maximum(count, 1)
    is_outlier = states.is_nonlinear & (
        mean_squares > FIT.outlier_ratio * np.median(mean_squares)
    )
    distance = (states.offset**2).sum(axis=1)
    is_far = start.any(axis=1) & (is_outlier | (distance > FIT.max_state_offset**2))
    if is_far.any():
        far = np.flatnonzero(is_far)
        part, as_read = plain.select(far), np.zeros_like(start[far])
        other = _search_initial_states(part, terms, values, as_read, std[far])
        states = states.keep_best(far, other)
    if is_outlier.any():
        outliers = np.flatnonzero(is_outlier)
        part = plain.select(outliers)
        tried = _try_other_velocities(part, terms, values, std[outliers])
        other = _search_initial_states(part, terms, values, tried, std[outliers])
        states = states.keep_best(outliers, other)
    return _eliminate_states(plain, states, std)


def _eliminate_states(
    problem: Problem, states: _StateEstimates, std: Floats
) -> Problem:
    """The problem with initial states as estimated, and their errors eliminated.

    Args:
        problem: whose initial states are as read and certain.
        states: estimates of them.
        std: (W, 2 nv) their standard deviations [rad or m, and per s].
    """
    bases = []
    for _, response in states.linearizations:
        u, z, _ = np.linalg.svd(response, full_matrices=False)
        bases.append((u, 1 - 1 / np.sqrt(1 + z**2)))
    problem = replace(problem, marginal_bases=tuple(bases))
    if not states.offset.any():
        return problem
    responses = [
        response @ offset
        for (_, response), offset in zip(
            states.linearizations, states.offset, strict=True
        )
    ]
    return replace(
        problem,
        initial_state_shift=states.offset * std,
        shift_response=np.concatenate(responses),
    )


def _search_initial_states(
    problem: Problem,
    terms: Sequence[Term],
    values: Floats,
    start: Floats,
    std: Floats,
) -> _StateEstimates:
    """Search the likeliest initial states of segments whose response is not linear.

    Gauss-Newton iterations of all segments at once. Where the response is linear the
    states stay, for marginalization finds the minimum.

    Args:
        problem: whose initial states are as read and certain.
        terms: of a hypothesis.
        values: (P) of it [units of the parameters].
        start: (W, 2 nv) offsets to begin with [standard deviations].
        std: (W, 2 nv) standard deviations of the states [rad or m, and per s].
    """
    offset = start.copy()
    linearizations = [(np.zeros(0), np.zeros((0, 0)))] * len(offset)
    cost, is_nonlinear = np.zeros(len(offset)), np.zeros(len(offset), bool)
    active = np.arange(len(offset))
    iterations = problem.regime.state_iterations
    for i in range(iterations + 1):
        part = problem.select(active)
        linear = respond_to_initial_states(
            part, terms, values, offset[active], std[active]
        )
        for w, linearization in zip(active, linear, strict=True):
            linearizations[w] = linearization
        if i == iterations:
            break
        step = _step_states(part, terms, values, linear, offset[active], std[active])
        is_nonlinear[active] |= step.is_nonlinear
        cost[active] = step.cost
        moved = active[step.is_better]
        offset[moved] = step.offset[step.is_better]
        active = moved
        if not len(active):
            break
    return _StateEstimates(offset, linearizations, cost, is_nonlinear)


@dataclass(frozen=True, eq=False)
class _StateStep:
    """A Gauss-Newton step of v initial states: (v, 2 nv) where to, and (v) each else.

    `cost` is the lowest one found or, where the response is linear, its minimum.
    """

    offset: Floats
    cost: Floats
    is_nonlinear: np.ndarray
    is_better: np.ndarray


def _step_states(
    problem: Problem,
    terms: Sequence[Term],
    values: Floats,
    linearizations: Sequence[tuple[Floats, Floats]],
    offset: Floats,
    std: Floats,
) -> _StateStep:
    """One Gauss-Newton step of each initial state, with a line search.

    Args:
        problem: of v segments.
        terms: of a hypothesis.
        values: (P) of it [units of the parameters].
        linearizations: of each segment, residuals (R_w) and response (R_w, 2 nv).
        offset: (v, 2 nv) of the states [standard deviations].
        std: (v, 2 nv) standard deviations [rad or m, and per s].
    """
    best = [
        _solve_initial_state(r, response, o)
        for (r, response), o in zip(linearizations, offset, strict=True)
    ]
    shares = np.array(FIT.state_step_shares)[:, None, None]
    tried = offset + shares * (np.array(best) - offset)
    rows = np.tile(values, (len(tried), 1))
    residuals = problem.compute_residuals(terms, rows, tried * std)
    costs = [problem.sum_by_segment(r**2) for r in residuals] + (tried**2).sum(axis=2)
    before = np.array([r @ r for r, _ in linearizations]) + (offset**2).sum(axis=1)
    predicted = np.concatenate(
        [
            r + response @ step
            for (r, response), step in zip(
                linearizations, tried[0] - offset, strict=True
            )
        ]
    )
    error = problem.sum_by_segment((residuals[0] - predicted) ** 2)
    is_nonlinear = error > FIT.state_nonlinearity * before.mean()
    lowest = costs.argmin(axis=0), np.arange(len(offset))
    needed = (1 - FIT.min_state_step_gain) * before
    is_better = is_nonlinear & (costs[lowest] < needed)
    minimum = problem.sum_by_segment(predicted**2) + (tried[0] ** 2).sum(axis=1)
    cost = np.where(is_nonlinear, np.minimum(costs[lowest], before), minimum)
    return _StateStep(tried[lowest], cost, is_nonlinear, is_better)


def _try_other_velocities(
    problem: Problem, terms: Sequence[Term], values: Floats, std: Floats
) -> Floats:
    """The likeliest of some states with one velocity higher or lower than read.

    A robot with dry friction sticks or slips by how fast it was. From one side of that
    no slope leads to the other.

    Args:
        problem: of v segments.
        terms: of a hypothesis.
        values: (P) of it [units of the parameters].
        std: (v, 2 nv) standard deviations [rad or m, and per s].

    Returns:
        (v, 2 nv) offsets [standard deviations].
    """
    count, width = std.shape
    velocities = FIT.velocity_offset * np.eye(width)[width // 2 :, None]
    tried = np.concatenate([velocities, -velocities]).repeat(count, axis=1)
    rows = np.tile(values, (len(tried), 1))
    residuals = problem.compute_residuals(terms, rows, tried * std)
    costs = np.array([problem.sum_by_segment(r**2) for r in residuals])
    costs = costs + (tried**2).sum(axis=2)
    return tried[costs.argmin(axis=0), np.arange(count)]


def _solve_initial_state(residuals: Floats, response: Floats, offset: Floats) -> Floats:
    """The offset (2 nv) of lowest cost if the response is linear.

    (I + S'S) s = S'(S offset - r), all in standard deviations.

    Args:
        residuals: (R_w) r at the offset.
        response: (R_w, 2 nv) S of the residuals.
        offset: (2 nv) of the initial state from what was read.
    """
    curvature = np.eye(len(offset)) + response.T @ response
    target = response.T @ (response @ offset - residuals)
    return np.asarray(np.linalg.solve(curvature, target))
