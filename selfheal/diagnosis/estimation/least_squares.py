"""Nonlinear least squares: takes a problem and terms, gives fits of their values.

With residuals r(x) in standard deviations, whose covariance is the unit matrix, and a
normal prior of mean 1 and precision Lambda (diagonal), a fit minimizes

    cost(x) = r(x)'r(x) + (x - 1)' Lambda (x - 1),   low <= x <= high,

which is twice the negative logarithm of the posterior density, up to a constant. An
iteration of Gauss-Newton linearizes r with the Jacobian J and solves

    (J'J + Lambda + D) step = -(J'r + Lambda (x - 1)),

where D damps the step (Levenberg 1944, Marquardt 1963). See Nocedal and Wright 2006,
chapter 10.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.terms import find_overridden
from ..simulation.checkpoint import Arrays
from .fit import Fit
from .jacobian import compute_jacobian
from .problem import Problem
from .quadratic_model import (
    QuadraticModel,
    penalized_cost,
    prior_precision,
    stack_bounds,
    update_broyden,
)
from .settings import FIT


@dataclass(frozen=True, eq=False)
class Trial:
    """A point that a step leads to, simulated.

    Attributes:
        point: (P) values there [units of the parameters].
        cost: there.
        residuals: (R) there [standard deviations].
    """

    point: Floats
    cost: float
    residuals: Floats


def search_dampings(
    cost: float,
    propose: Callable[[float], tuple[float, Floats]],
    evaluate: Callable[[Floats], Sequence[Trial]],
) -> Trial | None:
    """Try the least damped step, and all others if it gains too little.

    "Too little" is by the gain ratio: the fall of the cost over the predicted one. The
    other dampings are one batch, where Marquardt tries one after the other.

    Args:
        propose: gives the predicted cost and the point (P) of a damping.
        evaluate: simulates points (n, P).

    Returns:
        The trial of the lowest cost; None: no step lowers the cost.
    """
    best, lowest = None, cost
    for dampings in FIT.dampings[:1], FIT.dampings[1:]:
        predicted, points = zip(*map(propose, dampings), strict=True)
        predicted_gain = cost - min(predicted)
        for trial in evaluate(np.array(points)):
            if trial.cost < lowest:
                best, lowest = trial, trial.cost
        if cost - lowest > FIT.min_gain_ratio * predicted_gain:
            break
    return best


def fit_parameters(
    problem: Problem,
    terms: Sequence[Term],
    start: Floats,
    *,
    iterations: int = FIT.iterations,
    jacobian: Floats | None = None,
    only_updates: bool = False,
) -> Fit:
    """Fit the values of terms by damped Gauss-Newton iterations within bounds.

    Args:
        terms: effects beside the given model, P parameters in all.
        start: (P) values to begin with [units of the parameters].
        iterations: of them, at most.
        jacobian: (R, P) a Jacobian near the start; None: by differences.
        only_updates: whether that Jacobian is only updated, which costs next to
            nothing.
    """
    terms = tuple(terms)
    compute = partial(
        _run_gauss_newton, problem, terms, start, iterations, jacobian, only_updates
    )
    values, residuals, last = problem.simulator.load_or_compute(compute)
    return Fit(problem, terms, values, residuals, last)


def fit_one_more(fit: Fit, term: Term, start: Floats, iterations: int) -> Fit:
    """A fit with one more term, whose own columns of the Jacobian alone are computed.

    Args:
        start: (p) values of it to begin with [units of its parameters].
        iterations: at most, of all values.
    """
    terms, values = (*fit.terms, term), np.append(fit.values, start)
    residuals = fit.problem.residuals_at(terms, values)
    count = len(fit.values)
    own = compute_jacobian(fit.problem, terms, values, residuals, count)
    jacobian = np.hstack([fit.jacobian, own])
    jacobian[:, find_overridden(term, fit.terms)] = 0.0
    return fit_parameters(
        fit.problem,
        terms,
        values,
        iterations=iterations,
        jacobian=jacobian,
        only_updates=True,
    )


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Where an iteration begins: values (P), residuals (R) and Jacobian (R, P).

    `is_stale` says whether differences at the values may give another Jacobian;
    `is_coarse` whether it serves for further steps only.
    """

    values: Floats
    residuals: Floats
    jacobian: Floats
    is_stale: bool
    is_coarse: bool = False


def _run_gauss_newton(
    problem: Problem,
    terms: tuple[Term, ...],
    start: Floats,
    iterations: int,
    jacobian: Floats | None,
    only_updates: bool,
) -> Arrays:
    """Values, residuals and Jacobian of a fit; arguments as of `fit_parameters`.

    Each iteration proposes damped steps from the linearization and simulates them. The
    best one is accepted, and the Jacobian there updated or differenced. An update costs
    next to nothing and counts as half an iteration. The Jacobian is also differenced
    where steps from one that was updated or given save little, in contact once they
    saved a tenth, and at the end. The iterations stop where they save little, or no
    step saves anything.
    """
    low, high, _ = stack_bounds(terms)
    x = np.clip(np.asarray(start, float), low, high)
    r = problem.residuals_at(terms, x)
    if jacobian is None:
        now = _linearize(problem, terms, x, r)
    else:
        now = _Iterate(x, r, jacobian, is_stale=True)
    left = float(iterations if len(x) else 0)
    begun = penalized_cost(terms, now.values, now.residuals)
    while left > 0:
        cost = penalized_cost(terms, now.values, now.residuals)
        trial = _search_step(problem, terms, now, cost)
        is_as_rough = cost > (1 - problem.regime.min_relinearized_gain) * begun
        if trial is None and (only_updates or not now.is_stale or is_as_rough):
            break
        if trial is None:
            now, begun = _linearize(problem, terms, now.values, now.residuals), cost
            left -= 1
            continue
        gain = cost - trial.cost
        is_short = only_updates or gain < FIT.broyden_gain * cost
        now = _accept(problem, terms, now, trial, is_short)
        left -= 0.5 if now.is_coarse else 1
        if gain < FIT.min_iteration_gain * cost:
            if not now.is_coarse:
                break
            now = _linearize(problem, terms, now.values, now.residuals)
    if now.is_coarse:
        now = _linearize(problem, terms, now.values, now.residuals)
    return now.values, now.residuals, now.jacobian


