"""Fits that predict what they did not see: blocks of segments, folds, episodes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..estimation.candidate_fit import LinearizedFit, fit_candidate
from ..estimation.least_squares import Fit, fit_parameters
from ..estimation.problem import BLOCKS, Problem, assign_blocks
from .settings import SELECTION


@dataclass(frozen=True, eq=False)
class ScoredFit:
    """A fit and how well it predicts what it did not see.

    Attributes:
        fit: of all windows.
        held: (W) squared residuals of each window, predicted from the other folds.
        seat: the problem with the starts that its values ask for; None: as it was.
    """

    fit: Fit
    held_out_errors: Floats
    reestimated: Problem | None = None

    @classmethod
    def from_fit(cls, problem: Problem, found: Fit) -> "ScoredFit":
        """With every fold predicted from the others."""
        return cls(found, predict_held_out(problem, found))

    @property
    def error(self) -> float:
        """Of all windows."""
        return self.held_out_errors.sum()

    @property
    def candidate(self) -> Term:
        """The term that was tried."""
        return self.fit.terms[-1]

    @property
    def values(self) -> Floats:
        """Of its parameters."""
        return self.fit.values[len(self.fit.values) - len(self.candidate.parameters) :]


def predict_held_out(
    problem: Problem, found: Fit, of: np.ndarray | None = None
) -> Floats:
    """(W) squared residuals of each fold, with the values that the others ask for.

    These by one Gauss-Newton step from the fit of all; with them folds of whole windows
    are simulated, for where something touches a small step changes much. Parts of a
    window answer linearly, and so do single readings, which `refitted` looks at.

    Args:
        problem: that was fitted.
        found: its fit.
        of: (R) fold of each residual; by default one of `BLOCKS` stretches of time.
    """
    x, jac, r = found.values, found.jacobian, found.residuals
    of = assign_folds(problem) if of is None else of
    base = LinearizedFit.from_fit(problem, found)
    out = np.empty(len(r))
    for fold in np.unique(of):
        rows = of == fold
        _, move = base.drop_residuals(rows)
        own = np.unique(problem.segment_of_residual[rows])
        whole = np.isin(problem.segment_of_residual, own).sum() == rows.sum()
        if whole and not problem.regime.has_single_readings:
            out[rows] = problem.select(own).residuals_at(found.terms, x + move) ** 2
        else:
            out[rows] = (r[rows] + jac[rows] @ move) ** 2
    return problem.sum_by_segment(out)


def assign_folds(problem: Problem) -> np.ndarray:
    """(R) fold of each residual: windows next to each other, or parts of long ones."""
    if len(problem.segments) >= BLOCKS:
        return assign_blocks(problem)[problem.segment_of_residual]
    rows = len(problem.segment_of_residual)
    return np.arange(rows) * BLOCKS // rows


def generalizes_across_episodes(
    problem: Problem, old: Fit, new: Fit, reestimated: Problem | None = None
) -> bool:
    """Whether `new`, in its seat, predicts whole episodes from the others better.

    Pieces next to each other share what is peculiar to an episode; that also holds a
    name that explains nothing else. Each episode counts by the logarithm of its error:
    of one that alone shows an effect's size the others cannot tell it. Two episodes
    are too few to ask.
    """
    episode = problem.segments.episode[problem.segment_of_residual]
    if len(np.unique(episode)) < SELECTION.min_episodes:
        return True
    of = problem.segments.episode
    before = np.bincount(of, predict_held_out(problem, old, episode))
    after = np.bincount(of, predict_held_out(reestimated or problem, new, episode))
    if problem.regime.has_single_readings:
        return bool(after.sum() < before.sum())
    there = before > 0
    return bool(np.log(after[there] / before[there]).sum() < 0)


def refit_without_folds(
    base: LinearizedFit, found: Sequence[ScoredFit], terms: Sequence[Term]
) -> list[ScoredFit]:
    """Fits with one more term than the base, the term fitted anew without each fold.

    Where a robot that holds a pose rests on other feet, one step from the fit of all
    knows too much of what it did not see. A fit that turns out to be worse than another
    is left out.

    Args:
        base: the fit without it.
        found: of all windows.
        terms: theirs are among them, as a search begins with them.
    """
    problem, begin = base.problem, {t.key: t for t in terms}
    count = len(problem.segments)
    fold = np.arange(count) % min(SELECTION.single_reading_folds, count)
    worst = np.argsort(
        -np.bincount(fold, problem.sum_by_segment(base.fit.residuals**2))
    )
    tried: list[ScoredFit] = []
    for s in sorted(found, key=lambda s: (len(s.candidate.parameters), s.error)):
        best = SELECTION.max_equivalent_error_ratio * min(
            (t.error for t in tried), default=np.inf
        )
        held = np.zeros(count)
        if s.error >= best:
            continue
        for k in worst:
            seen, unseen = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
            new = fit_candidate(base.select(seen), begin[s.candidate.key])
            rest = problem.select(unseen)
            held[unseen] = rest.sum_by_segment(
                rest.residuals_at(new.terms, new.values) ** 2
            )
            if held.sum() > best:
                break
        else:
            tried.append(ScoredFit(s.fit, held))
    return tried


def fit_and_score(
    problem: Problem, terms: Sequence[Term], start: Floats, **more
) -> ScoredFit:
    """Fit, and predict every fold from the others."""
    return ScoredFit.from_fit(problem, fit_parameters(problem, terms, start, **more))
