"""One more term beside a fit: takes a fit and a term, gives the best of both."""

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term, find_overridden
from ..simulation.checkpoint import Arrays
from .least_squares import (
    TRIFLE,
    WRONG,
    Fit,
    compute_jacobian,
    find_lowest,
    prior_precision,
    solve_bounded_step,
    stack_bounds,
    update_broyden,
)
from .problem import FAR, Problem

LOST = 0.5  # of the residuals so far off, from which no search begins; chosen


@dataclass(frozen=True, eq=False)
class LinearizedFit:
    """A fit in whose neighborhood other effects are tried.

    Attributes:
        problem: that was fitted.
        fit: its best values.
        weights: (P) of what is believed.
        curvature: (P, P), of what is believed too.
    """

    problem: Problem
    fit: Fit
    prior: Floats
    curvature: Floats

    @classmethod
    def from_fit(cls, problem: Problem, found: Fit) -> "LinearizedFit":
        """With the curvature worked out."""
        weights = prior_precision(found.terms)
        curvature = found.jacobian.T @ found.jacobian + np.diag(weights)
        return cls(problem, found, weights, curvature)

    def select(self, chosen: np.ndarray) -> "LinearizedFit":
        """The same fit in some of the windows."""
        segments, found = self.problem.segments, self.fit
        width = segments.readings.shape[1]
        rows = segments.find_sample_rows(chosen)[:, None] * width + np.arange(width)
        r, jac = found.residuals[rows.ravel()], found.jacobian[rows.ravel()]
        return LinearizedFit.from_fit(
            self.problem.select(chosen), Fit(found.terms, found.values, r, jac)
        )

    def release_overridden(self, term: Term) -> "LinearizedFit":
        """The same fit, where stated values that a term overrides do nothing."""
        idle = find_overridden(term, self.fit.terms)
        if not idle:
            return self
        jac = self.fit.jacobian.copy()
        jac[:, idle] = 0.0
        return LinearizedFit.from_fit(self.problem, replace(self.fit, jacobian=jac))

    @cached_property
    def gradient(self) -> Floats:
        """(P) of the cost where the fit ended."""
        return self.gradient_at(self.fit.residuals)

    def drop_residuals(self, rows: np.ndarray) -> tuple[float, Floats]:
        """What others' cost falls by without some residuals, and the move (P) to it.

        By one Gauss-Newton step; `rows` (R) says which residuals go.
        """
        low, high, scale = stack_bounds(self.fit.terms)
        x, a = self.fit.values, self.fit.jacobian[rows]
        h, g = self.curvature - a.T @ a, self.gradient - a.T @ self.fit.residuals[rows]
        move = solve_bounded_step(h, g, low - x, high - x, scale)
        return -float((2 * g + h @ move) @ move), move

    def gradient_at(self, r: Floats) -> Floats:
        """(P) of the cost at residuals r (R), with the pull of what is believed."""
        return self.fit.jacobian.T @ r + self.prior * (self.fit.values - 1)

    def minimize(
        self, r: Floats, hold: np.ndarray | None = None
    ) -> tuple[float, Floats]:
        """Lowest cost and the move (P) to it, of residuals r if the rest is linear.

        Args:
            r: (R).
            hold: numbers of parameters that do not move.
        """
        low, high, scale = stack_bounds(self.fit.terms)
        x = self.fit.values
        g = self.gradient_at(r)
        low, high = low - x, high - x
        if hold is not None:
            low[hold] = high[hold] = 0.0
        move = solve_bounded_step(self.curvature, g, low, high, scale)
        cost = r @ r + 2 * g @ move + move @ self.curvature @ move
        return float(cost + self.prior @ (x - 1) ** 2), move


def fit_candidate(base: LinearizedFit, term: Term, *, rounds: int = 4) -> Fit:
    """The best of one more term, while all others answer linearly.

    Returns:
        All terms; residuals and Jacobian are those of the linear answer.
    """
    base = base.release_overridden(term)
    found = base.fit
    x, r, jac, move = base.problem.simulator.load_or_compute(
        partial(_fit_candidate, base, term, rounds)
    )
    return Fit(
        (*found.terms, term), np.concatenate([found.values + move, x]),
        r + found.jacobian @ move, np.hstack([found.jacobian, jac]),
    )  # fmt: skip