def _linearize(
    problem: Problem, terms: Sequence[Term], values: Floats, residuals: Floats
) -> _Iterate:
    """The iterate with a Jacobian of differences.

    Args:
        values: (P) [units of the parameters].
        residuals: (R) at the values [standard deviations].
    """
    jacobian = compute_jacobian(problem, terms, values, residuals)
    return _Iterate(values, residuals, jacobian, is_stale=False)


def _search_step(
    problem: Problem, terms: Sequence[Term], now: _Iterate, cost: float
) -> Trial | None:
    """The best of the damped steps from an iterate; None: no step lowers the cost.

    Args:
        cost: there, with the prior [1].
    """
    model = QuadraticModel.linearize(terms, now.values, now.residuals, now.jacobian)
    prior = prior_precision(terms)

    def propose(damping: float) -> tuple[float, Floats]:
        """Predicted cost and point (P) of a damping."""
        step = model.solve(damping)
        return float(cost + model.predict_change(step)), now.values + step

    def evaluate(points: Floats) -> list[Trial]:
        """Trials at points (n, P)."""
        residuals = problem.compute_residuals(terms, points)
        penalties = (prior * (points - 1) ** 2).sum(axis=1)
        return [
            Trial(x, float(r @ r + penalty), r)
            for x, r, penalty in zip(points, residuals, penalties, strict=True)
        ]

    return search_dampings(cost, propose, evaluate)


def _accept(
    problem: Problem,
    terms: Sequence[Term],
    old: _Iterate,
    trial: Trial,
    is_short: bool,
) -> _Iterate:
    """The iterate at a trial, its Jacobian updated or differenced.

    Where the step was short, or the linear prediction good, Broyden's update does. It
    also does for further steps where the prediction was wrong by little of what the
    step gained. In contact it does for nominal values, which are most of the columns;
    those of effects, which are most of the error, are differenced.

    Args:
        is_short: whether the step gained little.
    """
    x, r = trial.point, trial.residuals
    _, _, scale = stack_bounds(terms)
    step, change = x - old.values, r - old.residuals
    error = change - old.jacobian @ step
    update = partial(update_broyden, old.jacobian, step, change, scale)
    if is_short or error @ error < FIT.broyden_error * (r @ r):
        return _Iterate(x, r, update(), old.is_stale, old.is_coarse)
    if not problem.regime.is_nonsmooth:
        gain = old.residuals @ old.residuals - r @ r
        if error @ error < FIT.secant_error * gain:
            return _Iterate(x, r, update(), is_stale=True, is_coarse=True)
        return _linearize(problem, terms, x, r)
    count = int(np.count_nonzero(prior_precision(terms)))
    updated = update()[:, :count]
    differenced = compute_jacobian(problem, terms, x, r, count)
    return _Iterate(x, r, np.hstack([updated, differenced]), is_stale=True)


def refine_undamped(fit: Fit) -> Fit:
    """Refine a fit by undamped Gauss-Newton steps with fine Jacobians.

    Readings without a torque leave all masses, gains and frictions free together, up to
    one factor. Their cost is a curved valley along which damped steps hardly move.
    Undamped steps follow it, over a rise of the cost if need be. Fine differences tell
    how flat the valley is, and so how far the prior moves the values along it.

    Returns:
        The fit of the lowest cost, with a fine Jacobian.
    """
    problem, terms, x, r = fit.problem, fit.terms, fit.values, fit.residuals
    best, lowest = fit, np.inf
    for i in range(FIT.undamped_iterations + 1):
        step_size = FIT.fine_difference_step
        jacobian = compute_jacobian(problem, terms, x, r, difference_step=step_size)
        cost = penalized_cost(terms, x, r)
        if cost < lowest:
            best, lowest = Fit(problem, terms, x, r, jacobian, True), cost
        model = QuadraticModel.linearize(terms, x, r, jacobian)
        step = model.solve()
        predicted_gain = -model.predict_change(step)
        if i == FIT.undamped_iterations or predicted_gain < FIT.undamped_min_gain:
            break
        x = x + step
        r = problem.residuals_at(terms, x)
    return best


def refine_jacobian(fit: Fit) -> Fit:
    """The fit with a fine Jacobian, as its standard errors need it.

    Over the difference steps of a search, readings of long segments bend. Along a
    valley large slopes cancel, and what that leaves of them would pass for information.
    In contact fine differences would show the roughness alone: the Jacobian stays.
    """
    if fit.problem.regime.is_nonsmooth or fit.has_fine_jacobian:
        return fit
    jacobian = compute_jacobian(
        fit.problem,
        fit.terms,
        fit.values,
        fit.residuals,
        difference_step=FIT.fine_difference_step,
    )
    return replace(fit, jacobian=jacobian, has_fine_jacobian=True)
