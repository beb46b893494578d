"""Block cross-validation: takes fits, gives errors of what they did not see.

Neighboring segments are correlated, so that whole blocks of them are left out together
(Burman, Chow and Nolan 1994), and also whole episodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..estimation.candidate_fit import fit_candidate
from ..estimation.fit import Fit
from ..estimation.least_squares import fit_parameters
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.problem import Problem, assign_blocks
from ..estimation.settings import FIT
from .settings import SELECTION


@dataclass(frozen=True, eq=False)
class ScoredFit:
    """A fit, and how well it predicts the segments that it did not see.

    Attributes:
        fit: to all segments.
        held_out_errors: (W) [1] squared residuals of each segment in standard
            deviations, each predicted from the other folds.
        is_reestimated: whether the problem has the initial states that the fit's values
            ask for, not those of before.
    """

    fit: Fit
    held_out_errors: Floats
    is_reestimated: bool = False

    @classmethod
    def from_fit(cls, fit: Fit) -> "ScoredFit":
        """Score a fit by predicting every fold from the others."""
        return cls(fit, predict_held_out(fit))

    @property
    def error(self) -> float:
        """Held-out squared error of all segments [1]."""
        return self.held_out_errors.sum()

    @property
    def candidate(self) -> Term:
        """The term that was tried, which is the last one."""
        return self.fit.terms[-1]

    @property
    def values(self) -> Floats:
        """(p) [units of its parameters] values of the candidate."""
        return self.fit.values[len(self.fit.values) - len(self.candidate.parameters) :]


def predict_held_out(
    fit: Fit, folds: np.ndarray | None = None, *, linearly: bool = False
) -> Floats:
    """Squared residuals of each fold, with the values that the other folds ask for.

    These values are one Gauss-Newton step away from the fit to all segments, J and r
    without the rows of the fold and Lambda of the prior:

        (J'J + Lambda) step = -(J'r + Lambda (x - 1))

    Where residuals are linear that is exact leave-out prediction (PRESS, Allen 1974).
    Folds of whole segments are then simulated with these values, for in contact a small
    step changes much. Where the longest steps show that residuals are linear, the other
    folds are not. Parts of a segment, and single readings, are predicted linearly;
    `refit_without_folds` fits the latter.

    Args:
        fit: to all segments.
        folds: (R) number of the fold of each residual; by default those of
            `assign_folds`.
        linearly: whether no fold is simulated.

    Returns:
        (W) [1] sums over each segment, in squared standard deviations.
    """
    problem, jacobian, residuals = fit.problem, fit.jacobian, fit.residuals
    folds = assign_folds(problem) if folds is None else folds
    base = LinearizedFit.from_fit(fit)
    squares = np.empty(len(residuals))
    whole = []
    for fold in np.unique(folds):
        rows = folds == fold
        _, step = base.drop_residuals(rows)
        change = jacobian[rows] @ step
        squares[rows] = (residuals[rows] + change) ** 2
        segments = np.unique(problem.segment_of_residual[rows])
        if np.isin(problem.segment_of_residual, segments).sum() == rows.sum():
            whole.append((float(change @ change), rows, segments, fit.values + step))
    if linearly or problem.regime.has_single_readings:
        return problem.sum_by_segment(squares)
    worst = 0.0
    for k, (_, rows, segments, point) in enumerate(sorted(whole, key=lambda w: -w[0])):
        if k >= SELECTION.min_simulated_folds and worst < SELECTION.max_linear_error:
            break
        predicted = squares[rows]
        simulated = problem.select(segments).residuals_at(fit.terms, point) ** 2
        squares[rows] = simulated
        off = abs(float(simulated.sum() - predicted.sum()))
        worst = max(worst, off / max(float(squares.sum()), FIT.tiny))
    return problem.sum_by_segment(squares)


def assign_folds(problem: Problem) -> np.ndarray:
    """(R) fold of each residual: blocks of segments, or parts of few long segments."""
    if len(problem.segments) >= FIT.max_blocks:
        return assign_blocks(problem)[problem.segment_of_residual]
    rows = len(problem.segment_of_residual)
    return np.arange(rows) * FIT.max_blocks // rows


def generalizes_across_episodes(old: Fit, new: Fit) -> bool:
    """Whether a fit predicts whole episodes from the others better than another one.

    Leave-one-episode-out cross-validation: neighboring segments share what is peculiar
    to an episode. Each episode counts by the logarithm of its error, for if one alone
    shows an effect's size, the others cannot tell it. Two episodes are too few to ask.

    Args:
        old: the fit without a candidate.
        new: the fit with it, in the same segments.
    """
    problem = old.problem
    episode_of_residual = problem.segments.episode[problem.segment_of_residual]
    if len(np.unique(episode_of_residual)) < SELECTION.min_episodes:
        return True
    before, after = (
        np.bincount(
            problem.segments.episode, predict_held_out(fit, episode_of_residual)
        )
        for fit in (old, new)
    )
    if problem.regime.has_single_readings:
        return bool(after.sum() < before.sum())
    is_read = before > 0
    return bool(np.log(after[is_read] / before[is_read]).sum() < 0)


def refit_without_folds(
    base: LinearizedFit, scored: Sequence[ScoredFit], terms: Sequence[Term]
) -> list[ScoredFit]:
    """Score candidates of single readings by fits of their own without each fold.

    K-fold cross-validation. A robot that holds a pose may rest on other feet with other
    values. One Gauss-Newton step from the fit to all poses would know too much of the
    fold. A candidate that turns out clearly worse than another one is left out.

    Args:
        base: the fit without a candidate.
        scored: fits to all segments, each with one more term than the base.
        terms: the candidates with the initial values that a search begins with.
    """
    problem, initial = base.problem, {t.key: t for t in terms}
    count = len(problem.segments)
    folds = np.arange(count) % min(SELECTION.single_reading_folds, count)
    errors = np.bincount(folds, problem.sum_by_segment(base.fit.residuals**2))
    worst_first = np.argsort(-errors)
    rescored: list[ScoredFit] = []
    for old in sorted(scored, key=lambda s: (len(s.candidate.parameters), s.error)):
        best_error = min((s.error for s in rescored), default=np.inf)
        limit = SELECTION.max_equivalent_error_ratio * best_error
        held_out = np.zeros(count)
        if old.error >= limit:
            continue
        for fold in worst_first:
            seen, unseen = np.flatnonzero(folds != fold), np.flatnonzero(folds == fold)
            new = fit_candidate(base.select(seen), initial[old.candidate.key])
            part = problem.select(unseen)
            residuals = part.residuals_at(new.terms, new.values)
            held_out[unseen] = part.sum_by_segment(residuals**2)
            if held_out.sum() > limit:
                break
        else:
            rescored.append(ScoredFit(old.fit, held_out))
    return rescored


def fit_and_score(
    problem: Problem, terms: Sequence[Term], start: Floats, **options
) -> ScoredFit:
    """Fit all values, and predict every fold from the others.

    Args:
        problem: to fit.
        terms: whose values are fitted.
        start: (P) [units of the parameters] values to begin with.
        **options: those of `fit_parameters`.
    """
    return ScoredFit.from_fit(fit_parameters(problem, terms, start, **options))
