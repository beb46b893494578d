"""Ranking of moves: takes a fit and directions, gives what each would gain."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.terms import find_other_forms, find_restated, is_distinct
from ..estimation.quadratic_model import solve_bounded_step
from .errors import Direction
from .fit import LinearFit, invert

# share of a column's norm that has to be its own, beside those before it; chosen: what
# is less is the same direction
OWN_SHARE = 1e-3
ERROR_ROUNDING = 1e-9  # share of the errors below which a change of them is none
RANKED = 60  # moves whose likelihood is computed, those best by its curvature
LEAST_VOLUME = -0.9  # change of a row's volume, in its first order
COLLINEAR_SHARE = 1e-4  # of a direction's curvature, that is left beside the others
SOLVER_SHARE = 1e-9  # of the diagonal, that is added to it; below what values show
BOUND_MARGIN = 1e-6  # scales from a bound within which a value is at it

Move = tuple[Direction, ...]


def name_move(move: Move) -> str:
    """What tells a move from others, whatever its initial values."""
    return str(move[0].term.key) if len(move) == 1 else label_move(move)


def label_move(move: Move) -> str:
    """A move for a reader."""
    if len(move) == 1:
        return move[0].term.label
    effects = dict.fromkeys(d.term.effect.name for d in move)
    return f"{', '.join(effects)} at {len(move)} places"


def propose_directions(fit: LinearFit, term: Term) -> list[Direction]:
    """The directions of a candidate beside a fit.

    They are the derivatives at nominal values, where these are finite, and what each of
    its initial values changes.
    """
    model, terms, errors = fit.model, fit.terms, fit.plain_errors
    values = fit.values[: fit.count]
    nominal = np.array([p.nominal for p in term.parameters])
    first = np.cumsum([0, *(len(t.parameters) for t in terms)])
    for k, i in find_restated(term, terms).items():  # which is no more as given
        nominal[k] *= values[first[i]]
    points = np.array([np.array(x) for x in dict.fromkeys(term.initial_values)])
    is_finite = bool(np.isfinite(nominal).all())
    steps = np.zeros((0, len(nominal)))
    if is_finite:
        steps = np.diag(model.derivative_step * term.scale)
        inside = np.clip(nominal, term.low, term.high)
        steps = np.where((inside + np.diag(steps) > term.high)[:, None], -steps, steps)
    tried = np.vstack([nominal + steps, points]) if is_finite else points
    beside = np.hstack([np.tile(values, (len(tried), 1)), tried])
    found = model.compute_changes((*terms, term), beside, errors)
    changes, volumes = found.values, found.volume
    start = nominal if is_finite else np.full(len(nominal), np.nan)
    count, out = len(steps), []
    size = np.linalg.norm(changes, axis=1)
    is_shown = size > ERROR_ROUNDING * np.linalg.norm(errors.values)  # and no NaN
    shown = np.flatnonzero(is_shown[:count])
    if len(shown):
        unit = 1 / model.derivative_step
        own = (unit * x[shown] for x in (steps, changes, volumes))
        out.append(Direction(term, start, *own))
    width = 2 if term.is_wave else 1
    for i in range(count, len(tried) - width + 1, width):
        a = slice(i, i + width)
        columns = changes[a]
        if not is_shown[a].all():
            continue
        if len(shown) and not _is_new(columns, changes[shown]):
            continue
        unit_steps = tried[a] - start if is_finite else tried[a]
        out.append(Direction(term, start, unit_steps, columns, volumes[a]))
    return out


def _is_new(columns: Floats, known: Floats) -> bool:
    """Whether columns (k, n) are no combination of known ones (m, n); NaN are not."""
    basis, _ = np.linalg.qr(known.T)
    rest = columns - (columns @ basis) @ basis.T
    share = np.linalg.norm(rest, axis=1) / np.linalg.norm(columns, axis=1)
    return bool((share > OWN_SHARE).any())


def can_stand_beside(term: Term, named: Sequence[Term]) -> bool:
    """Whether no name has the term's effect there, nor a form of the same law."""
    return is_distinct(term, named) and not find_other_forms(term, named)


def list_moves(fit: LinearFit, directions: Sequence[Direction]) -> list[Move]:
    """What may be added: each direction, an effect at all its places, all usual ones.

    What one drive has the others often have as well; one by one, the first would stand
    for all of them.
    """
    open_directions = [d for d in directions if can_stand_beside(d.term, fit.named)]
    groups: dict[str, dict[tuple, Direction]] = {}
    for d in open_directions:
        groups.setdefault(d.term.effect.name, {}).setdefault(d.term.targets, d)
    moves: list[Move] = [(d,) for d in open_directions]
    moves += [tuple(g.values()) for g in groups.values() if len(g) > 1]
    usual = [d for g in groups.values() for d in g.values() if d.term.is_usual]
    if len({d.term.effect.name for d in usual}) > 1:
        moves.append(tuple(usual))
    return moves


