"""Fits to equation errors: stated values, effects and nuisances, by Gauss-Newton."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.terms import list_restated_columns
from ..estimation.quadratic_model import (
    prior_precision,
    solve_bounded_step,
    stack_bounds,
)
from ..simulation.model_variants import split_values
from .errors import Direction, ErrorModel, Errors, differentiate
from .likelihood import Whitening

NUISANCE_BOUND = 1.0  # deviations; more than half a step is a finding
DAMPING = 1e-7  # share of the diagonal: what nothing tells stays where it is
DESCENT_ITERATIONS = 12
SHORTEST_STEP = 0.05
LEAST_GAIN = 0.1  # [nats] of an iteration; below any that counts
REFINEMENTS = 4  # Jacobians that a refinement makes anew, at most
INVERSE_RIDGE = 1e-9
FELT_SHARE = 1e-6  # of the errors; what a parameter changes less is rounding


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Stated values and effects fitted to equation errors.

    Attributes:
        model: of the errors.
        terms: stated ones first.
        stated: how many of them are.
        values: (P) [units of the parameters], and (K) of nuisances.
        errors: at the values, with nuisances.
        jacobian: (P + K, ...) derivatives of the errors, near the values.
    """

    model: ErrorModel
    terms: tuple[Term, ...]
    stated: int
    values: Floats
    errors: Errors
    jacobian: Errors

    @property
    def named(self) -> tuple[Term, ...]:
        """Terms of effects."""
        return self.terms[self.stated :]

    @property
    def count(self) -> int:
        """How many parameters the terms have."""
        return sum(len(t.parameters) for t in self.terms)

    @property
    def rows(self) -> int:
        """How many rows the errors have, at least 1."""
        return max(self.model.rows, 1)

    @property
    def slices(self) -> list[slice]:
        """Columns of each term."""
        ends = np.cumsum([0, *(len(t.parameters) for t in self.terms)])
        return [slice(a, b) for a, b in pairwise(ends)]

    @property
    def named_values(self) -> list[Floats]:
        """Values (p) of each effect [units of its parameters]."""
        return split_values(self.terms, self.values[: self.count])[self.stated :]

    @property
    def plain_errors(self) -> Errors:
        """Errors without the nuisances."""
        p = self.count
        change = self.values[p:] @ self.jacobian.values[p:]
        return replace(self.errors, values=self.errors.values - change)

    @cached_property
    def whitening(self) -> Whitening:
        """Of the errors."""
        return self.model.whiten(self.errors)

    @cached_property
    def cost(self) -> float:
        """Negative log-likelihood [nats] and prior, up to a constant."""
        precision, mean = self._prior
        prior = 0.5 * precision @ (self.values - mean) ** 2
        return self.whitening.loss + float(prior)

    @property
    def _prior(self) -> tuple[Floats, Floats]:
        """Precisions and means (P + K) of the normal prior."""
        count = len(self.values) - self.count
        return (
            np.append(prior_precision(self.terms), np.ones(count)),
            np.append(np.ones(self.count), np.zeros(count)),
        )

    @property
    def bounds(self) -> tuple[Floats, Floats, Floats]:
        """Lower and upper bounds and scales (P + K) of the values."""
        low, high, scale = stack_bounds(self.terms)
        bound = np.full(len(self.values) - self.count, NUISANCE_BOUND)
        return np.append(low, -bound), np.append(high, bound), np.append(scale, bound)

    @property
    def prior_model(self) -> tuple[Floats, Floats]:
        """Curvature (P + K, P + K) and gradient (P + K) of the prior and the volume.

        Those of minus the volume are as of the logarithm of a single inertia.
        """
        precision, mean = self._prior
        v = self.jacobian.volume
        h = np.diag(precision) + np.outer(v, v) / self.rows
        return h, precision * (self.values - mean) - v

    @cached_property
    def quadratic_model(self) -> tuple[Floats, Floats]:
        """Curvature (P + K, P + K) and gradient (P + K) of the cost."""
        j = self.whitening.apply(self.jacobian.values)
        e = (self.whitening.weights * self.whitening.errors).ravel()
        h, g = self.prior_model
        return h + j @ j.T, g + j @ e

    def restored(self, removed: Sequence[int]) -> "LinearFit":
        """The fit in which stated values answer that some terms stated anew.

        With y = nominal x, a column of the factor x is nominal times that of y
        (`estimation.fit.Fit.restore`).
        """
        known = list_restated_columns(self.terms)
        restated = [each for i in removed for each in known.get(self.terms[i], ())]
        if not restated:
            return self
        jacobian = Errors(self.jacobian.values.copy(), self.jacobian.volume.copy())
        values, (low, high, _) = self.values.copy(), self.bounds
        for own, at, nominal in restated:
            jacobian.values[at] = nominal * jacobian.values[own]
            jacobian.volume[at] = nominal * jacobian.volume[own]
            values[at] = np.clip(self.values[own] / nominal, low[at], high[at])
        return replace(self, jacobian=jacobian, values=values)

    def count_felt(self, i: int) -> int:
        """How many parameters of the i-th term change the errors."""
        a = self.slices[i]
        sizes = np.linalg.norm(self.jacobian.values[a], axis=1) * self.terms[i].scale
        return int((sizes > FELT_SHARE * np.linalg.norm(self.errors.values)).sum())

    def at(self, values: Floats, terms: Sequence[Term] | None = None) -> "LinearFit":
        """The fit at other values (P + K), perhaps of other terms."""
        terms = self.terms if terms is None else tuple(terms)
        p, old = sum(len(t.parameters) for t in terms), self.count
        found = self.model.compute_errors(terms, values[None, :p])
        nuisance = values[p:] @ self.jacobian.values[old:]
        errors = replace(found.first, values=found.values[0] + nuisance)
        return replace(self, terms=terms, values=values, errors=errors)

    def linearized(self) -> "LinearFit":
        """The fit with a Jacobian at its values."""
        p = self.count
        values, nuisance = self.values[:p], self.values[p:]
        new = _linearize(self.model, self.terms, values)
        change = nuisance @ new.jacobian.values[p:]
        errors = replace(new.errors, values=new.errors.values + change)
        return replace(new, stated=self.stated, values=self.values, errors=errors)

    def adapted(self) -> "LinearFit":
        """The fit with errors that suit its values; its Jacobian is of others."""
        model = self.model.adapt(self.terms, self.values[: self.count])
        return replace(self, model=model)

    def thin(self, share: float) -> "LinearFit":
        """The fit in so many times fewer rows."""
        model, rows = self.model.thin(share)
        count = self.rows

        def cut(errors: Errors) -> Errors:
            x, slack = errors.values, errors.slack
            x = x.reshape(*x.shape[:-1], count, -1)[..., rows, :]
            noise = None if errors.noise is None else errors.noise[rows]
            slack = slack[rows] if isinstance(slack, np.ndarray) else slack
            volume = len(rows) / count * errors.volume
            return Errors(x.reshape(*x.shape[:-2], -1), volume, noise, slack)

        errors, jacobian = cut(self.errors), cut(self.jacobian)
        return replace(self, model=model, errors=errors, jacobian=jacobian)


