"""Quadratic model of a cost: takes a linearization, gives steps within bounds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from .settings import FIT


def stack_bounds(terms: Sequence[Term]) -> tuple[Floats, Floats, Floats]:
    """Lower bounds, upper bounds and scales, each (P) [units of the parameters]."""
    return tuple(
        np.concatenate([getattr(t, k) for t in terms] or [np.zeros(0)])
        for k in ("low", "high", "scale")
    )  # type: ignore[return-value]


def is_stated(terms: Sequence[Term]) -> np.ndarray:
    """(P) whether each parameter of some terms is a value that the model states."""
    return np.array(
        [t.effect.name == "stated" for t in terms for _ in t.parameters], bool
    )


def prior_precision(terms: Sequence[Term]) -> Floats:
    """(P) [1] diagonal of Lambda: the inverse variances of the prior.

    Factors of nominal values have mean 1; the range that the contract grants is
    `FIT.prior_stds_in_range` standard deviations wide. Readings that do not tell two
    values apart leave both near what the model states. Effects have no prior: 0.
    """
    low, high, _ = stack_bounds(terms)
    width = np.maximum(high - low, FIT.min_prior_range)
    return np.where(is_stated(terms), FIT.prior_stds_in_range**2 / width**2, 0.0)


def penalized_cost(terms: Sequence[Term], values: Floats, residuals: Floats) -> float:
    """The cost [1] with the prior, r'r + (x - 1)' Lambda (x - 1).

    Args:
        values: (P) [units of the parameters].
        residuals: (R) [standard deviations].
    """
    prior = prior_precision(terms) @ (values - 1) ** 2
    return float(residuals @ residuals + prior)


def solve_bounded_step(
    curvature: Floats,
    gradient: Floats,
    low: Floats,
    high: Floats,
    scale: Floats,
    damping: float = FIT.solver_damping,
) -> Floats:
    """The damped Gauss-Newton step within bounds.

    In units of the scales, it minimizes a quadratic form over u = step / scale,

        2 g'u + u'(H + D) u,   D = damping diag(H) + step_penalty I,

    where the minimum is beyond a bound by a dual active-set method (DAQP: Arnstrom,
    Bemporad, Axehill 2022) in units of each value's curvature. Damping by the diagonal
    is Marquardt's (1963).

    Args:
        curvature: (P, P) H, half the second derivative of the cost.
        gradient: (P) g, half the gradient of the cost.
        low: (P) lower bound of the step.
        high: (P) upper bound of the step.
        scale: (P) of the parameters.
        damping: share of the diagonal [1].

    Returns:
        (P) step [units of the parameters].
    """
    import daqp

    if not len(gradient):
        return gradient
    h = curvature * np.outer(scale, scale)
    g = gradient * scale
    diagonal = np.diag(h)
    least = FIT.solver_damping * max(diagonal.max(), FIT.min_curvature)
    h = h + np.diag(damping * diagonal + least + FIT.step_penalty)
    step = np.linalg.solve(h, -g)
    a, b = np.minimum(low / scale, 0), np.maximum(high / scale, 0)
    if (step < a).any() or (step > b).any():
        size = np.sqrt(np.diag(h))
        h, no_others = h / np.outer(size, size), np.zeros((0, len(g)))
        step = daqp.solve(h, g / size, no_others, b * size, a * size)[0] / size
    return np.clip(step, a, b) * scale


@dataclass(frozen=True, eq=False)
class QuadraticModel:
    """Gauss-Newton's quadratic model of a cost near some values.

        cost(x + step) = cost(x) + 2 g'step + step'H step,
        g = J'r + Lambda (x - 1),   H = J'J + Lambda

    Attributes:
        curvature: (P, P) H.
        gradient: (P) g.
        low: (P) lower bound of a step [units of the parameters].
        high: (P) its upper bound.
        scale: (P) of the parameters.
    """

    curvature: Floats
    gradient: Floats
    low: Floats
    high: Floats
    scale: Floats

    @classmethod
    def linearize(
        cls, terms: Sequence[Term], values: Floats, residuals: Floats, jacobian: Floats
    ) -> "QuadraticModel":
        """The model of the penalized cost of some terms.

        Args:
            values: (P) x [units of the parameters].
            residuals: (R) r at the values [standard deviations].
            jacobian: (R, P) J.
        """
        low, high, scale = stack_bounds(terms)
        prior = prior_precision(terms)
        return cls(
            jacobian.T @ jacobian + np.diag(prior),
            jacobian.T @ residuals + prior * (values - 1),
            low - values,
            high - values,
            scale,
        )

    def solve(self, damping: float = FIT.solver_damping) -> Floats:
        """Step (P) with a damping [1] within the bounds [units of the parameters]."""
        return solve_bounded_step(
            self.curvature, self.gradient, self.low, self.high, self.scale, damping
        )

    def predict_change(self, step: Floats) -> float:
        """Change of the cost [1] by a step (P) [units of the parameters]."""
        return float((2 * self.gradient + self.curvature @ step) @ step)


def update_broyden(
    jacobian: Floats, step: Floats, change: Floats, scale: Floats
) -> Floats:
    """Broyden's (1965) update of a Jacobian, with parameters in their scales.

        J + (change - J step) (step / scale^2)' / |step / scale|^2

    Args:
        jacobian: (R, P) before the step.
        step: (P) [units of the parameters].
        change: (R) of the residuals by the step.
        scale: (P) of the parameters.

    Returns:
        (R, P), of all matrices that predict the change the nearest one.
    """
    scaled = step / scale
    if not scaled.any():
        return jacobian
    error = change - jacobian @ step
    updated = np.outer(error, scaled / scale / (scaled @ scaled))
    updated += jacobian
    return updated
