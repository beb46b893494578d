"""Fits: a problem, values of parameters that fit it, and the linearization there.

All that is said of a fit's residuals is said in the problem that they are of.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.terms import list_restated_columns
from ..simulation.model_variants import split_values
from .problem import Problem
from .quadratic_model import prior_precision


@dataclass(frozen=True, eq=False)
class Fit:
    """Values of parameters that fit a problem, and the linearization there.

    Attributes:
        problem: that was fitted, whose residuals they are.
        terms: that were fitted.
        values: (P) [units of the parameters] of all terms in a row.
        residuals: (R) [standard deviations] at the values.
        jacobian: (R, P) [1 per unit of the parameter] of the residuals, at the values
            or near them.
        has_fine_jacobian: whether the Jacobian is differenced at the values, and as
            finely as standard errors need it.
    """

    problem: Problem
    terms: tuple[Term, ...]
    values: Floats
    residuals: Floats
    jacobian: Floats
    has_fine_jacobian: bool = False

    def __post_init__(self) -> None:
        """Refuse residuals and a Jacobian of another problem."""
        wanted = self.problem.segments.readings.size, len(self.values)
        shapes = self.residuals.shape, self.jacobian.shape
        if shapes != (wanted[:1], wanted):
            raise ValueError(f"residuals and Jacobian {shapes} in a problem {wanted}")

    @property
    def cost(self) -> float:
        """Sum of squared residuals [1], without the prior."""
        return float(self.residuals @ self.residuals)

    @property
    def prior_penalty(self) -> float:
        """(x - 1)' Lambda (x - 1) [variances]: how far values are from their prior."""
        return float(prior_precision(self.terms) @ (self.values - 1) ** 2)

    @property
    def values_by_term(self) -> dict[Term, Floats]:
        """Values (p) of each term [units of its parameters]."""
        split = split_values(self.terms, self.values)
        return dict(zip(self.terms, split, strict=True))

    def timestep_error(self) -> Floats:
        """(R) error of the residuals by the time step, by Richardson (1911).

        Halving the step of a first-order integrator halves its error, so that the error
        is 2 (r(h) - r(h / 2)) [standard deviations]. After an impact both are as wrong.
        """
        finer = self.problem.with_half_step.residuals_at(self.terms, self.values)
        return 2 * (self.residuals - finer)

    def clock_error(self) -> Floats:
        """(R) change [standard deviations] if commands act part of a step later."""
        later = self.problem.with_late_commands.residuals_at(self.terms, self.values)
        return later - self.residuals

    def transfer_jacobian(self, other: Problem) -> Floats:
        """(R, P) the Jacobian in another problem of the same segments."""
        return self.problem.transfer_jacobian(other, self.jacobian)

    def without_terms(self, *removed: Term) -> tuple[tuple[Term, ...], Floats]:
        """The terms without some, and their values (P) [units of the parameters]."""
        kept = tuple(t for t in self.terms if t not in removed)
        return kept, self.values[self._find_kept_columns(removed)]

    def jacobian_without(self, *removed: Term) -> Floats:
        """(R, P) the Jacobian without the columns of some terms."""
        return self.jacobian[:, self._find_kept_columns(removed)]

    @cached_property
    def restated_columns(self) -> dict[Term, list[tuple[int, int, float]]]:
        """As `list_restated_columns` has them."""
        return list_restated_columns(self.terms)

    def restore(self, removed: Sequence[Term]) -> "Fit":
        """The fit in which stated values answer that some terms stated anew.

        With y = nominal x, a column of the factor x is nominal times that of y.
        """
        known = self.restated_columns
        restated = [each for term in removed for each in known.get(term, ())]
        if not restated:
            return self
        jacobian = self.jacobian.copy()
        for own, stated, nominal in restated:
            jacobian[:, stated] = nominal * jacobian[:, own]
        return replace(self, jacobian=jacobian)

    def _find_kept_columns(self, removed: Sequence[Term]) -> np.ndarray:
        """(P) whether each parameter stays without some terms."""
        is_kept = [t not in removed for t in self.terms for _ in t.parameters]
        return np.array(is_kept, bool)
