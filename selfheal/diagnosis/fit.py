"""Least squares of a simulation to recordings: takes terms, gives their values."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..recording.data import Floats
from .memory import Answer
from .problem import FAR, Problem
from .terms import Term

# of a parameter's scale, for differences; chosen: above solver noise; of a motion that
# touches, readings jump at whatever change, and a slope over a small one tells of that
NUDGE, COARSE = 0.02, 0.3
# times a value, where to look for better ones: far and near
ABOUT, CLOSE = (0.5, 0.7, 0.85, 1.2, 1.4, 2.0), (0.9, 0.95, 1.05, 1.1)
LOST = 0.5  # of the residuals so far off, from which no search begins; chosen
STAYS = 0.01  # squared residuals; chosen: nothing against a thousand readings
# a step stays in the neighborhood that gains less than this share of the cost, or after
# which the Jacobian was wrong by less than this share of what is left; chosen
NEAR, WRONG = 0.02, 0.01
# of each curvature: the first is tried alone, the others where it gains less than this
# share of what it promised; a promise of less than this share of the cost is not tried
DAMPING, KEPT, TRIFLE = (1e-4, 1e-2, 1.0, 30.0), 0.75, 1e-3
# of `rested`: steps at most, what it moves values by for slopes [of their scale], and
# the gain [squared residuals] worth a step; chosen: a fifth of a standard deviation
RESTS, FINE, WORTH = 3, 5e-4, 0.05


@dataclass(frozen=True, eq=False)
class Fit:
    """Where a search ended.

    Attributes:
        terms: that were fitted.
        values: (P) of their parameters, in a row.
        residuals: (R) there.
        jacobian: (R, P) there or near.
    """

    terms: tuple[Term, ...]
    values: Floats
    residuals: Floats
    jacobian: Floats

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def strain(self) -> float:
        """How far stated values are from what is believed of them [variances]."""
        return float(believed(self.terms) @ (self.values - 1) ** 2)

    def but(self, *gone: Term) -> tuple[tuple[Term, ...], Floats]:
        """The terms without some, and their values."""
        kept = tuple(t for t in self.terms if t not in gone)
        return kept, self.values[self._columns(gone)]

    def near(self, *gone: Term) -> Floats:
        """The Jacobian without the columns of some terms."""
        return self.jacobian[:, self._columns(gone)]

    def _columns(self, gone: Sequence[Term]) -> np.ndarray:
        """(P) which parameters stay without some terms."""
        stays = [t not in gone for t in self.terms for _ in t.parameters]
        return np.array(stays, bool)


def bounds(terms: Sequence[Term]) -> tuple[Floats, Floats, Floats]:
    """Low, high and scale (P) of all parameters."""
    return tuple(
        np.concatenate([getattr(t, k) for t in terms] or [np.zeros(0)])
        for k in ("low", "high", "scale")
    )  # type: ignore[return-value]


def believed(terms: Sequence[Term]) -> Floats:
    """Weights (P) by which a careful user believes that stated values' factors are 1.

    Half of what the contract grants is a standard deviation: where readings do not tell
    two values apart, both stay near what the model states.
    """
    low, high, _ = bounds(terms)
    stated = [t.effect.name == "stated" for t in terms for _ in t.parameters]
    return np.where(stated, 16 / np.maximum(high - low, 1e-9) ** 2, 0.0)


def step(
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


def jacobian(
    problem: Problem, terms: Sequence[Term], values: Floats, at: Floats, first: int = 0,
    moved: float = 0.0,
) -> Floats:  # fmt: skip
    """Differences (R, P - first) of residuals at values (P), where they are `at` (R).

    By all parameters, or without the first ones; over so much of their scale, or as
    much as suits the problem.
    """
    _, high, scale = (x[first:] for x in bounds(terms))
    own = values[first:]
    if not len(own):
        return np.zeros((len(at), 0))
    rough = problem.world.touches and not problem.windows.is_single
    moves = (moved or (COARSE if rough else NUDGE)) * scale
    moves = np.where(own + moves > high, -moves, moves)
    points = np.tile(values, (len(own), 1))
    points[:, first:] += np.diag(moves)
    return ((problem.residuals(terms, points) - at) / moves[:, None]).T


def fit(
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
    question = ("fit", terms, np.asarray(start, float), rounds, gain, known)
    work_out = partial(_fitted, problem, terms, start, rounds, gain, known)
    return Fit(terms, *problem.recall(question, work_out))


def _fitted(problem: Problem, terms, start: Floats, rounds, gain, known) -> Answer:
    """Values, residuals and Jacobian of `fit`."""
    low, high, scale = bounds(terms)
    weights = believed(terms)
    x = np.clip(np.asarray(start, float), low, high)
    r = problem.at(terms, x)
    jac = jacobian(problem, terms, x, r) if known is None else known
    for _ in range(rounds if len(x) else 0):
        h, g = jac.T @ jac + np.diag(weights), jac.T @ r + weights * (x - 1)
        cost = before = float(r @ r + weights @ (x - 1) ** 2)
        point, there = x, r
        for dampings in DAMPING[:1], DAMPING[1:]:
            moves = [step(h, g, low - x, high - x, scale, d) for d in dampings]
            promised = -max((2 * g + h @ m) @ m for m in moves)
            told = problem.residuals(terms, x + np.array(moves))
            for move, new in zip(moves, told, strict=True):
                new_cost = float(new @ new + weights @ (x + move - 1) ** 2)
                if new_cost < cost:
                    cost, point, there = new_cost, x + move, new
            if before - cost > KEPT * promised:
                break
        if cost >= before and known is not None:
            jac, known = jacobian(problem, terms, x, r), None
            continue
        if cost >= before:
            break
        move, change = point - x, there - r
        x, r, gained = point, there, before - cost
        wrong = change - jac @ move
        if gained < NEAR * before or wrong @ wrong < WRONG * (r @ r):
            jac = _secant(jac, move, change, scale)
        else:
            jac, known = jacobian(problem, terms, x, r), None
        if gained < gain * before:
            break
    return x, r, jac


def rested(problem: Problem, found: Fit) -> Fit:
    """The same fit where what is believed has had its way.

    Readings without a torque leave all masses, gains and frictions free together, up
    to one factor: a curved valley along which damped steps hardly move. Plain
    Gauss-Newton follows it, over its walls if need be, with slopes fine enough to tell
    how flat it is.
    """
    terms, x, r = found.terms, found.values, found.residuals
    low, high, scale = bounds(terms)
    weights = believed(terms)
    best, least = found, np.inf
    for last in range(RESTS + 1):
        jac = jacobian(problem, terms, x, r, moved=FINE)
        cost = float(r @ r + weights @ (x - 1) ** 2)
        if cost < least:
            best, least = Fit(terms, x, r, jac), cost
        h, g = jac.T @ jac + np.diag(weights), jac.T @ r + weights * (x - 1)
        move = step(h, g, low - x, high - x, scale)
        if last == RESTS or -(2 * g + h @ move) @ move < WORTH:
            break
        x = x + move
        r = problem.at(terms, x)
    return best


def looked_about(
    problem: Problem, terms: Sequence[Term], values: Floats, about=ABOUT
) -> Floats:
    """The values (P), or better ones at so many times one of them.

    Where impacts make the cost rough a search ends in the nearest of many minima, and
    one window, in which a body falls on another side, may outweigh all others: so each
    counts by the logarithm of its cost, as if each had a noise of its own. Single
    readings are too few for that.
    """
    if problem.windows.is_single:
        return values
    low, high, _ = bounds(terms)
    least = problem.by_window(np.ones(len(problem.window_of)))
    stated = [t.effect.name == "stated" for t in terms for _ in t.parameters]
    for i in np.flatnonzero(~np.array(stated, bool)):
        points = np.tile(values, (1 + len(about), 1))
        points[1:, i] = np.clip(values[i] * np.array(about), low[i], high[i])
        told = problem.residuals(terms, points) ** 2
        costs = [np.log(least + problem.by_window(r)).sum() for r in told]
        values = points[int(np.argmin(costs))]
    return values


def _secant(jac: Floats, move: Floats, change: Floats, scale: Floats) -> Floats:
    """The Jacobian after a small move, by what that changed (Broyden 1965)."""
    size = move / scale
    if not size.any():
        return jac
    return jac + np.outer(change - jac @ move, size / scale / (size @ size))


@dataclass(frozen=True, eq=False)
class Base:
    """A fit in whose neighborhood other effects are tried.

    Attributes:
        problem: that was fitted.
        fit: its best values.
        weights: (P) of what is believed.
        curvature: (P, P), of what is believed too.
    """

    problem: Problem
    fit: Fit
    weights: Floats
    curvature: Floats

    @classmethod
    def of(cls, problem: Problem, found: Fit) -> "Base":
        """With the curvature worked out."""
        weights = believed(found.terms)
        curvature = found.jacobian.T @ found.jacobian + np.diag(weights)
        return cls(problem, found, weights, curvature)

    def take(self, chosen: np.ndarray) -> "Base":
        """The same fit in some of the windows."""
        windows, found = self.problem.windows, self.fit
        width = windows.readings.shape[1]
        rows = windows.rows(chosen)[:, None] * width + np.arange(width)
        r, jac = found.residuals[rows.ravel()], found.jacobian[rows.ravel()]
        return Base.of(
            self.problem.take(chosen), Fit(found.terms, found.values, r, jac)
        )

    def slope(self, r: Floats) -> Floats:
        """(P) of the cost at residuals r (R), with the pull of what is believed."""
        return self.fit.jacobian.T @ r + self.weights * (self.fit.values - 1)

    def settle(self, r: Floats, hold: np.ndarray | None = None) -> tuple[float, Floats]:
        """Lowest cost and the move (P) to it, of residuals r if the rest is linear.

        Args:
            r: (R).
            hold: numbers of parameters that do not move.
        """
        low, high, scale = bounds(self.fit.terms)
        x = self.fit.values
        g = self.slope(r)
        low, high = low - x, high - x
        if hold is not None:
            low[hold] = high[hold] = 0.0
        move = step(self.curvature, g, low, high, scale)
        cost = r @ r + 2 * g @ move + move @ self.curvature @ move
        return float(cost + self.weights @ (x - 1) ** 2), move


def try_term(base: Base, term: Term, *, rounds: int = 4) -> Fit:
    """The best of one more term, while all others answer linearly.

    Returns:
        All terms; residuals and Jacobian are those of the linear answer.
    """
    found = base.fit
    question = ("try", found.terms, found.values, found.residuals, found.jacobian,
                term, rounds)  # fmt: skip
    x, r, jac, move = base.problem.recall(question, partial(_tried, base, term, rounds))
    return Fit(
        (*found.terms, term), np.concatenate([found.values + move, x]),
        r + found.jacobian @ move, np.hstack([found.jacobian, jac]),
    )  # fmt: skip


def _tried(base: Base, term: Term, rounds: int) -> Answer:
    """The term's values, residuals and Jacobian, and the move of all others."""
    problem, terms = base.problem, (*base.fit.terms, term)
    low, high, scale = term.low, term.high, term.scale
    fixed = base.fit.values

    def residuals(points: Floats) -> Floats:
        rows = np.hstack([np.tile(fixed, (len(points), 1)), points])
        return problem.residuals(terms, rows)

    def slopes(x: Floats, r: Floats) -> Floats:
        return jacobian(problem, terms, np.append(fixed, x), r, len(fixed))

    points = np.array(term.starts, float).reshape(len(term.starts), -1)
    told = residuals(points)
    if term.effect.waves and len(points) > 1:
        points = np.clip(_best_wave(base, points, told), low, high)
        told = residuals(points)
    if (np.abs(told) >= FAR).mean(axis=1).min() > LOST:
        rounds = 0
    settled = [base.settle(r) for r in told]
    best = int(np.argmin([c for c, _ in settled]))
    x, r, (cost, move) = points[best], told[best], settled[best]
    jac = slopes(x, r) if rounds else np.zeros((len(r), len(x)))
    for _ in range(rounds if len(x) else 0):
        before, point, there = cost, x, r
        for dampings in DAMPING[:1], DAMPING[1:]:
            steps = [
                _joint_step(base, jac, r, x, low, high, scale, d) for d in dampings
            ]
            promised = before - steps[0][0]
            if promised < TRIFLE * before:
                break
            told = residuals(x + np.array([m for _, m in steps]))
            for (_, own), new in zip(steps, told, strict=True):
                new_cost, others = base.settle(new)
                if new_cost < cost:
                    cost, move, point, there = new_cost, others, x + own, new
            if before - cost > KEPT * promised:
                break
        if cost >= before * (1 - 1e-6):
            break
        moved, change = point - x, there - r
        x, r = point, there
        if rounds == 1 or before - cost < 2e-3 * before:
            jac = _secant(jac, moved, change, scale)
            break
        wrong = change - jac @ moved
        if wrong @ wrong < WRONG * (r @ r):
            jac = _secant(jac, moved, change, scale)
        else:
            jac = slopes(x, r)
    return x, r, jac, move