def _fit_candidate(base: LinearizedFit, term: Term, rounds: int) -> Arrays:
    """The term's values, residuals and Jacobian, and the move of all others."""
    problem, terms = base.problem, (*base.fit.terms, term)
    low, high, scale = term.low, term.high, term.scale
    fixed = base.fit.values

    def residuals(points: Floats) -> Floats:
        rows = np.hstack([np.tile(fixed, (len(points), 1)), points])
        return problem.compute_residuals(terms, rows)

    def slopes(x: Floats, r: Floats) -> Floats:
        return compute_jacobian(problem, terms, np.append(fixed, x), r, len(fixed))

    def settled(points: Floats) -> list[tuple]:
        found = [(new, base.minimize(new)) for new in residuals(points)]
        return [(cost, new, others) for new, (cost, others) in found]

    points = np.array(term.initial_values, float).reshape(len(term.initial_values), -1)
    predicted = residuals(points)
    if term.effect.is_periodic and len(points) > 1:
        points = np.clip(_find_best_sinusoid(base, points, predicted), low, high)
        predicted = residuals(points)
    if (np.abs(predicted) >= FAR).mean(axis=1).min() > LOST:
        rounds = 0
    ends = [base.minimize(r) for r in predicted]
    first = int(np.argmin([c for c, _ in ends]))
    x, r, (cost, move) = points[first], predicted[first], ends[first]
    jac = slopes(x, r) if rounds else np.zeros((len(r), len(x)))
    for _ in range(rounds if len(x) else 0):
        propose = partial(_propose_joint_step, base, jac, r, x, low, high, scale)
        best = find_lowest(cost, propose, settled, TRIFLE)
        if best is None or best[1] >= cost * (1 - 1e-6):
            break
        before, moved, change = cost, best[0] - x, best[2] - r
        x, cost, r, move = best
        if rounds == 1 or before - cost < 2e-3 * before:
            jac = update_broyden(jac, moved, change, scale)
            break
        wrong = change - jac @ moved
        if wrong @ wrong < WRONG * (r @ r):
            jac = update_broyden(jac, moved, change, scale)
        else:
            jac = slopes(x, r)
    return x, r, jac, move


def _find_best_sinusoid(
    base: LinearizedFit, points: Floats, predicted: Floats
) -> Floats:
    """Amplitude, frequency and phase (1, 3) that explain most if all answers linearly.

    By the sine and the cosine of each frequency (Lomb 1976), fitted with all else.

    Args:
        base: the fit without it.
        points: (2 n, 3) starts, those of a frequency a quarter turn apart.
        predicted: (2 n, R) residuals with them.
    """
    r, jac = base.fit.residuals, base.fit.jacobian
    best, most = points[:1], 0.0
    for k in range(0, len(points), 2):
        pair = (predicted[k : k + 2] - r).T
        cross = jac.T @ pair
        h = np.block([[base.curvature, cross], [cross.T, pair.T @ pair]])
        g = np.concatenate([base.gradient_at(r), pair.T @ r])
        x = -np.linalg.lstsq(h, g, rcond=1e-12)[0]
        if -g @ x > most:
            most, (sine, cosine) = -g @ x, x[-2:]
            phase = np.mod(points[k, 2] + np.arctan2(cosine, sine), 2 * np.pi)
            wave = points[k, 0] * np.hypot(sine, cosine), points[k, 1], phase
            best = np.array([wave])
    return best


def _propose_joint_step(base: LinearizedFit, jac, r, x, low, high, scale, damping):
    """The cost that a move of all values promises, and the term's own values then."""
    all_low, all_high, all_scale = stack_bounds(base.fit.terms)
    cross = base.fit.jacobian.T @ jac
    h = np.block([[base.curvature, cross], [cross.T, jac.T @ jac]])
    g = np.concatenate([base.gradient_at(r), jac.T @ r])
    move = solve_bounded_step(
        h, g,
        np.concatenate([all_low - base.fit.values, low - x]),
        np.concatenate([all_high - base.fit.values, high - x]),
        np.concatenate([all_scale, scale]), damping,
    )  # fmt: skip
    cost = r @ r + base.prior @ (base.fit.values - 1) ** 2
    return float(cost + (2 * g + h @ move) @ move), x + move[len(base.fit.values) :]