def _linearize(model: ErrorModel, terms: Sequence[Term], values: Floats) -> LinearFit:
    """A fit at values (P), without nuisances, all of its terms stated ones."""
    errors = model.compute_errors(terms, values[None]).first
    own = differentiate(model, terms, values, errors)
    other = model.compute_nuisance(terms, values[None], errors)
    values = np.append(values, np.zeros(len(other.values)))
    jacobian = Errors.join(own, other)
    return LinearFit(model, tuple(terms), len(terms), values, errors, jacobian)


def start_fit(
    model: ErrorModel,
    stated: Sequence[Term],
    named: Sequence[Term] = (),
    values: Floats | None = None,
) -> LinearFit:
    """A fit to begin with.

    Args:
        stated: terms of the values that the model states.
        values: (P) of all of them [units of the parameters]; None: the model as it is
            given.
    """
    at = np.ones(len(stated)) if values is None else values
    fit = _linearize(model.adapt((*stated, *named), at), (*stated, *named), at)
    return replace(fit, stated=len(stated))


def descend(fit: LinearFit, iterations: int = DESCENT_ITERATIONS) -> LinearFit:
    """Gauss-Newton within bounds, with the Jacobian held and the errors computed.

    The chord method, with shorter steps where the cost would grow.

    Args:
        iterations: at most.
    """
    low, high, scale = fit.bounds
    cost, share = fit.cost, 1.0
    if not np.isfinite(cost):
        return fit
    for _ in range(iterations):
        h, g = fit.quadratic_model
        step = solve_bounded_step(
            h, g, low - fit.values, high - fit.values, scale, DAMPING
        )
        while True:
            new = fit.at(fit.values + share * step)
            after = new.cost
            if after < cost or share < SHORTEST_STEP:
                break
            share /= 3
        if not after < cost:
            break
        gained, cost, fit = cost - after, after, new
        share = min(1.0, 2 * share)
        if gained < LEAST_GAIN:
            break
    return fit


