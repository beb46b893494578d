"""Least squares of a simulation to recordings: takes terms, gives their values."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..simulation.checkpoint import Arrays
from .problem import Problem

STAYS = 0.01  # squared residuals; chosen: nothing against a thousand readings
# a step stays in the neighborhood that gains less than this share of the cost, or after
# which the Jacobian was wrong by less than this share of what is left; chosen
NEAR, WRONG = 0.02, 0.01
# of each curvature: the first is tried alone, the others where it gains less than this
# share of what it promised; a promise of less than this share of the cost is not tried
DAMPING, KEPT, TRIFLE = (1e-4, 1e-2, 1.0, 30.0), 0.75, 1e-3
# of `rested`: steps at most, what it moves values by for slopes [of their scale], and
# the gain [squared residuals] worth a step; chosen: a fifth of a standard deviation
RESTS, FINE, WORTH = 3, 1e-4, 0.05


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a search ended.

    Attributes:
        terms: that were fitted.
        values: (P) of their parameters, in a row.
        residuals: (R) there.
        jacobian: (R, P) there or near.
        is_fine: whether that is there, by differences as fine as errors need.
    """

    terms: tuple[Term, ...]
    values: Floats
    residuals: Floats
    jacobian: Floats
    has_fine_jacobian: bool = False

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def prior_penalty(self) -> float:
        """How far stated values are from what is believed of them [variances]."""
        return float(prior_precision(self.terms) @ (self.values - 1) ** 2)

    def without_terms(self, *gone: Term) -> tuple[tuple[Term, ...], Floats]:
        """The terms without some, and their values."""
        kept = tuple(t for t in self.terms if t not in gone)
        return kept, self.values[self._find_kept_columns(gone)]

    def jacobian_without(self, *gone: Term) -> Floats:
        """The Jacobian without the columns of some terms."""
        return self.jacobian[:, self._find_kept_columns(gone)]

    def _find_kept_columns(self, gone: Sequence[Term]) -> np.ndarray:
        """(P) which parameters stay without some terms."""
        stays = [t not in gone for t in self.terms for _ in t.parameters]
        return np.array(stays, bool)


def stack_bounds(terms: Sequence[Term]) -> tuple[Floats, Floats, Floats]:
    """Low, high and scale (P) of all parameters."""
    return tuple(
        np.concatenate([getattr(t, k) for t in terms] or [np.zeros(0)])
        for k in ("low", "high", "scale")
    )  # type: ignore[return-value]


def prior_precision(terms: Sequence[Term]) -> Floats:
    """Weights (P) by which a careful user believes that stated values' factors are 1.

    Half of what the contract grants is a standard deviation: where readings do not tell
    two values apart, both stay near what the model states.
    """
    low, high, _ = stack_bounds(terms)
    nominal_terms = [t.effect.name == "stated" for t in terms for _ in t.parameters]
    return np.where(nominal_terms, 16 / np.maximum(high - low, 1e-9) ** 2, 0.0)


def solve_bounded_step(
    curvature: Floats, slope: Floats, low: Floats, high: Floats, scale: Floats,
    damping: float = 1e-9,
) -> Floats:  # fmt: skip
    """The move (P) between low and high that lowers a quadratic the most."""
    from scipy.optimize import lsq_linear

    if not len(slope):
        return slope
    h = curvature * np.outer(scale, scale)
    g = slope * scale
    size = np.diag(h)
    # what no reading shows stays: a step of its scale costs a hundredth of a residual
    h = h + np.diag(damping * size + 1e-9 * max(size.max(), 1e-12) + STAYS)
    root = np.linalg.cholesky(h).T
    target = -np.linalg.solve(root.T, g)
    a, b = np.minimum(low / scale, 0), np.maximum(high / scale, 0)
    move = np.linalg.solve(root, target)
    if (move < a).any() or (move > b).any():
        b = np.maximum(b, a + 1e-12)
        move = lsq_linear(root, target, (a, b), method="bvls", max_iter=200).x
    return np.clip(move, a, b) * scale


def compute_jacobian(
    problem: Problem, terms: Sequence[Term], values: Floats, at: Floats, first: int = 0,
    moved: float = 0.0,
) -> Floats:  # fmt: skip
    """Differences (R, P - first) of residuals at values (P), where they are `at` (R).

    By all parameters, or without the first ones; over so much of their scale, or as
    much as suits the problem.
    """
    _, high, scale = (x[first:] for x in stack_bounds(terms))
    own = values[first:]
    if not len(own):
        return np.zeros((len(at), 0))
    moves = (moved or problem.regime.difference_step) * scale
    moves = np.where(own + moves > high, -moves, moves)
    points = np.tile(values, (len(own), 1))
    points[:, first:] += np.diag(moves)
    return ((problem.compute_residuals(terms, points) - at) / moves[:, None]).T


def fit_parameters(
    problem: Problem, terms: Sequence[Term], start: Floats, *, rounds: int = 8,
    gain: float = 1e-3, known: Floats | None = None,
) -> Fit:  # fmt: skip
    """Values of the terms' parameters, within their bounds, that fit best.

    Gauss-Newton with several dampings (Levenberg 1944, Marquardt 1963).

    Args:
        problem: whose residuals shrink.
        terms: what is true beyond the given model.
        start: (P).
        rounds: at most.
        gain: share of the cost below which another round is not worth it.
        known: (R, P), a Jacobian near the start if there is one.
    """
    terms = tuple(terms)
    work_out = partial(_run_gauss_newton, problem, terms, start, rounds, gain, known)
    values, residuals, slopes = problem.simulator.load_or_compute(work_out)
    return Fit(terms, values, residuals, slopes)