def _best_wave(base: Base, points: Floats, told: Floats) -> Floats:
    """Amplitude, frequency and phase (1, 3) that explain most if all answers linearly.

    By the sine and the cosine of each frequency (Lomb 1976), fitted with all else.

    Args:
        base: the fit without it.
        points: (2 n, 3) starts, those of a frequency a quarter turn apart.
        told: (2 n, R) residuals with them.
    """
    r, jac = base.fit.residuals, base.fit.jacobian
    best, most = points[:1], 0.0
    for k in range(0, len(points), 2):
        pair = (told[k : k + 2] - r).T
        cross = jac.T @ pair
        h = np.block([[base.curvature, cross], [cross.T, pair.T @ pair]])
        g = np.concatenate([base.slope(r), pair.T @ r])
        x = -np.linalg.lstsq(h, g, rcond=1e-12)[0]
        if -g @ x > most:
            most, (sine, cosine) = -g @ x, x[-2:]
            phase = np.mod(points[k, 2] + np.arctan2(cosine, sine), 2 * np.pi)
            wave = points[k, 0] * np.hypot(sine, cosine), points[k, 1], phase
            best = np.array([wave])
    return best


def _joint_step(base: Base, jac, r, x, low, high, scale, damping):
    """The cost that a move of all values promises, and the move of the term's own."""
    all_low, all_high, all_scale = bounds(base.fit.terms)
    cross = base.fit.jacobian.T @ jac
    h = np.block([[base.curvature, cross], [cross.T, jac.T @ jac]])
    g = np.concatenate([base.slope(r), jac.T @ r])
    move = step(
        h, g,
        np.concatenate([all_low - base.fit.values, low - x]),
        np.concatenate([all_high - base.fit.values, high - x]),
        np.concatenate([all_scale, scale]), damping,
    )  # fmt: skip
    cost = r @ r + base.weights @ (base.fit.values - 1) ** 2
    return float(cost + (2 * g + h @ move) @ move), move[len(base.fit.values) :]
