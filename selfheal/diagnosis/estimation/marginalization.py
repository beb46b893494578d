"""Initial states marginalized out of a problem (Golub & Pereyra 1973)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..data.robot_summary import repeat_by_column
from ..effects.base import Term
from .problem import (
    HAIR,
    Problem,
    build_initial_state_offsets,
    initial_state_std,
    unit_offsets,
)

LINEAR = 0.1  # of a signal's spread, that a start's error may cause; chosen
# rounds in which starts are sought, the shares of a step tried at once, and of the
# squared residuals what a step of starts may leave that is not linear; chosen
SOUGHT, SHORTER, BENT = 5, (1.0, 0.5, 0.2), 0.01
# times the median of a reading's squared residual, above which a window's start is
# sought at other speeds, and how many errors from the speed read; and how many errors a
# start may be away from what was read, before it is sought from there again; chosen
ODD, SPEEDS, AWAY = 4.0, 2.0, 3.0
GROWS = 2.0  # times what it causes in a shorter piece; chosen


def is_horizon_informative(
    problem: Problem, shorter: Problem, terms: Sequence[Term], values: Floats
) -> bool:
    """Whether the windows are short enough for their starts.

    What an error of the start causes in them stays linear and is not much more than it
    is in shorter ones; where it grows too fast, longer pieces say less, not more.
    """
    moved = [_initial_state_sensitivity(p, terms, values) for p in (problem, shorter)]
    return moved[0] < min(LINEAR, GROWS * moved[1])


def _initial_state_sensitivity(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> float:
    """Root mean square of what errors of the starts cause, of the signals' spreads."""
    initial_state_offset = build_initial_state_offsets(
        problem.simulator, problem.segments
    )
    hypotheses = np.tile(values, (len(initial_state_offset), 1))
    predicted = problem.simulator.simulate(
        terms,
        hypotheses,
        problem.segments,
        initial_state_offset=initial_state_offset,
        centered=problem.centered,
    )
    spread = repeat_by_column(problem.simulator.channels, "spread")
    moved = ((predicted[1:] - predicted[0]) / spread) ** 2
    return float(np.sqrt(np.nanmean(moved.sum(axis=0))))


def marginalize_initial_states(
    problem: Problem, terms: Sequence[Term], values: Floats
) -> Problem:
    """The same problem, in which what an uncertain start could cause costs less.

    Starts are eliminated from the least squares, each believed to be as read but for
    its error. After an impact what they cause is not linear: there they are first moved
    to where, with these values, they are likeliest (Bock 1983, multiple shooting).
    """
    std = initial_state_std(problem.simulator, problem.segments)
    std = np.maximum(std, 1e-300)  # without noise; then no start moves
    plain = replace(problem.unmarginalized, initial_state_shift=None)
    off = (
        np.zeros_like(std)
        if problem.initial_state_shift is None
        else problem.initial_state_shift / std
    )
    begun = off.any(axis=1)  # elsewhere than from what was read
    predicted, cost, bent = _search_initial_states(plain, terms, values, off, std)
    known = off, std, predicted, cost
    each = cost / np.maximum(
        problem.sum_by_segment(np.ones(len(problem.segment_of_residual))), 1
    )
    is_odd = bent & (each > ODD * np.median(each))
    is_far = begun & (is_odd | ((off**2).sum(axis=1) > AWAY**2))
    if is_far.any():
        far = np.flatnonzero(is_far)
        _keep_likelier(plain, terms, values, known, far, np.zeros_like(off[far]))
    if is_odd.any():
        odd = np.flatnonzero(is_odd)
        others = _try_other_speeds(plain, terms, values, std, odd)
        _keep_likelier(plain, terms, values, known, odd, others)
    whiten = []
    for _, moved in predicted:
        u, s, _ = np.linalg.svd(moved, full_matrices=False)
        whiten.append((u, 1 - 1 / np.sqrt(1 + s**2)))
    plain = replace(plain, marginal_bases=tuple(whiten))
    if not off.any():
        return plain
    pull = [moved @ o for (_, moved), o in zip(predicted, off, strict=True)]
    return replace(
        plain, initial_state_shift=off * std, shift_response=np.concatenate(pull)
    )


