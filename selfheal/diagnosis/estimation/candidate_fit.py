"""Fits of one more term: takes a fit and a candidate term, gives the fit of both.

The candidate's values are found by Gauss-Newton iterations. The values of the fit
answer linearly: they are always where the linearization has its minimum. That is
variable projection (Golub and Pereyra 1973), with the Jacobian of the fit held fixed.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..simulation.checkpoint import Arrays
from .fit import Fit
from .jacobian import compute_jacobian
from .least_squares import Trial, search_dampings
from .linearized_fit import LinearizedFit
from .quadratic_model import (
    QuadraticModel,
    stack_bounds,
    update_broyden,
)
from .settings import FIT


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
        old.problem,
        (*old.terms, term),
        np.concatenate([old.values + others_step, values]),
        residuals + old.jacobian @ others_step,
        np.hstack([old.jacobian, jacobian]),
    )


def stack_starts(term: Term) -> Floats:
    """(n, p) the initial values of a term [units of its parameters]."""
    return np.array(term.initial_values, float).reshape(len(term.initial_values), -1)


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

    def leave_plateau(self, now: Trial) -> tuple[Trial, Floats]:
        """Lower limits that are never met: from there no slope leads to one that is.

        Returns:
            The best of the trial and of those with one such limit at 1/2, 1/4, ... of
            its distance to its bound, and the Jacobian (R, p) there.
        """
        jacobian = self.compute_jacobian(now.point, now.residuals)
        most = np.abs(jacobian * self.term.scale).max(axis=0)
        flat = np.flatnonzero(most < FIT.least_response)
        if not len(flat):
            return now, jacobian
        shares = 0.5 ** np.arange(1, 1 + FIT.plateau_halvings)
        points = np.tile(now.point, (len(flat), len(shares), 1))
        for k, i in enumerate(flat):
            low = self.term.low[i]
            points[k, :, i] = low + shares * (now.point[i] - low)
        trials = self.evaluate(points.reshape(-1, len(now.point)))
        best = min(trials, key=lambda t: t.cost)
        if not best.cost < now.cost:
            return now, jacobian
        return best, self.compute_jacobian(best.point, best.residuals)

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
    begun = candidate.compute_residuals(stack_starts(term))
    now, has_diverged = _find_start(candidate, begun)
    if has_diverged:
        iterations = 0
    if iterations:
        now, jacobian = candidate.leave_plateau(now)
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


def _find_start(candidate: _CandidateProblem, residuals: Floats) -> tuple[Trial, bool]:
    """The best of a term's initial values, and whether all of them diverge.

    Args:
        candidate: the term beside a fit.
        residuals: (n, R) with its initial values [standard deviations].
    """
    base, term = candidate.base, candidate.term
    points = stack_starts(term)
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