def refine(fit: LinearFit) -> LinearFit:
    """Gauss-Newton with a new Jacobian before each descent."""
    cost = fit.cost
    for _ in range(REFINEMENTS):
        fit = descend(fit.adapted().linearized(), 4)
        after = fit.cost
        if cost - after < 5 * LEAST_GAIN:
            break
        cost = after
    return fit


def add_terms(
    fit: LinearFit, directions: Sequence[Direction], coordinates: Floats
) -> LinearFit:
    """The fit with the terms of some directions, descended from their coordinates.

    Args:
        coordinates: (k) of them.
    """
    ends = np.cumsum([len(d.columns) for d in directions])
    parts = zip(directions, np.split(coordinates, ends[:-1]), strict=True)
    own = np.concatenate([d.compute_values(z) for d, z in parts])
    p, jacobian = fit.count, fit.jacobian
    terms = (*fit.terms, *(d.term for d in directions))
    values = np.concatenate([fit.values[:p], own, fit.values[p:]])
    none = Errors(np.zeros((len(own), fit.errors.values.size)), np.zeros(len(own)))
    parts_of_it = jacobian.select(slice(p)), none, jacobian.select(slice(p, None))
    jacobian = Errors.join(*parts_of_it)
    added = replace(fit.at(values, terms), jacobian=jacobian)
    which = _find_touched(terms, len(directions))
    found = differentiate(
        fit.model, terms, values[: p + len(own)], added.plain_errors, which
    )
    jacobian.values[which], jacobian.volume[which] = found.values, found.volume
    return descend(added)


def _find_touched(terms: Sequence[Term], count: int) -> list[int]:
    """Numbers of values whose response the last `count` terms may have changed.

    Their own, and those of what they act at.
    """
    new = terms[-count:]
    targets = [target for t in new for target in t.targets]

    def is_touched(term: Term) -> bool:
        return term in new or any(
            a.startswith(b) or b.startswith(a) for a in term.targets for b in targets
        )

    touched = [is_touched(t) for t in terms for _ in t.parameters]
    return np.flatnonzero(touched).tolist()


def remove_terms(fit: LinearFit, removed: Sequence[int]) -> LinearFit:
    """The fit without some terms, by their numbers, descended from where it was."""
    fit, keep = fit.restored(removed), np.ones(len(fit.values), bool)
    for i in removed:
        keep[fit.slices[i]] = False
    terms = tuple(t for i, t in enumerate(fit.terms) if i not in removed)
    jacobian = fit.jacobian.select(keep)
    less = replace(fit, terms=terms, values=fit.values[keep], jacobian=jacobian)
    return descend(less.at(less.values))


def invert(curvature: Floats) -> Floats:
    """Inverse of a positive definite matrix (n, n) whose rows have their own units.

    Rows of what changes nothing are zero in it, too.
    """
    diagonal = np.diag(curvature)
    is_felt = diagonal > np.finfo(float).tiny
    size = np.where(is_felt, 1 / np.sqrt(np.where(is_felt, diagonal, 1.0)), 0.0)
    scaled = curvature * size * size[:, None] + INVERSE_RIDGE * np.eye(len(size))
    return np.asarray(np.linalg.inv(scaled) * size * size[:, None])
