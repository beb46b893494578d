"""Fits over a rough cost: takes a problem in contact, gives values of a lower cost.

Impacts make the cost rough, with many minima. Values are searched at multiples of what
they are, along valleys of the cost, and by steps over a smoothed cost.
"""

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..simulation.checkpoint import Arrays
from .fit import Fit
from .linearized_fit import LinearizedFit
from .marginalization import marginalize_initial_states
from .problem import Problem
from .quadratic_model import prior_precision, solve_bounded_step, stack_bounds
from .settings import FIT


def search_multiples(problem: Problem, terms: Sequence[Term], values: Floats) -> Floats:
    """Search values (P) at multiples of what they are, one effect's after the other.

    A search by slopes ends in the nearest of many minima. Points are compared by the
    likelihood of `_choose_likeliest`, for which single readings are too few. Nominal
    values stay.
    """
    if problem.regime.has_single_readings:
        return values
    for i in np.flatnonzero(prior_precision(terms) == 0):
        points = _scale_one_value(terms, values, i, FIT.far_multiples)
        residuals = problem.compute_residuals(terms, points)
        values = _choose_likeliest(problem, points, residuals)
    return values


def search_along_valleys(fit: Fit) -> Floats:
    """Search values near a fit, each with initial states of its own.

    States that were estimated with other values hold these where they are. So an
    effect's value is moved a little, all other values follow as the quadratic model
    asks, and initial states are estimated there: a profile likelihood. It is not
    searched where that takes more than `FIT.smoothed_effort`. Gives values (P).
    """
    problem, terms, values = fit.problem, fit.terms, fit.values
    base = LinearizedFit.from_fit(fit)
    effects = np.flatnonzero(base.prior == 0)
    # to linearize initial states: as they are, 2 nv offsets, an antithetic pair
    simulations = 2 * problem.simulator.compiler.nominal.nv + 3
    effort = _simulation_effort(problem) * simulations
    if effort * (1 + len(FIT.near_multiples)) * len(effects) > FIT.smoothed_effort:
        return values
    for i in effects:
        points = _scale_one_value(terms, values, i, FIT.near_multiples)
        points[1:] = [_follow_linearly(base, x, i) for x in points[1:]]
        residuals = (
            marginalize_initial_states(problem, terms, x).residuals_at(terms, x)
            for x in points
        )
        values = _choose_likeliest(problem, points, residuals)
    return values


def _follow_linearly(base: LinearizedFit, values: Floats, i: np.integer) -> Floats:
    """Move all values (P) but the i-th to the minimum of the quadratic model."""
    low, high, scale = stack_bounds(base.fit.terms)
    moved, rest = values.copy(), np.arange(len(values)) != i
    gradient = base.gradient + base.curvature @ (values - base.fit.values)
    moved[rest] += solve_bounded_step(
        base.curvature[rest][:, rest],
        gradient[rest],
        (low - values)[rest],
        (high - values)[rest],
        scale[rest],
    )
    return moved


def fit_smoothed(fit: Fit) -> Fit:
    """Continue a fit by Gauss-Newton steps over a smoothed cost.

    After an impact readings jump at any change of the values, by as much at a small as
    at a large one. A slope over a small change shows that jump: too steep, in every
    direction. So slopes are differences over a whole scale, and residuals are means
    over perturbed initial states (randomized smoothing, Duchi et al. 2012). Before each
    step, initial states are estimated again, for those of other values hold these.

    Returns:
        The fit of the problem with initial states of the last values. Its Jacobian is
        that of the last step.
    """
    problem, terms, values, jacobian = fit.problem, fit.terms, fit.values, fit.jacobian
    if not len(values):
        return fit
    points = len(values) + 2 + len(FIT.smoothed_step_shares)
    effort = _simulation_effort(problem) * FIT.smoothed_samples * points
    is_slow = effort >= FIT.smoothed_effort
    samples = FIT.smoothed_samples_if_slow if is_slow else FIT.smoothed_samples
    affordable = FIT.smoothed_effort // effort
    for i in range(max(1, int(min(FIT.smoothed_iterations, affordable)))):
        marginalized = marginalize_initial_states(problem, terms, values)
        offsets = marginalized.draw_antithetic_offsets(
            samples, np.random.default_rng(i)
        )
        values, jacobian = marginalized.simulator.load_or_compute(
            partial(_take_smoothed_step, marginalized, terms, values, offsets)
        )
        problem = marginalized
    marginalized = marginalize_initial_states(problem, terms, values)
    return Fit(
        marginalized,
        terms,
        values,
        marginalized.residuals_at(terms, values),
        problem.transfer_jacobian(marginalized, jacobian),
    )


def _simulation_effort(problem: Problem) -> int:
    """[simulation steps times degrees of freedom] of one simulation of all segments."""
    return int(problem.segments.lengths.sum()) * problem.simulator.compiler.nominal.nv


def _scale_one_value(
    terms: Sequence[Term], values: Floats, i: np.integer, multiples: Sequence[float]
) -> Floats:
    """Values (P), and n multiples of one within its bounds: (1 + n, P)."""
    low, high, _ = stack_bounds(terms)
    points = np.tile(values, (1 + len(multiples), 1))
    points[1:, i] = np.clip(values[i] * np.array(multiples), low[i], high[i])
    return points


def _choose_likeliest(
    problem: Problem, points: Floats, residuals: Iterable[Floats]
) -> Floats:
    """The likeliest of some points if each segment has a noise variance of its own.

    With n_w readings and cost c_w in segment w, sum log(n_w + c_w) is minimized. That
    is a normal likelihood, each variance at its maximum, of equally many readings in
    all segments, but for n_w, which keeps an exact fit from deciding. One segment in
    which a body falls on another side cannot outweigh all others then.

    Args:
        points: (n, P) [units of the parameters], with n residuals (R).
    """
    count = problem.sum_by_segment(np.ones(len(problem.segment_of_residual)))
    costs = [np.log(count + problem.sum_by_segment(r**2)).sum() for r in residuals]
    return points[int(np.argmin(costs))]


def _take_smoothed_step(
    problem: Problem, terms: tuple[Term, ...], values: Floats, offsets: Floats
) -> Arrays:
    """One Gauss-Newton step over the smoothed cost.

    Args:
        problem: with initial states estimated at the values.
        values: (P) [units of the parameters].
        offsets: (k, W, 2 nv) perturbations of the initial states [rad or m, and per s].

    Returns:
        Values (P) after the best share of the step, or those before it; and the
        Jacobian (R, P) at the latter.
    """
    low, high, scale = stack_bounds(terms)

    def simulate(points: Floats) -> Floats:
        """(n, k, R) residuals at points (n, P)."""
        rows = np.repeat(points, len(offsets), axis=0)
        residuals = problem.compute_residuals(
            terms, rows, np.tile(offsets, (len(points), 1, 1))
        )
        return residuals.reshape(len(points), len(offsets), -1)

    residuals = simulate(values[None])[0].mean(axis=0)
    moves = np.where(values + scale > high, -scale, scale)
    moved = [simulate(x[None])[0].mean(axis=0) for x in values + np.diag(moves)]
    jacobian = (np.array(moved) - residuals).T / moves
    base = LinearizedFit.from_fit(Fit(problem, terms, values, residuals, jacobian))
    step = base.minimize()
    shares = np.append(0.0, FIT.smoothed_step_shares)[:, None]
    points = np.clip(values + shares * step, low, high)
    prior_penalties = ((points - 1) ** 2) @ base.prior
    costs = (simulate(points) ** 2).sum(axis=2).mean(axis=1) + prior_penalties
    return points[int(np.argmin(costs))], jacobian