@dataclass(frozen=True, eq=False)
class _Relaxed:
    """A fit whose values answer to first order, and directions beside it.

    Attributes:
        fit: as it is.
        free: (f) numbers of its values that are not at a bound.
        step: (P + K) to its lowest cost.
        columns: (k, R C) changes of the errors by all directions.
        volumes: (k) those of their volume.
        own: (k, k) curvature beside the free values.
        whole: (k) its diagonal alone.
        score: (k) gradient beside the free values.
        solved: (k, f) how the free values answer.
    """

    fit: LinearFit
    free: np.ndarray
    step: Floats
    columns: Floats
    volumes: Floats
    own: Floats
    whole: Floats
    score: Floats
    solved: Floats

    def predict_gain(self, of: np.ndarray, coordinates: Floats) -> float:
        """Gain of the likelihood [nats] by coordinates (c) of directions `of` (c)."""
        jacobian, rows = self.fit.jacobian, self.fit.rows
        moved, volume, before = self._stepped
        answers = coordinates @ self.solved[of]
        change = coordinates @ self.columns[of] - answers @ jacobian.values[self.free]
        more = coordinates @ self.volumes[of] - answers @ jacobian.volume[self.free]
        more = rows * np.log1p(max(more / rows, LEAST_VOLUME))
        after = self.fit.whitening.predict_loss(moved + change, volume + float(more))
        return before - after

    @cached_property
    def _stepped(self) -> tuple[Floats, float, float]:
        """Changes of errors (R C) and volume by the step, and the loss [nats]."""
        moved = self.step @ self.fit.jacobian.values
        volume = float(self.step @ self.fit.jacobian.volume)
        return moved, volume, self.fit.whitening.predict_loss(moved, volume)


def _relax(fit: LinearFit, directions: Sequence[Direction]) -> _Relaxed:
    """Let the values of a fit answer to directions (Schur complement)."""
    h, g = fit.quadratic_model
    low, high, scale = fit.bounds
    step = solve_bounded_step(
        h, g, low - fit.values, high - fit.values, scale, SOLVER_SHARE
    )
    at, margin = fit.values + step, BOUND_MARGIN * scale
    free = np.flatnonzero((at > low + margin) & (at < high - margin))
    x, rows = np.vstack([d.columns for d in directions]), fit.rows
    volumes = np.concatenate([d.volumes for d in directions])
    whitening, own_volumes = fit.whitening, fit.jacobian.volume
    xw, jw = whitening.apply(x), whitening.apply(fit.jacobian.values)
    errors = (whitening.weights * whitening.errors).ravel() + step @ jw
    cross = xw @ jw[free].T + np.outer(volumes, own_volumes[free]) / rows
    solved = cross @ invert(h[np.ix_(free, free)])
    score = xw @ errors - volumes * (1 - step @ own_volumes / rows)
    score -= solved @ (g + h @ step)[free]
    whole = xw @ xw.T + np.outer(volumes, volumes) / rows
    own = whole - solved @ cross.T
    return _Relaxed(
        fit, free, step, x, volumes, own, np.diag(whole).copy(), score, solved
    )


def rank(fit: LinearFit, moves: Sequence[Move]) -> list[tuple[float, Move, Floats]]:
    """Gain [nats], move and coordinates (k) of each beside a fit, the best first.

    Of the best ones by the quadratic model the gain is that of the likelihood itself.
    """
    if not moves:
        return []
    directions = list({id(d): d for m in moves for d in m}.values())
    ends = np.cumsum([0, *(len(d.columns) for d in directions)])
    columns = {
        id(d): np.arange(a, b)
        for d, a, b in zip(directions, ends[:-1], ends[1:], strict=True)
    }
    relaxed = _relax(fit, directions)
    found = []
    for move in moves:
        a = np.concatenate([columns[id(d)] for d in move])
        own, score = relaxed.own[np.ix_(a, a)], relaxed.score[a]
        if (np.diag(own) < COLLINEAR_SHARE * relaxed.whole[a]).any():
            continue
        low, high = (
            np.concatenate(bounds)
            for bounds in zip(*(d.bounds for d in move), strict=True)
        )
        size = 1 / np.sqrt(np.diag(own))
        z = solve_bounded_step(own, score, low, high, size, SOLVER_SHARE)
        found.append((float(-(score @ z + 0.5 * z @ own @ z)), move, z, a))
    found.sort(key=lambda each: -each[0])
    best: dict[str, tuple[float, Move, Floats]] = {}
    for _, move, z, a in found[:RANKED]:
        gain = relaxed.predict_gain(a, z)
        if name_move(move) not in best or gain > best[name_move(move)][0]:
            best[name_move(move)] = gain, move, z
    return sorted(best.values(), key=lambda each: -each[0])
