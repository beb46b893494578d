"""Screening of candidates: takes a fit, gives the few that are worth fitting in full.

Successive halving (Jamieson and Talwalkar 2016): all candidates are tried in few
segments, and fewer and fewer of them in more and more segments.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term, implements
from ..estimation.candidate_fit import estimate_candidates, fit_candidate
from ..estimation.fit import Fit
from ..estimation.jacobian import find_tree_residuals
from ..estimation.linearized_fit import LinearizedFit
from ..estimation.marginalization import marginalize_initial_states
from ..estimation.problem import Problem
from ..estimation.settings import FIT
from ..simulation.kinematic_trees import NO_TREE, find_term_trees
from .settings import SELECTION

Progress = Callable[[str, float], None]


def select_hard_segments(
    base: LinearizedFit, steps: int, rng: np.random.Generator
) -> LinearizedFit:
    """A fit in about as many of its segments as have so many simulation steps.

    Half of them have the largest residuals, where an effect shows that does so rarely.
    The others are drawn at random, where an effect that is wrong does harm.

    Args:
        base: the fit in all segments.
        steps: [steps of the given model] of the segments in sum, about.
        rng: draws segments.
    """
    problem, fit = base.problem, base.fit
    size = len(problem.segments)
    is_long = mean_seconds(problem) >= SELECTION.long_screening_segment
    is_first = steps <= SELECTION.screening_steps[0]
    least = (
        SELECTION.min_first_screening_segments
        if is_first and is_long
        else SELECTION.min_screening_segments
    )
    wanted = steps / _mean_native_steps(problem)
    count = int(np.clip(wanted, min(least, size), size))
    if count >= SELECTION.nearly_all_segments * size:
        return base
    worst = np.argsort(-problem.sum_by_segment(fit.residuals**2))
    hard = (count + 1) // 2
    others = rng.permutation(worst[hard:])
    return base.select(np.sort(np.append(worst[:hard], others[: count // 2])))


def count_native_steps(problem: Problem) -> int:
    """Lengths of the segments in sum [steps of the given model]."""
    return int(problem.segments.lengths.sum() * problem.simulator.coarsening)


def _mean_native_steps(problem: Problem) -> float:
    """Mean length of the segments [steps of the given model]."""
    return count_native_steps(problem) / len(problem.segments)


def mean_seconds(problem: Problem) -> float:
    """Mean length of the segments [s]."""
    return float(problem.segments.lengths.mean() * problem.simulator.timestep)


def draw_segments(problem: Problem, steps: int, rng: np.random.Generator) -> np.ndarray:
    """Draw segments that have about so many simulation steps in sum.

    Args:
        problem: all segments.
        steps: [steps of the given model] of the segments in sum, about.
        rng: draws segments.

    Returns:
        (v) numbers of segments, in order.
    """
    size = len(problem.segments)
    wanted = steps / _mean_native_steps(problem)
    least, seconds = SELECTION.min_search_segments, mean_seconds(problem)
    if seconds >= SELECTION.long_screening_segment:
        least = int(SELECTION.min_search_seconds / seconds)
        least = max(least, SELECTION.min_screening_segments)
    count = int(np.clip(wanted, min(least, size), size))
    if count >= SELECTION.nearly_all_segments * size:
        return np.arange(size)
    return np.sort(rng.permutation(size)[:count])


def subsample_problem(
    problem: Problem, steps: int, rng: np.random.Generator
) -> Problem:
    """The problem in segments drawn at random.

    Args:
        problem: all segments.
        steps: [steps of the given model] of the segments in sum, about.
        rng: draws segments.
    """
    return problem.select(draw_segments(problem, steps, rng))


def find_overlooked_segments(
    problem: Problem, chosen: np.ndarray, fit: Fit
) -> np.ndarray:
    """Find segments that were not drawn and that a fit explains much worse.

    What shows rarely, as a stop does, may be in none of the segments that were drawn.
    In contact none are looked for: a segment may be an outlier by an impact alone.

    Args:
        problem: all segments.
        chosen: (v) numbers of the segments that were drawn.
        fit: the fit to these segments, weighted by their residuals.

    Returns:
        (w) numbers of the segments, the worst ones first.
    """
    others = np.setdiff1d(np.arange(len(problem.segments)), chosen)
    if (
        problem.regime.has_rough_cost
        or problem.regime.has_single_readings
        or not len(others)
    ):
        return others[:0]
    part = fit.problem
    rest = replace(problem.select(others), sigma=part.sigma, simulator=part.simulator)
    rest = marginalize_initial_states(rest, fit.terms, fit.values)
    predicted = rest.residuals_at(fit.terms, fit.values)
    left, usual = (
        _mean_squares(p, r) for p, r in ((rest, predicted), (part, fit.residuals))
    )
    worst = np.argsort(-left)[: len(usual) // 2]
    return others[worst[left[worst] > FIT.outlier_ratio * np.median(usual)]]


def _mean_squares(problem: Problem, residuals: Floats) -> Floats:
    """(W) [1] mean square of the residuals (R) of each segment, missing ones aside."""
    count = problem.sum_by_segment((residuals != 0).astype(float))
    return problem.sum_by_segment(residuals**2) / np.maximum(count, 1)


def screen_candidates(
    bases: Sequence[LinearizedFit],
    candidates: Sequence[Term],
    progress: Progress,
    note_tried: Callable[[Sequence[Term]], None] = lambda terms: None,
) -> tuple[list[Fit], float, list[Term]]:
    """Try candidates one at a time beside a fit, while its values answer linearly.

    Many are first sorted out by a score test (Rao 1948), after which they are fitted
    from the best of their initial values alone.

    Args:
        bases: the same fit in more and more segments; fewer and fewer candidates are
            tried in them.
        candidates: terms to be tried.
        progress: called with a message and a share (0 to 1).
        note_tried: called with the candidates that were just tried.

    Returns:
        Fits with one candidate each in the last of the bases, the best first. How many
        of the candidates are independent (`_count_independent`). And the candidates
        worth another try beside a name.
    """
    fits: list[Fit] = []
    responses: list[Floats] = []
    retried: list[Term] = []
    if len(candidates) > SELECTION.screening_scored:
        order, responses, begun = _score_candidates(
            bases[0], candidates, progress, note_tried
        )
        retried = [candidates[i] for i in order[: SELECTION.max_retried_candidates]]
        candidates = [begun[i] for i in order[: SELECTION.screening_scored]]
    for base, iterations, keep in zip(
        bases,
        SELECTION.screening_iterations,
        SELECTION.screening_kept,
        strict=True,
    ):
        fits = []
        for i, term in enumerate(candidates):
            progress(f"trying {term.label}", i / len(candidates))
            fits.append(fit_candidate(base, term, iterations=iterations))
            note_tried([term])
        responses = responses or [base.fit.residuals - f.residuals for f in fits]
        fits = _sort_by_bic(fits, base.fit.residuals)
        retried = retried or [f.terms[-1] for f in fits]
        fits = fits[:keep] if iterations == 1 else _drop_unpromising(base, fits)[:keep]
        count = len(base.fit.values)
        candidates = [
            replace(f.terms[-1], initial_values=(tuple(f.values[count:]),))
            for f in fits
        ]
    return fits, _count_independent(np.array(responses)), retried


def _score_candidates(
    base: LinearizedFit,
    candidates: Sequence[Term],
    progress: Progress,
    note_tried: Callable[[Sequence[Term]], None],
) -> tuple[np.ndarray, list[Floats], list[Term]]:
    """The order of n candidates by a score test, and what each would change.

    Args:
        base: the fit without a candidate.
        candidates: terms to be tried.
        progress: called with a message and a share (0 to 1).
        note_tried: called with the candidates that were just tried.

    Returns:
        Their numbers (n), the best first; changes (R) of the residuals; and the
        candidates with the best of their initial values alone.
    """
    penalty = _penalize_parameter(base.fit.residuals)
    costs, begun = np.empty(len(candidates)), list(candidates)
    responses = [base.fit.residuals] * len(candidates)
    done = 0
    for numbers, rows in _group_independent(base, candidates):
        terms = [candidates[i] for i in numbers]
        progress(f"trying {terms[0].label}", done / len(candidates))
        done += len(terms)
        found = zip(numbers, estimate_candidates(base, terms, rows), strict=True)
        for i, (cost, response, start) in found:
            costs[i] = cost * penalty ** len(candidates[i].parameters)
            responses[i] = response
            begun[i] = replace(candidates[i], initial_values=(tuple(start),))
        note_tried(terms)
    return np.argsort(costs, kind="stable"), responses, begun


def _group_independent(
    base: LinearizedFit, candidates: Sequence[Term]
) -> list[tuple[list[int], list[np.ndarray]]]:
    """Candidates by their numbers, those together that can be simulated together.

    They are of one effect, in kinematic trees that nothing couples.

    Args:
        base: the fit without a candidate.
        candidates: terms to be tried.

    Returns:
        Of each group the numbers, and of each of several whether a residual (R) is of
        its tree.
    """
    fit, simulator = base.fit, base.problem.simulator
    rows = find_tree_residuals(base.problem, fit.terms, fit.values)
    # what adds a joint may renumber the trees
    given = [t for t in candidates if not implements(t.effect, "edit_spec")]
    trees = dict(zip(given, find_term_trees(simulator, given).tolist(), strict=True))
    groups: list[tuple[list[int], list[np.ndarray]]] = []
    waiting: dict[tuple[str, int], dict[int, list[int]]] = {}
    for i, term in enumerate(candidates):
        tree = trees.get(term, NO_TREE)
        if tree in rows:
            alike = waiting.setdefault((term.effect.name, len(term.parameters)), {})
            alike.setdefault(tree, []).append(i)
        else:
            groups.append(([i], []))
    for by_tree in waiting.values():
        for k in range(max(map(len, by_tree.values()))):
            numbers = {t: each[k] for t, each in by_tree.items() if k < len(each)}
            groups.append((list(numbers.values()), [rows[t] for t in numbers]))
    return groups


def _sort_by_bic(fits: list[Fit], residuals: Floats) -> list[Fit]:
    """Fits with one candidate each, sorted by BIC beside a fit with residuals (R)."""
    penalty = _penalize_parameter(residuals)
    return sorted(fits, key=lambda f: f.cost * penalty ** len(f.terms[-1].parameters))


def _penalize_parameter(residuals: Floats) -> float:
    """The factor of the cost for each new parameter by BIC (Schwarz 1978).

    n log(cost) + p log(n) with n residuals (R) that are not missing and p new
    parameters, here as cost * n^(p / n). Few residuals alone would not hold back a
    candidate with many parameters.
    """
    count = np.count_nonzero(residuals)
    return count ** (1 / count) if count else 1.0


def _drop_unpromising(base: LinearizedFit, fits: list[Fit]) -> list[Fit]:
    """The best fit, and those that gain enough over the fit without a candidate."""
    if base.problem.regime.has_single_readings:  # too few readings to tell
        return fits
    cost, _ = base.minimize(base.fit.residuals)
    limit = (1 - SELECTION.min_screening_gain) * cost
    return [f for i, f in enumerate(fits) if not i or f.cost + f.prior_penalty < limit]


def _count_independent(responses: Floats) -> float:
    """Effective number of tests, between 1 and n.

    Participation ratio of the eigenvalues l of the n candidates' correlations C:

        (sum l)^2 / sum l^2 = n^2 / sum C_ij^2

    (Bretherton et al. 1999; Galwey 2009 has the same with the square roots of l.)

    Args:
        responses: (n, R) [1] what each candidate adds to the residuals.
    """
    size = np.linalg.norm(responses, axis=1)
    unit = responses[size > 0] / size[size > 0, None]
    return len(unit) ** 2 / max(float(((unit @ unit.T) ** 2).sum()), 1.0)
