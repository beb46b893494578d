"""Fits of one more term: takes a fit and a candidate term, gives the fit of both.

The candidate's values are found by Gauss-Newton iterations. The values of the fit
answer linearly: they are always where the linearization has its minimum. That is
variable projection (Golub and Pereyra 1973), with the Jacobian of the fit held fixed.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.terms import find_overridden
from ..simulation.checkpoint import Arrays
from .jacobian import compute_jacobian
from .least_squares import Fit, Trial, search_dampings
from .problem import Problem
from .quadratic_model import (
    QuadraticModel,
    prior_precision,
    solve_bounded_step,
    stack_bounds,
    update_broyden,
)
from .settings import FIT


@dataclass(frozen=True, eq=False)
class LinearizedFit:
    """A fit and the quadratic model of its cost, beside which other terms are tried.

    Attributes:
        problem: that was fitted.
        fit: of its P values.
        prior: (P) diagonal of Lambda, the prior's precision.
        curvature: (P, P) J'J + Lambda.
    """

    problem: Problem
    fit: Fit
    prior: Floats
    curvature: Floats

    @classmethod
    def from_fit(cls, problem: Problem, fit: Fit) -> "LinearizedFit":
        """Linearize a fit of a problem by its Jacobian."""
        prior = prior_precision(fit.terms)
        curvature = fit.jacobian.T @ fit.jacobian + np.diag(prior)
        return cls(problem, fit, prior, curvature)

    def select(self, chosen: np.ndarray) -> "LinearizedFit":
        """The fit in segments `chosen` (w), with its values as they are."""
        segments, fit = self.problem.segments, self.fit
        width = segments.readings.shape[1]
        rows = segments.find_sample_rows(chosen)[:, None] * width + np.arange(width)
        residuals, jacobian = fit.residuals[rows.ravel()], fit.jacobian[rows.ravel()]
        return LinearizedFit.from_fit(
            self.problem.select(chosen),
            Fit(fit.terms, fit.values, residuals, jacobian),
        )

    def release_overridden(self, term: Term) -> "LinearizedFit":
        """The fit in which nominal values that a term overrides have no effect."""
        overridden = find_overridden(term, self.fit.terms)
        if not overridden:
            return self
        jacobian = self.fit.jacobian.copy()
        jacobian[:, overridden] = 0.0
        return LinearizedFit.from_fit(
            self.problem, replace(self.fit, jacobian=jacobian)
        )

    @cached_property
    def gradient(self) -> Floats:
        """(P) half the gradient of the penalized cost at the fit."""
        return self.gradient_at(self.fit.residuals)

    def gradient_at(self, residuals: Floats) -> Floats:
        """(P) J'r + Lambda (x - 1) at other residuals r (R)."""
        return self.fit.jacobian.T @ residuals + self.prior * (self.fit.values - 1)

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

    @cached_property
    def by_column(self) -> tuple[Floats, Floats, Floats]:
        """Of each column of readings (C): r'r (C), J'r (C, P) and J'J (C, P, P)."""
        width = self.problem.segments.readings.shape[1]
        r = self.fit.residuals.reshape(-1, width)
        jacobian = self.fit.jacobian.reshape(len(r), width, -1).transpose(1, 2, 0)
        gradients = np.stack([j @ x for j, x in zip(jacobian, r.T, strict=True)])
        curvatures = np.stack([j @ j.T for j in jacobian])
        return (r**2).sum(axis=0), gradients, curvatures

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
        size = np.sqrt(np.maximum(np.diagonal(self.curvature), FIT.tiny))[:, None]
        scaled = self.curvature / size / size.T
        solved = np.linalg.lstsq(scaled, cross / size, rcond=None)[0] / size
        score = changes.T @ self.fit.residuals - solved.T @ self.gradient
        rest = changes.T @ changes - cross.T @ solved
        own = np.linalg.pinv(rest, rcond=FIT.min_column_share, hermitian=True)
        return float(score @ own @ score)

    def step_without(self, removed: Sequence[Term]) -> Floats:
        """The step (P) of all values to the fit without some terms, to first order.

        Theirs go to nominal ones, or to a bound where these are infinite.
        """
        columns, change = self._changes_to_nominal
        held = np.concatenate([columns[t] for t in removed])
        return self.move(held, change[held])

    @cached_property
    def _changes_to_nominal(self) -> tuple[dict[Term, np.ndarray], Floats]:
        """Columns of each term, and by how much each value (P) is not nominal."""
        terms, values = self.fit.terms, self.fit.values
        ends = np.cumsum([0, *(len(t.parameters) for t in terms)])
        columns = {t: np.arange(ends[i], ends[i + 1]) for i, t in enumerate(terms)}
        low, high, _ = stack_bounds(terms)
        nominal = np.concatenate([[p.nominal for p in t.parameters] for t in terms])
        return columns, np.clip(nominal, low, high) - values

    def minimize(self, residuals: Floats) -> tuple[float, Floats]:
        """Minimize the penalized cost of other residuals over the values of the fit.

        The residuals answer linearly, by the Jacobian of the fit.

        Args:
            residuals: (R) with the values of the fit [standard deviations].

        Returns:
            The lowest cost [1], and the step (P) to it [units of the parameters].
        """
        values, gradient = self.fit.values, self.gradient_at(residuals)
        step = self._solve(gradient, np.arange(len(values)))
        cost = (
            residuals @ residuals + 2 * gradient @ step + step @ self.curvature @ step
        )
        return float(cost + self.prior @ (values - 1) ** 2), step

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


