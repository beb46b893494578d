"""Fits where something touches: takes one, gives a better one and its problem."""

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..simulation.checkpoint import Arrays
from .candidate_fit import LinearizedFit
from .least_squares import Fit, prior_precision, solve_bounded_step, stack_bounds
from .marginalization import marginalize_initial_states
from .problem import Problem

# times a value, where to look for better ones: far and near
ABOUT, CLOSE = (0.5, 0.7, 0.85, 1.2, 1.4, 2.0), (0.9, 0.95, 1.05, 1.1)
# rounds at most; simulations begun a hair apart, of which each slope and cost is the
# mean, and how many of a robot of which so much is stated that one round takes all of
# the time; steps of simulation in all, times degrees of freedom (a minute, about); and
# the shares of a step that are tried (more than all of it, for roughness makes slopes
# steeper); chosen
ROUNDS, JOLTS, FEW, EFFORT, SHARES = 8, 4, 2, 6e7, (2.0, 1.0, 0.5)


def search_multiples(problem: Problem, terms: Sequence[Term], values: Floats) -> Floats:
    """The values (P), or better ones at so many times one of them.

    Where impacts make the cost rough a search ends in the nearest of many minima, and
    one window, in which a body falls on another side, may outweigh all others: so each
    counts by the logarithm of its cost, as if each had a noise of its own. Single
    readings are too few for that.
    """
    if problem.regime.has_single_readings:
        return values
    for i in np.flatnonzero(prior_precision(terms) == 0):
        points = _scale_one_value(terms, values, i, ABOUT)
        values = _choose_likeliest(
            problem, points, problem.compute_residuals(terms, points)
        )
    return values


def search_along_valleys(problem: Problem, found: Fit) -> Floats:
    """The values (P) of a fit, or likelier ones near them, each with its own starts.

    Starts that were sought with other values hold these where they are. So an effect's
    value is moved a little, all others follow as the fit's slopes ask, and starts are
    sought there. Windows count as in `looked_about`.
    """
    terms, values, base = (
        found.terms,
        found.values,
        LinearizedFit.from_fit(problem, found),
    )
    effects = np.flatnonzero(base.prior == 0)
    each = _simulation_effort(problem) * (2 * problem.simulator.compiler.nominal.nv + 3)
    if each * (1 + len(CLOSE)) * len(effects) > EFFORT:  # to seek starts, about
        return values
    low, high, scale = stack_bounds(terms)
    h, g = base.curvature, base.gradient
    for i in effects:
        rest = np.arange(len(values)) != i
        points = _scale_one_value(terms, values, i, CLOSE)
        for point in points[1:]:
            slope = g + h @ (point - found.values)
            room = (low - point)[rest], (high - point)[rest]
            point[rest] += solve_bounded_step(
                h[rest][:, rest], slope[rest], *room, scale[rest]
            )
        predicted = (
            marginalize_initial_states(problem, terms, p).residuals_at(terms, p)
            for p in points
        )
        values = _choose_likeliest(problem, points, predicted)
    return values


def fit_smoothed(problem: Problem, found: Fit) -> tuple[Problem, Fit]:
    """A fit, moved on over what is rough.

    After an impact readings jump at whatever change, by as much at a small as at a
    large one, and a slope tells of that jump: too steep, in every direction. So slopes
    are taken over a whole scale, and each is the mean of several that begin a hair
    apart, as each cost is (randomized smoothing, Duchi et al. 2012). Starts that were
    sought with other values hold these: they are sought anew for every step.
    """
    terms, values, jac = found.terms, found.values, found.jacobian
    if not len(values):
        return problem, found
    each = _simulation_effort(problem) * JOLTS * (len(values) + 2 + len(SHARES))
    kicks = JOLTS if each < EFFORT else FEW
    for i in range(max(1, int(min(ROUNDS, EFFORT // each)))):
        reestimated = marginalize_initial_states(problem, terms, values)
        hairs = reestimated.draw_antithetic_offsets(kicks, np.random.default_rng(i))
        work_out = partial(_take_smoothed_step, reestimated, terms, values, hairs)
        new, slopes = reestimated.simulator.load_or_compute(work_out)
        problem, jac, values = reestimated, slopes, new
    reestimated = marginalize_initial_states(problem, terms, values)
    return reestimated, Fit(
        terms,
        values,
        reestimated.residuals_at(terms, values),
        problem.transfer_jacobian(reestimated, jac),
    )


def _simulation_effort(problem: Problem) -> int:
    """Steps of one simulation of all windows, times degrees of freedom."""
    return int(problem.segments.lengths.sum()) * problem.simulator.compiler.nominal.nv


def _scale_one_value(
    terms, values: Floats, i: np.integer, about: Sequence[float]
) -> Floats:
    """The values (P), and with the i-th so many times as large, within its bounds."""
    low, high, _ = stack_bounds(terms)
    points = np.tile(values, (1 + len(about), 1))
    points[1:, i] = np.clip(values[i] * np.array(about), low[i], high[i])
    return points


def _choose_likeliest(
    problem: Problem, points: Floats, predicted: Iterable[Floats]
) -> Floats:
    """Of some points, the one whose residuals are, if each window has its own noise."""
    least = problem.sum_by_segment(np.ones(len(problem.segment_of_residual)))
    costs = [np.log(least + problem.sum_by_segment(r**2)).sum() for r in predicted]
    return points[int(np.argmin(costs))]


def _take_smoothed_step(
    problem: Problem, terms: tuple[Term, ...], x: Floats, hairs
) -> Arrays:
    """Values after one step, or the same ones; and the slopes there, a mean."""
    low, high, scale = stack_bounds(terms)

    def told(points: Floats) -> Floats:
        """(n, len(hairs), R) residuals."""
        rows = np.repeat(points, len(hairs), axis=0)
        found = problem.compute_residuals(
            terms, rows, np.tile(hairs, (len(points), 1, 1))
        )
        return found.reshape(len(points), len(hairs), -1)

    r = told(x[None])[0].mean(axis=0)
    moves = np.where(x + scale > high, -scale, scale)
    ends = [told(point[None])[0].mean(axis=0) for point in x + np.diag(moves)]
    jac = (np.array(ends) - r).T / moves
    base = LinearizedFit.from_fit(problem, Fit(terms, x, r, jac))
    _, move = base.minimize(r)
    points = np.clip(x + np.append(0.0, SHARES)[:, None] * move, low, high)
    pull = ((points - 1) ** 2) @ base.prior
    costs = (told(points) ** 2).sum(axis=2).mean(axis=1) + pull
    return points[int(np.argmin(costs))], jac
