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
from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import repeat_by_column
from ..effects.base import Term
from .multiple_shooting import (
    StateEstimates,
    StateSearch,
    build_initial_state_offsets,
)
from .problem import Problem, initial_state_std
from .settings import FIT


def is_horizon_informative(
    problem: Problem, shorter: Problem, terms: Sequence[Term], values: Floats
) -> bool:
    """Whether segments are short enough for the errors of their initial states.

    What these errors cause at values (P) must stay in the linear range, and must not be
    much more than in shorter segments. Where it grows too fast, longer ones tell less.
    """
    response, if_shorter = (
        _measure_state_response(p, terms, values) for p in (problem, shorter)
    )
    most = FIT.max_state_response_growth * if_shorter
    return response < min(FIT.max_state_response, most)


def keep_informative(
    problems: Iterable[Problem], terms: Sequence[Term], values: Floats
) -> list[Problem]:
    """The first problems, each with segments that still inform beside the one before.

    Args:
        problems: in longer and longer segments; the shortest ones always inform.
        values: (P) of the terms [units of the parameters].
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

    All 2 nv errors together, each of one standard deviation [standard deviations of
    the signals], at values (P).
    """
    count = len(problem.segments)
    some = np.linspace(0, count - 1, min(count, FIT.state_response_segments))
    problem = problem.select(some.astype(int))
    offsets = build_initial_state_offsets(problem.simulator, problem.segments)
    predicted = problem.predict(terms, np.tile(values, (len(offsets), 1)), offsets)
    spread = repeat_by_column(problem.simulator.channels, "spread")
    squared = ((predicted[1:] - predicted[0]) / spread) ** 2
    return float(np.sqrt(np.nanmean(squared.sum(axis=0))))


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
        values: (P) of it [units of the parameters].
    """
    std = initial_state_std(problem.simulator, problem.segments)
    std = np.maximum(std, FIT.min_initial_state_std)
    measured = problem.with_measured_states
    start = (
        np.zeros_like(std)
        if problem.initial_state_shift is None
        else problem.initial_state_shift / std
    )
    known = _recall_responses(problem, std)
    search = StateSearch(measured, terms, values, std)
    states = search.run(start, known)
    count = measured.sum_by_segment(np.ones(len(measured.segment_of_residual)))
    mean_squares = states.cost / np.maximum(count, 1)
    is_outlier = states.is_nonlinear & (
        mean_squares > FIT.outlier_ratio * np.median(mean_squares)
    )
    distance = np.abs(states.offset).max(axis=1)
    is_far = start.any(axis=1) & (is_outlier | (distance > FIT.max_state_offset))
    if is_far.any():
        far = np.flatnonzero(is_far)
        near = [states.linearizations[w][1] for w in far] if known else []
        other = search.select(far).run(np.zeros_like(start[far]), near)
        states = states.keep_best(far, other)
    if is_outlier.any():
        outliers = np.flatnonzero(is_outlier)
        part = search.select(outliers)
        states = states.keep_best(outliers, part.run(part.try_other_velocities()))
    return _eliminate_states(measured, states, std)


def _recall_responses(problem: Problem, std: Floats) -> list[Floats]:
    """Responses (R_w, 2 nv) to one standard deviation (W, 2 nv) of states, where kept.

    The problem was marginalized, perhaps with other weights.
    """
    return [
        slopes * each / np.resize(problem.sigma, (len(slopes), 1))
        for slopes, each in zip(problem.state_slopes, std, strict=False)
    ]


def _eliminate_states(problem: Problem, states: StateEstimates, std: Floats) -> Problem:
    """The problem with initial states as estimated, and their errors eliminated.

    Args:
        problem: whose initial states are as read and certain.
        std: (W, 2 nv) their standard deviations [rad or m, and per s].
    """
    responses, bases = [response for _, response in states.linearizations], []
    for response in responses:
        u, z, _ = np.linalg.svd(response, full_matrices=False)
        bases.append((u, 1 - 1 / np.sqrt(1 + z**2)))
    problem = replace(problem, marginal_bases=tuple(bases))
    if problem.regime.is_nonsmooth:
        slopes = [
            response * np.resize(problem.sigma, (len(response), 1)) / each
            for response, each in zip(responses, std, strict=True)
        ]
        problem = replace(problem, state_slopes=tuple(slopes))
    if not states.offset.any():
        return problem
    shifts = [s @ o for s, o in zip(responses, states.offset, strict=True)]
    return replace(
        problem,
        initial_state_shift=states.offset * std,
        shift_response=np.concatenate(shifts),
    )
