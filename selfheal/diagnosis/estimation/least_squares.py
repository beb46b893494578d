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

from collections.abc import Sequence
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


def fit_parameters(
    problem: Problem,
    terms: Sequence[Term],
    start: Floats,
    *,
    iterations: int = FIT.iterations,
    jacobian: Floats | None = None,
) -> Fit:
    """Fit the values of terms by damped Gauss-Newton iterations within bounds.

    Args:
        terms: effects beside the given model, P parameters in all.
        start: (P) values to begin with [units of the parameters].
        iterations: of them, at most.
        jacobian: (R, P) a Jacobian near the start; None: by differences.
    """
    solver = _GaussNewton(problem, tuple(terms), only_updates=False)
    return solver.fit(start, iterations, jacobian)


def fit_by_updates(
    problem: Problem,
    terms: Sequence[Term],
    start: Floats,
    iterations: int,
    jacobian: Floats,
) -> Fit:
    """A fit whose Jacobian (R, P) is only updated, which costs next to nothing.

    Args:
        start: (P) values to begin with [units of the parameters].
        iterations: of them, at most.
    """
    solver = _GaussNewton(problem, tuple(terms), only_updates=True)
    return solver.fit(start, iterations, jacobian)


def fit_one_more(fit: Fit, term: Term, start: Floats, iterations: int) -> Fit:
    """A fit with one more term, whose own columns of the Jacobian alone are computed.

    Args:
        start: (p) values of it to begin with [units of its parameters].
        iterations: at most, of all values.
    """
    problem, terms = fit.problem, (*fit.terms, term)
    values, count = np.append(fit.values, start), len(fit.values)
    residuals = problem.residuals_at(terms, values)
    own = compute_jacobian(problem, terms, values, residuals, count)
    jacobian = np.hstack([fit.jacobian, own])
    jacobian[:, find_overridden(term, fit.terms)] = 0.0
    return fit_by_updates(problem, terms, values, iterations, jacobian)


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


@dataclass(frozen=True, eq=False)
class _GaussNewton:
    """Fits the values of some terms; `only_updates`: no Jacobian is differenced."""

    problem: Problem
    terms: tuple[Term, ...]
    only_updates: bool

    def fit(self, start: Floats, iterations: int, jacobian: Floats | None) -> Fit:
        """The fit from a start (P), by the checkpoint if it is there."""
        run = partial(self._run, start, iterations, jacobian)
        values, residuals, last = self.problem.simulator.load_or_compute(run)
        return Fit(self.problem, self.terms, values, residuals, last)

    def _run(self, start: Floats, iterations: int, jacobian: Floats | None) -> Arrays:
        """Values, residuals and Jacobian of a fit; arguments as of `fit_parameters`.

        Each iteration proposes damped steps from the linearization and simulates them.
        The best one is accepted, and the Jacobian there updated or differenced. An
        update costs next to nothing and counts as half an iteration. The Jacobian is
        also differenced where steps from one that was updated or given save little, in
        contact once they saved a tenth, and at the end. The iterations stop where they
        save little, or no step saves anything.
        """
        low, high, _ = stack_bounds(self.terms)
        x = np.clip(np.asarray(start, float), low, high)
        r = self.problem.residuals_at(self.terms, x)
        if jacobian is None:
            now = self._linearize(x, r)
        else:
            now = _Iterate(x, r, jacobian, is_stale=True)
        left = float(iterations if len(x) else 0)
        begun = penalized_cost(self.terms, now.values, now.residuals)
        while left > 0:
            cost = penalized_cost(self.terms, now.values, now.residuals)
            trial = self._search_step(now, cost)
            least = self.problem.regime.min_relinearized_gain
            is_as_rough = cost > (1 - least) * begun
            if trial is None and (self.only_updates or not now.is_stale or is_as_rough):
                break
            if trial is None:
                now, begun = self._linearize(now.values, now.residuals), cost
                left -= 1
                continue
            lower, x, r = trial
            gain = cost - lower
            is_short = self.only_updates or gain < FIT.broyden_gain * cost
            now = self._accept(now, x, r, is_short)
            left -= 0.5 if now.is_coarse else 1
            if gain < FIT.min_iteration_gain * cost:
                if not now.is_coarse:
                    break
                now = self._linearize(now.values, now.residuals)
        if now.is_coarse:
            now = self._linearize(now.values, now.residuals)
        return now.values, now.residuals, now.jacobian

    def _linearize(self, values: Floats, residuals: Floats) -> _Iterate:
        """The iterate at values (P) with a Jacobian of differences."""
        jacobian = compute_jacobian(self.problem, self.terms, values, residuals)
        return _Iterate(values, residuals, jacobian, is_stale=False)

    def _search_step(
        self, now: _Iterate, cost: float
    ) -> tuple[float, Floats, Floats] | None:
        """Try the least damped step, and all others if it gains too little.

        "Too little" is by the gain ratio: the fall of the cost over the predicted one.
        The other dampings are one batch, where Marquardt tries one after the other.

        Args:
            cost: at the iterate, with the prior [1].

        Returns:
            The lowest cost, values (P) and residuals (R) there; None: no step lowers
            the cost.
        """
        prior = prior_precision(self.terms)
        model = QuadraticModel.linearize(
            self.terms, now.values, now.residuals, now.jacobian
        )
        best, lowest = None, cost
        for dampings in FIT.dampings[:1], FIT.dampings[1:]:
            steps = [model.solve(damping) for damping in dampings]
            predicted = min(float(cost + model.predict_change(s)) for s in steps)
            points = now.values + np.array(steps)
            residuals = self.problem.compute_residuals(self.terms, points)
            penalties = (prior * (points - 1) ** 2).sum(axis=1)
            for x, r, penalty in zip(points, residuals, penalties, strict=True):
                if (after := float(r @ r + penalty)) < lowest:
                    best, lowest = (after, x, r), after
            if cost - lowest > FIT.min_gain_ratio * (cost - predicted):
                break
        return best

    def _accept(self, old: _Iterate, x: Floats, r: Floats, is_short: bool) -> _Iterate:
        """The iterate at values (P), its Jacobian updated or differenced.

        Where the step was short, or the linear prediction good, Broyden's update does.
        It also does for further steps where the prediction was wrong by little of what
        the step gained. In contact it does for nominal values, which are most of the
        columns; those of effects, which are most of the error, are differenced.

        Args:
            r: (R) residuals there.
            is_short: whether the step gained little.
        """
        _, _, scale = stack_bounds(self.terms)
        step, change = x - old.values, r - old.residuals
        error = change - old.jacobian @ step
        update = partial(update_broyden, old.jacobian, step, change, scale)
        if is_short or error @ error < FIT.broyden_error * (r @ r):
            return _Iterate(x, r, update(), old.is_stale, old.is_coarse)
        if not self.problem.regime.is_nonsmooth:
            gain = old.residuals @ old.residuals - r @ r
            if error @ error < FIT.secant_error * gain:
                return _Iterate(x, r, update(), is_stale=True, is_coarse=True)
            return self._linearize(x, r)
        count = int(np.count_nonzero(prior_precision(self.terms)))
        updated = update()[:, :count]
        differenced = compute_jacobian(self.problem, self.terms, x, r, count)
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
