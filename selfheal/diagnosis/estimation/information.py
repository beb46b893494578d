"""What recordings tell of parameters: takes a fit, gives Gram matrices of its slopes.

From them follow intervals, what cannot be distinguished, and what further motions
would add, without any simulation.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from .fit import Fit
from .problem import list_block_rows
from .quadratic_model import prior_precision

MAX_VARIANCE_INFLATION = 10.0  # from which on a value is confounded (Marquardt 1970)
MIN_CORRELATION = 0.5  # of two values that are known together; a quarter of a variance
UNTOLD_SHARE = 0.5  # of a prior variance that is left where readings tell little


@dataclass(frozen=True, eq=False)
class Information:
    """Gram matrices of a fit's slopes, by block of neighboring segments.

    Attributes:
        parameters: (P) names, "joint:knee/damping".
        values: (P) fitted [units of the parameters; of stated values a factor].
        prior: (P) precision of each value's prior [1 / unit^2]; 0 of effects.
        gram: (B, P, P) J'J of the residuals' slopes J in each block [1 / unit^2].
        gradient: (B, P) J'r of the residuals r in each block [1 / unit].
        variance: of the residuals [1].
    """

    parameters: tuple[str, ...]
    values: Floats
    prior: Floats
    gram: Floats
    gradient: Floats
    variance: float

    @classmethod
    def build(cls, fit: Fit) -> "Information":
        """That of a fit, with a Jacobian near its values."""
        parts = list_block_rows(fit.problem)
        slopes = [(fit.jacobian[rows], fit.residuals[rows]) for rows in parts]
        return cls(
            tuple(_name_parameters(fit.terms)),
            fit.values,
            prior_precision(fit.terms),
            np.array([j.T @ j for j, _ in slopes]),
            np.array([j.T @ r for j, r in slopes]),
            fit.cost / max(len(fit.residuals) - len(fit.values), 1),
        )

    def find_confounded(self) -> list[tuple[str, ...]]:
        """Parameters that the recordings tell only together, in groups.

        Each would be known well if the others were: beside them its variance is ten
        times as large (Marquardt 1970). Of a stated value half of the prior's is left.
        """
        from scipy.sparse.csgraph import connected_components

        known = self.gram.sum(axis=0) / max(self.variance, np.finfo(float).tiny)
        precision = known + np.diag(self.prior)
        size = np.sqrt(np.diag(precision))
        shown = np.flatnonzero(np.diag(known) > 0)
        scaled = precision[np.ix_(shown, shown)] / np.outer(size[shown], size[shown])
        covariance = np.linalg.pinv(scaled, hermitian=True)
        inflation = np.diag(covariance)
        left = self.prior[shown] * inflation / size[shown] ** 2
        is_open = (inflation > MAX_VARIANCE_INFLATION) & (
            (left > UNTOLD_SHARE) | (self.prior[shown] == 0)
        )
        chosen = np.flatnonzero(is_open)
        root = np.sqrt(inflation[chosen])
        correlation = covariance[np.ix_(chosen, chosen)] / np.outer(root, root)
        is_linked = np.abs(correlation) > MIN_CORRELATION
        count, label = connected_components(is_linked, directed=False)
        groups = [shown[chosen[label == k]] for k in range(count)]
        return [tuple(self.parameters[i] for i in g) for g in groups if len(g) > 1]


def _name_parameters(terms: tuple[Term, ...]) -> Iterator[str]:
    """Names of the parameters of terms, one at several places by the first of them."""
    for term in terms:
        for p in term.parameters:
            own = "" if term.effect.name == "stated" else f"/{p.name}"
            yield term.targets[0] + own