def spread_around(term: Term, start: Floats) -> Floats:
    """Points (p, p), each one scale of one parameter from a start (p), in bounds."""
    return np.clip(start + np.diag(term.scale), term.low, term.high)


def fit_candidate(
    base: LinearizedFit, term: Term, *, iterations: int = FIT.candidate_iterations
) -> Fit:
    """Fit one more term, while the values of a fit answer linearly.

    Args:
        base: the fit without the term.
        term: to be fitted, from each of its initial values.
        iterations: of them, at most.

    Returns:
        The fit of all terms, the new one last. Residuals and Jacobian are those of the
        linear answer.
    """
    base = base.release_overridden(term)
    old = base.fit
    values, residuals, jacobian, others_step = base.problem.simulator.load_or_compute(
        partial(_fit_candidate, base, term, iterations)
    )
    return Fit(
        (*old.terms, term),
        np.concatenate([old.values + others_step, values]),
        residuals + old.jacobian @ others_step,
        np.hstack([old.jacobian, jacobian]),
    )


@dataclass(frozen=True, eq=False)
class _CandidateProblem:
    """The problem whose unknowns are the p values of one more term."""

    base: LinearizedFit
    term: Term

    @property
    def terms(self) -> tuple[Term, ...]:
        """Those of the fit, and the new one."""
        return (*self.base.fit.terms, self.term)

    def compute_residuals(self, points: Floats) -> Floats:
        """(n, R) residuals at values (n, p) of the term, those of the fit as fitted."""
        fixed = np.tile(self.base.fit.values, (len(points), 1))
        return self.base.problem.compute_residuals(
            self.terms, np.hstack([fixed, points])
        )

    def compute_jacobian(self, values: Floats, residuals: Floats) -> Floats:
        """(R, p) Jacobian at values (p) of the term with residuals (R)."""
        fixed = self.base.fit.values
        return compute_jacobian(
            self.base.problem,
            self.terms,
            np.append(fixed, values),
            residuals,
            len(fixed),
        )

    def minimize_others(self, values: Floats, residuals: Floats) -> Trial:
        """The trial at values (p) with residuals (R), all others at their best."""
        cost, others_step = self.base.minimize(residuals)
        return Trial(values, cost, residuals, others_step)

    def evaluate(self, points: Floats) -> list[Trial]:
        """Trials at n points (n, p)."""
        residuals = self.compute_residuals(points)
        return [
            self.minimize_others(x, r) for x, r in zip(points, residuals, strict=True)
        ]

    def build_model(self, now: Trial, jacobian: Floats) -> QuadraticModel:
        """The model of the cost over all P + p values, from those of the fit and now.

            [J'J + Lambda  J'K]            [J'r + Lambda (x - 1)]
        H = [K'J           K'K],       g = [K'r                 ]

        `now` is the trial that the model is of, `jacobian` is K (R, p).
        """
        base, term = self.base, self.term
        low, high, scale = stack_bounds(base.fit.terms)
        cross = base.fit.jacobian.T @ jacobian
        return QuadraticModel(
            np.block([[base.curvature, cross], [cross.T, jacobian.T @ jacobian]]),
            np.concatenate(
                [base.gradient_at(now.residuals), jacobian.T @ now.residuals]
            ),
            np.concatenate([low - base.fit.values, term.low - now.point]),
            np.concatenate([high - base.fit.values, term.high - now.point]),
            np.concatenate([scale, term.scale]),
        )

    def search_step(self, now: Trial, jacobian: Floats) -> Trial | None:
        """The best step from a trial with Jacobian (R, p); None: none lowers the cost.

        Steps are of all values together, but the cost counts with the values of the fit
        at their best beside the term's.
        """
        model, fitted = self.build_model(now, jacobian), self.base.fit.values
        cost = now.residuals @ now.residuals + self.base.prior @ (fitted - 1) ** 2

        def propose(damping: float) -> tuple[float, Floats]:
            """Predicted cost and the term's values (p) of a damping."""
            step = model.solve(damping)
            return (
                float(cost + model.predict_change(step)),
                now.point + step[len(fitted) :],
            )

        return search_dampings(
            now.cost, propose, self.evaluate, FIT.candidate_min_predicted_gain
        )


