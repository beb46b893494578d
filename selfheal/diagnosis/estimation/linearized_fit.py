"""A fit and its linearization: what a step, or a removal, would change to first order.

The quadratic model of the cost near a fit, with the Jacobian as fitted.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from .fit import Fit
from .problem import Problem
from .quadratic_model import (
    QuadraticModel,
    prior_precision,
    solve_bounded_step,
    stack_bounds,
)
from .settings import FIT


@dataclass(frozen=True, eq=False)
class LinearizedFit:
    """A fit and the quadratic model of its cost, beside which other terms are tried.

    Attributes:
        fit: of P values.
        prior: (P) diagonal of Lambda, the prior's precision.
        curvature: (P, P) J'J + Lambda.
    """

    fit: Fit
    prior: Floats
    curvature: Floats

    @classmethod
    def from_fit(cls, fit: Fit) -> "LinearizedFit":
        """Linearize a fit by its Jacobian."""
        prior = prior_precision(fit.terms)
        curvature = fit.jacobian.T @ fit.jacobian + np.diag(prior)
        return cls(fit, prior, curvature)

    @property
    def problem(self) -> Problem:
        """The problem that was fitted."""
        return self.fit.problem

    def select(self, chosen: np.ndarray) -> "LinearizedFit":
        """The fit in segments `chosen` (w), with its values as they are."""
        segments, fit = self.problem.segments, self.fit
        width = segments.readings.shape[1]
        rows = segments.find_sample_rows(chosen)[:, None] * width + np.arange(width)
        residuals, jacobian = fit.residuals[rows.ravel()], fit.jacobian[rows.ravel()]
        part = self.problem.select(chosen)
        return LinearizedFit.from_fit(
            Fit(part, fit.terms, fit.values, residuals, jacobian)
        )

    @cached_property
    def gradient(self) -> Floats:
        """(P) J'r + Lambda (x - 1): half the gradient of the penalized cost."""
        fit = self.fit
        return fit.jacobian.T @ fit.residuals + self.prior * (fit.values - 1)

    def drop_residuals(self, rows: np.ndarray) -> tuple[float, Floats]:
        """Predict the fit without some residuals, by one Gauss-Newton step.

        Their share of the curvature and of the gradient is subtracted (downdating).

        Args:
            rows: (R) whether each residual is dropped.

        Returns:
            By how much the cost of the other residuals falls [1], and the step (P)
            [units of the parameters].
        """
        low, high, scale = stack_bounds(self.fit.terms)
        values, jacobian = self.fit.values, self.fit.jacobian[rows]
        model = QuadraticModel(
            self.curvature - jacobian.T @ jacobian,
            self.gradient - jacobian.T @ self.fit.residuals[rows],
            low - values,
            high - values,
            scale,
        )
        step = model.solve()
        return -model.predict_change(step), step

    def move(self, held: np.ndarray, change: Floats) -> Floats:
        """The step (P) of all values where some are changed and the others refitted.

        To first order, and within the bounds of the others.

        Args:
            held: (n) numbers of the changed parameters, which have no prior.
            change: (n) of them [units of the parameters].
        """
        free = np.setdiff1d(np.arange(len(self.fit.values)), held)
        step = np.zeros(len(self.fit.values))
        step[held] = change
        gradient = self.gradient + self.curvature[:, held] @ change
        step[free] = self._solve(gradient, free)
        return step

    def estimate_gain(self, residuals: Floats) -> float:
        """By how much changes that make other residuals (n, R) can lower the cost.

        To first order in their sizes, with all values of the fit at their best: a score
        test (Rao 1948). With D the changes as unit vectors, H = J'J + Lambda and g the
        gradient,

            gain = s' (D'D - D'J H^-1 J'D)^+ s,   s = D'r - D'J H^-1 g.
        """
        changes = (residuals - self.fit.residuals).T
        changes = changes / np.maximum(np.linalg.norm(changes, axis=0), FIT.tiny)
        cross = self.fit.jacobian.T @ changes
        solved = self._inverse_curvature @ cross
        score = changes.T @ self.fit.residuals - solved.T @ self.gradient
        rest = changes.T @ changes - cross.T @ solved
        own = np.linalg.pinv(rest, rcond=FIT.min_column_share, hermitian=True)
        return float(score @ own @ score)

    @cached_property
    def _inverse_curvature(self) -> Floats:
        """(P, P) pseudoinverse of the curvature, in units of each value's curvature."""
        size = np.sqrt(np.maximum(np.diagonal(self.curvature), FIT.tiny))
        scaled = self.curvature / size / size[:, None]
        rounding = len(size) * np.finfo(float).eps
        inverse = np.linalg.pinv(scaled, rcond=rounding, hermitian=True)
        return np.asarray(inverse / size / size[:, None])

    def step_without(self, term: Term) -> Floats:
        """The step (P) of all values to the fit without a term, to first order.

        Its own go to nominal ones, or to a bound where these are infinite. What it
        stated anew the model states again, within its bounds (`Fit.restore`).
        """
        fit, terms = self.fit, self.fit.terms
        low, high, _ = stack_bounds(terms)
        nominal = np.array([p.nominal for t in terms for p in t.parameters], float)
        change = np.clip(nominal, low, high) - fit.values
        held = np.flatnonzero([t == term for t in terms for _ in t.parameters])
        restated = fit.restated_columns.items()
        kept = [each for t, each in restated if t != term]
        idle = np.array([stated for each in kept for _, stated, _ in each], int)
        base = LinearizedFit.from_fit(fit.restore(terms)) if restated else self
        return base.move(
            np.append(held, idle), np.append(change[held], np.zeros(len(idle)))
        )

    def minimize(self) -> Floats:
        """The step (P) to the lowest penalized cost [units of the parameters]."""
        return self._solve(self.gradient, np.arange(len(self.fit.values)))

    def _solve(self, gradient: Floats, free: np.ndarray) -> Floats:
        """The step (n) of the parameters `free` (n) within their bounds."""
        low, high, scale = stack_bounds(self.fit.terms)
        values = self.fit.values
        return solve_bounded_step(
            self.curvature[np.ix_(free, free)],
            gradient[free],
            (low - values)[free],
            (high - values)[free],
            scale[free],
        )