def _run_gauss_newton(
    problem: Problem, terms, start: Floats, rounds, gain, known
) -> Arrays:
    """Values, residuals and Jacobian of `fit`."""
    low, high, scale = stack_bounds(terms)
    weights = prior_precision(terms)

    def told(points: Floats) -> list[tuple[float, Floats]]:
        found = problem.compute_residuals(terms, points)
        pull = (weights * (points - 1) ** 2).sum(axis=1)
        return [(float(r @ r + p), r) for r, p in zip(found, pull, strict=True)]

    x = np.clip(np.asarray(start, float), low, high)
    r = problem.residuals_at(terms, x)
    jac = compute_jacobian(problem, terms, x, r) if known is None else known
    nominal_terms = int(np.count_nonzero(weights))  # the first ones
    for _ in range(rounds if len(x) else 0):
        h, g = jac.T @ jac + np.diag(weights), jac.T @ r + weights * (x - 1)
        before = float(r @ r + weights @ (x - 1) ** 2)

        propose = partial(_propose_step, x, before, h, g, low, high, scale)
        best = find_lowest(before, propose, told)
        if best is None and known is not None:
            jac, known = compute_jacobian(problem, terms, x, r), None
            continue
        if best is None:
            break
        point, cost, there = best
        move, change = point - x, there - r
        x, r, gained = point, there, before - cost
        wrong = change - jac @ move
        if gained < NEAR * before or wrong @ wrong < WRONG * (r @ r):
            jac = update_broyden(jac, move, change, scale)
        elif problem.regime.is_nonsmooth:  # and that is most of what it was wrong by
            jac = update_broyden(jac, move, change, scale)[:, :nominal_terms]
            jac = known = np.hstack(
                [jac, compute_jacobian(problem, terms, x, r, nominal_terms)]
            )
        else:
            jac, known = compute_jacobian(problem, terms, x, r), None
        if gained < gain * before:
            break
    return x, r, jac


def _propose_step(x, cost, h, g, low, high, scale, damping) -> tuple[float, Floats]:
    """The cost that a step from values (P) promises, and where it leads."""
    move = solve_bounded_step(h, g, low - x, high - x, scale, damping)
    return float(cost + (2 * g + h @ move) @ move), x + move


def find_lowest(
    cost: float, propose: Callable[[float], tuple[float, Floats]],
    tell: Callable[[Floats], Sequence[tuple]], least: float = 0.0,
) -> tuple | None:  # fmt: skip
    """The best of some steps: the least damped one, others if it keeps too little.

    Args:
        cost: where the steps begin.
        propose: of a damping, the cost that its step promises, and where it leads (p).
        tell: of places (n, p), what is there, first of all the cost.
        least: share of the cost, a promise below which is not tried.

    Returns:
        The place and what is told of it; None where none is lower.
    """
    best, now = None, cost
    for dampings in DAMPING[:1], DAMPING[1:]:
        promises, places = zip(*map(propose, dampings), strict=True)
        promised = cost - min(promises)
        if promised < least * cost:
            break
        for place, predicted in zip(places, tell(np.array(places)), strict=True):
            if predicted[0] < now:
                best, now = (place, *predicted), predicted[0]
        if cost - now > KEPT * promised:
            break
    return best


def refine_undamped(problem: Problem, found: Fit) -> Fit:
    """The same fit where what is believed has had its way.

    Readings without a torque leave all masses, gains and frictions free together, up
    to one factor: a curved valley along which damped steps hardly move. Plain
    Gauss-Newton follows it, over its walls if need be, with slopes fine enough to tell
    how flat it is.
    """
    terms, x, r = found.terms, found.values, found.residuals
    low, high, scale = stack_bounds(terms)
    weights = prior_precision(terms)
    best, least = found, np.inf
    for last in range(RESTS + 1):
        jac = compute_jacobian(problem, terms, x, r, moved=FINE)
        cost = float(r @ r + weights @ (x - 1) ** 2)
        if cost < least:
            best, least = Fit(terms, x, r, jac, has_fine_jacobian=True), cost
        h, g = jac.T @ jac + np.diag(weights), jac.T @ r + weights * (x - 1)
        move = solve_bounded_step(h, g, low - x, high - x, scale)
        if last == RESTS or -(2 * g + h @ move) @ move < WORTH:
            break
        x = x + move
        r = problem.residuals_at(terms, x)
    return best


def refine_jacobian(problem: Problem, found: Fit) -> Fit:
    """The same fit with slopes of where it is, as fine as its errors need.

    Over the moves of a search readings of long pieces bend, and along a valley, in
    which large slopes cancel, what is left of them would look like knowledge. Where
    something touches, fine slopes tell of the roughness alone.
    """
    if problem.regime.is_nonsmooth or found.has_fine_jacobian:
        return found
    x, r = found.values, found.residuals
    jac = compute_jacobian(problem, found.terms, x, r, moved=FINE)
    return replace(found, jacobian=jac, has_fine_jacobian=True)


def update_broyden(jac: Floats, move: Floats, change: Floats, scale: Floats) -> Floats:
    """The Jacobian after a small move, by what that changed (Broyden 1965)."""
    size = move / scale
    if not size.any():
        return jac
    return jac + np.outer(change - jac @ move, size / scale / (size @ size))