def _search_initial_states(
    problem: Problem, terms: Sequence[Term], values: Floats, off: Floats, std: Floats
) -> tuple[list[tuple[Floats, Floats]], Floats, np.ndarray]:
    """Move starts to where they are likeliest, as far as what they cause is not linear.

    Args:
        problem: without what starts explain.
        terms: of one hypothesis.
        values: (P) of it.
        off: (W, 2 nv) of the starts, in their errors; written to.
        std: (W, 2 nv) errors of what was read.

    Returns:
        Of each window: residuals (R_w), and what one error of each state adds to them
        (R_w, 2 nv). And what is left (W) of its squares with the likeliest start, that
        start's own errors included. And where (W) what starts cause is not linear.
    """
    predicted = [(np.zeros(0), np.zeros((0, 0)))] * len(off)
    cost, is_bent = np.zeros(len(off)), np.zeros(len(off), bool)
    active = np.arange(len(off))
    for last in range(SOUGHT + 1):
        part, start, unit = problem.select(active), off[active], std[active]
        own = _respond_to_offsets(part, terms, values, start, unit)
        for w, one in zip(active, own, strict=True):
            predicted[w] = one
        if last == SOUGHT or problem.regime.has_single_readings:
            break
        best = [
            _solve_initial_state(*one, o) for one, o in zip(own, start, strict=True)
        ]
        tries = start + np.array(SHORTER)[:, None, None] * (np.array(best) - start)
        rows = np.tile(values, (len(tries), 1))
        after = part.compute_residuals(terms, rows, tries * unit)
        costs = [part.sum_by_segment(x**2) for x in after] + (tries**2).sum(axis=2)
        before = np.array([r @ r for r, _ in own]) + (start**2).sum(axis=1)
        moves = zip(own, tries[0] - start, strict=True)
        linear = np.concatenate([r + moved @ move for (r, moved), move in moves])
        bent = part.sum_by_segment((after[0] - linear) ** 2) > BENT * before.mean()
        which = costs.argmin(axis=0), np.arange(len(active))
        gains = bent & (costs[which] < before)
        is_bent[active] |= bent
        straight = part.sum_by_segment(linear**2) + (tries[0] ** 2).sum(axis=1)
        cost[active] = np.where(bent, np.minimum(costs[which], before), straight)
        active = active[gains]
        if not len(active):
            break
        off[active] = tries[which][gains]
    return predicted, cost, is_bent


def _keep_likelier(problem, terms, values, known, which, begin: Floats) -> None:
    """Let some windows start where others led that begin elsewhere, if likelier.

    Args:
        problem, terms, values: as in `_sought`.
        known: `off` and `std` as there, and what it returned: all written to.
        which: windows (v).
        begin: (v, 2 nv), as `off`; written to.
    """
    off, std, predicted, cost = known
    again, new, _ = _search_initial_states(
        problem.select(which), terms, values, begin, std[which]
    )
    for i in np.flatnonzero(new < cost[which]):
        w = which[i]
        off[w], predicted[w], cost[w] = begin[i], again[i], new[i]


def _try_other_speeds(problem, terms, values, std, which) -> Floats:
    """Starts (v, 2 nv) of windows, in errors: the likeliest of some other speeds.

    A robot with dry friction sticks or slips by how fast it was; from one side of that
    no slope leads to the other.
    """
    width = std.shape[1]
    speeds = SPEEDS * np.eye(width)[width // 2 :, None]
    tries = np.concatenate([speeds, -speeds]).repeat(len(which), axis=1)
    part = problem.select(which)
    rows = np.tile(values, (len(tries), 1))
    after = part.compute_residuals(terms, rows, tries * std[which])
    costs = np.array([part.sum_by_segment(r**2) for r in after]) + (tries**2).sum(
        axis=2
    )
    return tries[costs.argmin(axis=0), np.arange(len(which))]


def _respond_to_offsets(
    problem: Problem, terms: Sequence[Term], values: Floats, off: Floats, std: Floats
) -> list[tuple[Floats, Floats]]:
    """What `_sought` returns first, of starts as they are; arguments as there."""
    count, width = off.shape
    each = unit_offsets(width)
    if problem.regime.is_nonsmooth:  # else roughness at one point is in all slopes
        hair = np.full((1, 1, width), HAIR)
        each = np.concatenate([each, hair, -hair])
    rows = np.tile(values, (len(each), 1))
    predicted = problem.compute_residuals(terms, rows, (off + each) * std)
    edges = np.searchsorted(problem.segment_of_residual, np.arange(1, count))
    middle = slice(1 + width, None) if problem.regime.is_nonsmooth else slice(1)
    return [
        (part[0], (part[1 : 1 + width] - part[middle].mean(axis=0)).T)
        for part in np.split(predicted, edges, axis=1)
    ]


def _solve_initial_state(r: Floats, moved: Floats, off: Floats) -> Floats:
    """A window's start, if all were linear; arguments as in `_answers`."""
    curvature = np.eye(len(off)) + moved.T @ moved
    return np.asarray(np.linalg.solve(curvature, moved.T @ (moved @ off - r)))
