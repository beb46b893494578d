"""Many candidates at little cost: takes a fit, gives the few worth fitting in full."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..estimation.candidate_fit import LinearizedFit, fit_candidate
from ..estimation.least_squares import Fit
from ..estimation.marginalization import ODD, marginalize_initial_states
from ..estimation.problem import Problem
from .settings import SELECTION

Progress = Callable[[str, float], None]


def select_hard_segments(
    base: LinearizedFit, steps: int, rng: np.random.Generator
) -> LinearizedFit:
    """The same fit in windows that simulate about so many steps.

    Half of them those with the largest residuals, where an effect shows that does so
    rarely; the others drawn at random, where one that is wrong does harm.
    """
    problem, found = base.problem, base.fit
    size = len(problem.segments)
    each = problem.segments.lengths.mean()
    # two seconds of the robot at least, and four windows beyond the first tries
    is_long = each * problem.simulator.timestep >= SELECTION.long_segment
    is_first = steps <= SELECTION.screening_steps[0]
    least = (
        SELECTION.min_first_screening_segments
        if is_first and is_long
        else SELECTION.min_screening_segments
    )
    count = int(np.clip(steps / each, min(least, size), size))
    if count >= SELECTION.nearly_all_segments * size:
        return base
    worst = np.argsort(-problem.sum_by_segment(found.residuals**2))
    others = rng.permutation(worst[(count + 1) // 2 :])
    return base.select(
        np.sort(np.append(worst[: (count + 1) // 2], others[: count // 2]))
    )


def draw_segments(problem: Problem, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Numbers of windows, drawn at random, that simulate about so many steps."""
    size = len(problem.segments)
    count = int(
        np.clip(
            steps / problem.segments.lengths.mean(), SELECTION.min_search_segments, size
        )
    )
    if count >= SELECTION.nearly_all_segments * size:
        return np.arange(size)
    return np.sort(rng.permutation(size)[:count])


def subsample_problem(
    problem: Problem, steps: int, rng: np.random.Generator
) -> Problem:
    """As many of the windows, drawn at random, as simulate about so many steps."""
    return problem.select(draw_segments(problem, steps, rng))


def find_overlooked_segments(
    problem: Problem, some: np.ndarray, part: Problem, found: Fit
) -> np.ndarray:
    """Numbers of windows that were not drawn and are not as well explained.

    What shows rarely, as a stop does, may be in none of those that were drawn. Where
    something touches, a window may be odd by an impact alone.

    Args:
        problem: all windows.
        some: numbers of those that were drawn.
        part: these, weighed.
        found: their fit.
    """
    others = np.setdiff1d(np.arange(len(problem.segments)), some)
    if (
        problem.regime.has_rough_cost
        or problem.regime.has_single_readings
        or not len(others)
    ):
        return others[:0]
    rest = replace(problem.select(others), sigma=part.sigma, simulator=part.simulator)
    rest = marginalize_initial_states(rest, found.terms, found.values)
    predicted = rest.residuals_at(found.terms, found.values)
    each, own = (
        p.sum_by_segment(r**2) / np.maximum(p.sum_by_segment((r != 0).astype(float)), 1)
        for p, r in ((rest, predicted), (part, found.residuals))
    )
    worst = np.argsort(-each)[: len(own) // 2]
    return others[worst[each[worst] > ODD * np.median(own)]]


def screen_candidates(
    bases: Sequence[LinearizedFit], candidates: Sequence[Term], progress: Progress
) -> tuple[list[Fit], float, list[Term]]:
    """Candidates' fits, the best first, in the last of the bases.

    And how many independent candidates there were, by how alike their answers to the
    residuals are (participation ratio of their correlations; Galwey 2009); and those
    worth another try beside a name.

    Args:
        bases: the same fit in more and more windows; fewer and fewer candidates are
            tried in them.
        candidates: to be tried.
        progress: told which one is.
    """
    fits: list[Fit] = []
    answers: list[Floats] = []
    again: list[Term] = []
    for base, rounds, keep in zip(
        bases, SELECTION.screening_iterations, SELECTION.screening_kept, strict=True
    ):
        fits = []
        for i, term in enumerate(candidates):
            progress(f"trying {term.label}", i / len(candidates))
            tried = fit_candidate(base, term, rounds=rounds)
            # hundreds of Jacobians would fill the memory; the first ones are not used
            fits.append(tried if rounds > 1 else replace(tried, jacobian=np.empty(0)))
        answers = answers or [base.fit.residuals - f.residuals for f in fits]
        readings = np.count_nonzero(base.fit.residuals)
        # few readings do not hold a large term back: each number costs (BIC)
        price = readings ** (1 / readings) if readings else 1.0
        fits.sort(key=lambda f: f.cost * price ** len(f.terms[-1].parameters))
        again = again or [f.terms[-1] for f in fits[: SELECTION.max_retried_candidates]]
        fits = fits[:keep] if rounds == 1 else _drop_unpromising(base, fits)[:keep]
        old = len(base.fit.values)
        candidates = [
            replace(f.terms[-1], initial_values=(tuple(f.values[old:]),)) for f in fits
        ]
    return fits, _count_independent(np.array(answers)), again


def _drop_unpromising(base: LinearizedFit, fits: list[Fit]) -> list[Fit]:
    """The best of candidates' fits, and those that gain more than without any."""
    if base.problem.regime.has_single_readings:  # too few readings to tell
        return fits
    least = (1 - SELECTION.min_screening_gain) * base.minimize(base.fit.residuals)[0]
    return [f for i, f in enumerate(fits) if not i or f.cost + f.prior_penalty < least]


def _count_independent(answers: Floats) -> float:
    """How many of (n, R) answers are independent, between 1 and n."""
    size = np.linalg.norm(answers, axis=1)
    unit = answers[size > 0] / size[size > 0, None]
    return len(unit) ** 2 / max(float(((unit @ unit.T) ** 2).sum()), 1.0)