def _fit_candidate(base: LinearizedFit, term: Term, iterations: int) -> Arrays:
    """The term's values (p), residuals (R), Jacobian (R, p) and the others' step (P).

    Arguments are those of `fit_candidate`.
    """
    candidate = _CandidateProblem(base, term)
    now, has_diverged = _find_start(candidate)
    if has_diverged:
        iterations = 0
    if iterations:
        jacobian = candidate.compute_jacobian(now.point, now.residuals)
    else:
        jacobian = np.zeros((len(now.residuals), len(now.point)))
    for _ in range(iterations if len(now.point) else 0):
        old, trial = now, candidate.search_step(now, jacobian)
        if trial is None or trial.cost >= old.cost * (1 - FIT.candidate_min_step_gain):
            break
        now = trial
        step, change = now.point - old.point, now.residuals - old.residuals
        error, gain = change - jacobian @ step, old.cost - now.cost
        is_last = iterations == 1 or gain < FIT.candidate_min_iteration_gain * old.cost
        is_linear = error @ error < FIT.broyden_error * (now.residuals @ now.residuals)
        if is_last or is_linear:
            jacobian = update_broyden(jacobian, step, change, term.scale)
        else:
            jacobian = candidate.compute_jacobian(now.point, now.residuals)
        if is_last:
            break
    return now.point, now.residuals, jacobian, now.others_step


def _find_start(candidate: _CandidateProblem) -> tuple[Trial, bool]:
    """The best of a term's initial values, and whether all of them diverge."""
    base, term = candidate.base, candidate.term
    points = np.array(term.initial_values, float).reshape(len(term.initial_values), -1)
    residuals = candidate.compute_residuals(points)
    if term.effect.is_periodic and len(points) > 1:
        best = _find_best_sinusoid(base, points, residuals)
        points = np.clip(best, term.low, term.high)
        residuals = candidate.compute_residuals(points)
    clipped = (np.abs(residuals) >= FIT.max_residual).mean(axis=1)
    trials = [
        candidate.minimize_others(x, r) for x, r in zip(points, residuals, strict=True)
    ]
    best_trial = trials[int(np.argmin([t.cost for t in trials]))]
    return best_trial, bool(clipped.min() > FIT.max_clipped_share)


def _find_best_sinusoid(
    base: LinearizedFit, points: Floats, residuals: Floats
) -> Floats:
    """The sinusoid that lowers the cost most if residuals answer linearly.

    For each frequency, the amplitudes of a sine and a cosine are solved for together
    with all values of the fit: a periodogram by least squares (Lomb 1976).

    Args:
        base: the fit without the sinusoid.
        points: (2 n, 3) amplitude, frequency and phase to begin with, two of each
            frequency a quarter turn apart.
        residuals: (2 n, R) with them [standard deviations].

    Returns:
        (1, 3) amplitude, frequency and phase [units of the points].
    """
    r, jacobian = base.fit.residuals, base.fit.jacobian
    best, best_gain = points[:1], 0.0
    for k in range(0, len(points), 2):
        pair = (residuals[k : k + 2] - r).T
        cross = jacobian.T @ pair
        h = np.block([[base.curvature, cross], [cross.T, pair.T @ pair]])
        g = np.concatenate([base.gradient_at(r), pair.T @ r])
        step = -np.linalg.lstsq(h, g, rcond=FIT.sinusoid_rank_tolerance)[0]
        if -g @ step > best_gain:
            best_gain, (sine, cosine) = -g @ step, step[-2:]
            phase = np.mod(points[k, 2] + np.arctan2(cosine, sine), 2 * np.pi)
            amplitude = points[k, 0] * np.hypot(sine, cosine)
            best = np.array([[amplitude, points[k, 1], phase]])
    return best
