"""Search for sets of effects in the linear model: takes directions, gives terms."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...recording.data import Floats
from ..effects.base import Term
from ..effects.terms import is_distinct
from ..estimation.quadratic_model import (
    prior_precision,
    solve_bounded_step,
    stack_bounds,
)
from .model import (
    Direction,
    compute_errors,
    compute_nuisance,
    differentiate,
    estimate_noise,
    make_reference,
    propose_directions,
)
from .motion import MeasuredMotion

FREEDOM = 4.0  # degrees of freedom of Student's t
RARITY_NATS = np.log(10.0)
NUISANCE_BOUND = 1.0
SCREENED_MOMENTS = 500
FINALISTS = 30
TRIED = 4


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Stated values and effects fitted to equation errors.

    Attributes:
        motion: as measured.
        terms: stated ones first.
        values: (P) and then of nuisances (K).
        errors: (R J) at the values, with nuisances.
        jacobian: (P + K, R J) near them.
        stated: number of stated terms.
    """

    motion: MeasuredMotion
    terms: tuple[Term, ...]
    values: Floats
    errors: Floats
    jacobian: Floats
    nuisance: int
    stated: int

    @property
    def named(self):
        return self.terms[self.stated :]

    @property
    def count(self):
        return len(self.values) - self.nuisance

    @property
    def slices(self):
        ends = np.cumsum([0, *(len(t.parameters) for t in self.terms)])
        return [slice(a, b) for a, b in zip(ends[:-1], ends[1:])]

    def values_of(self, i):
        return self.values[self.slices[i]]

    @property
    def prior(self):
        """Precisions and means (P + K)."""
        precision = np.append(prior_precision(self.terms), np.ones(self.nuisance))
        mean = np.append(np.ones(self.count), np.zeros(self.nuisance))
        return precision, mean

    @property
    def bounds(self):
        low, high, scale = stack_bounds(self.terms)
        k = np.full(self.nuisance, NUISANCE_BOUND)
        return np.append(low, -k), np.append(high, k), np.append(scale, k)

    def evaluate(self, values, terms=None):
        """Errors at other values (P + K)."""
        p = len(values) - self.nuisance
        return (
            compute_errors(self.motion, terms or self.terms, values[None, :p])[0]
            + values[p:] @ self.jacobian[self.count :]
        )

    def relinearized(self, in_torques=False):
        p = self.count
        plain = self.errors - self.values[p:] @ self.jacobian[p:]
        reference = make_reference(self.motion, self.terms, self.values[:p]) if in_torques else None
        j = differentiate(self.motion, self.terms, self.values[:p], plain, reference=reference)
        n = compute_nuisance(self.motion, self.terms, self.values[None, :p], plain)
        new = replace(self, jacobian=np.vstack([j, n]))
        return replace(new, errors=plain + self.values[p:] @ n)

    def select(self, rows):
        """The fit in some windows."""
        width = self.motion.width
        cut = lambda x: x.reshape(*x.shape[:-1], -1, width)[..., rows, :].reshape(*x.shape[:-1], -1)
        return replace(self, motion=self.motion.select(rows), errors=cut(self.errors), jacobian=cut(self.jacobian))


def weigh(motion, errors):
    """(R J) weights of Student's t over the squared scale of each joint's errors."""
    r = errors.reshape(-1, motion.width)
    scale = _scale(r)
    w = (FREEDOM + 1) / (FREEDOM + (r / scale) ** 2)
    return (w / scale**2).ravel()


def _scale(r):
    scale = 1.4826 * np.median(np.abs(r), axis=0)
    scale = np.maximum(scale, 1e-12 + 1e-3 * np.sqrt((r**2).mean(axis=0)))
    for _ in range(20):
        w = (FREEDOM + 1) / (FREEDOM + (r / scale) ** 2)
        scale = np.sqrt((w * r**2).mean(axis=0))
    return scale


def loss(motion, errors):
    """Negative log-likelihood [nats] of Student's t with each joint's own scale."""
    r = errors.reshape(-1, motion.width)
    if not np.isfinite(r).all():
        return np.inf
    scale = _scale(r)
    return float(
        len(r) * np.log(scale).sum()
        + (FREEDOM + 1) / 2 * np.log1p((r / scale) ** 2 / FREEDOM).sum()
    )


def independence(motion, errors, w):
    """(J) share of independent rows, by the autocorrelation of weighted errors."""
    x = (np.sqrt(w) * errors).reshape(-1, motion.width)
    n, shares = len(x), []
    for column in x.T:
        total, power = 1.0, column @ column
        for lag in range(1, n // 4):
            rho = column[lag:] @ column[:-lag] / power
            if rho < 2 / np.sqrt(n):
                break
            total += 2 * rho
        shares.append(1 / total)
    return np.array(shares)


def penalized(fit):
    precision, mean = fit.prior
    return loss(fit.motion, fit.errors) + 0.5 * precision @ (fit.values - mean) ** 2


def normal_equations(fit, w):
    precision, mean = fit.prior
    h = (fit.jacobian * w) @ fit.jacobian.T + np.diag(precision)
    g = (fit.jacobian * w) @ fit.errors + precision * (fit.values - mean)
    return h, g


def descend(fit: LinearFit, iterations=12) -> LinearFit:
    """Gauss-Newton with the Jacobian held and the errors computed (chord method)."""
    low, high, scale = fit.bounds
    cost = penalized(fit)
    shrink = 1.0
    for _ in range(iterations):
        h, g = normal_equations(fit, weigh(fit.motion, fit.errors))
        step = solve_bounded_step(h, g, low - fit.values, high - fit.values, scale, 1e-7)
        while True:
            values = fit.values + shrink * step
            new = replace(fit, values=values, errors=fit.evaluate(values))
            after = penalized(new)
            if after < cost or shrink < 0.05:
                break
            shrink /= 3
        if not after < cost:
            break
        gained, cost, fit = cost - after, after, new
        shrink = min(1.0, 2 * shrink)
        if gained < 0.1:
            break
    return fit


def relinearize(fit, iterations=4):
    """Gauss-Newton: the Jacobian anew before each descent."""
    cost = penalized(fit)
    for _ in range(iterations):
        fit = min((descend(fit.relinearized(t), 4) for t in (False, True)), key=penalized)
        after = penalized(fit)
        if cost - after < 0.5:
            break
        cost = after
    return fit


def start(motion, nominal_terms):
    values = np.ones(len(nominal_terms))
    errors = compute_errors(motion, nominal_terms, values[None])[0]
    j = differentiate(motion, nominal_terms, values, errors)
    n = compute_nuisance(motion, nominal_terms, values[None], errors)
    return LinearFit(
        motion, tuple(nominal_terms), np.append(values, np.zeros(len(n))), errors,
        np.vstack([j, n]), len(n), len(nominal_terms),
    )


def penalty(term, count, rows):
    """[nats] by which a term has to lower the loss."""
    return (
        np.log(count)
        + 0.5 * len(term.parameters) * np.log(rows)
        + RARITY_NATS * term.effect.rarity
    )


def propose(fit, candidates):
    """Directions of the candidates that seem best in a part of the windows."""
    motion = fit.motion
    share = len(motion.moments) / SCREENED_MOMENTS
    open_ = [t for t in candidates if is_distinct(t, fit.named)]
    if share > 1.5 and len(open_) > FINALISTS:
        rows = np.unique((np.arange(0, len(motion.windows), share)).astype(int))
        part = fit.select(rows)
        moves = [(d,) for d in _propose(part, open_)]
        ranked = rank(part, moves, weigh(part.motion, part.errors))
        best = {m[0].term.key for _, m, _ in ranked[:FINALISTS]}
        usual = [t for t in open_ if t.effect.is_usual(t)]
        open_ = [t for t in open_ if t.key in best or t in usual]
    return _propose(fit, open_)


def _propose(fit, terms):
    p = fit.count
    plain = fit.errors - fit.values[p:] @ fit.jacobian[p:]
    return propose_directions(fit.motion, fit.terms, fit.values[:p], plain, terms)


def search(motion, nominal_terms, candidates, log=print, most=60):
    """The set of effects that the equation errors ask for, and its values.

    Args:
        motion: as measured.
        nominal_terms: of the values that the model states.
        candidates: terms that may be added.
    """
    count = len(candidates)
    fit = start(motion, nominal_terms)
    directions, is_fresh, tabu = [], False, set()
    log("start", penalized(fit))
    while len(fit.named) < most:
        if not directions:
            directions = propose(fit, candidates)
            is_fresh = True
            log("columns", len(directions))
        w = weigh(motion, fit.errors)
        share = float(independence(motion, fit.errors, w).mean())
        rows = w.size * share
        def least(move): return sum(penalty(d.term, count, rows) for d in move)
        ranked = rank(fit, list_moves(fit, directions, tabu), w)
        ranked.sort(key=lambda each: least(each[1]) - each[0] * share)
        log("  ", len(fit.named), "share", round(share, 2), "  ".join(f"{name(move)} {g:.0f}" for g, move, _ in ranked[:4]))
        new, best, worse = None, 0.0, 0
        for gain, move, coordinates in ranked:
            if gain * share < least(move) or worse == TRIED or (new and worse):
                break
            tried = add(fit, move, coordinates)
            gained = penalized(fit) - penalized(tried)
            values = split(tried)[len(fit.terms):]
            is_small = all(d.term.is_negligible(v) for d, v in zip(move, values))
            log("     ", name(move), [np.round(v, 5).tolist() for v in values][:4], round(gained), "predicted", round(gain), "small" if is_small else "")
            net = gained * share - least(move)
            if net < 0 or is_small:
                tabu.add(name(move))
            if net > best and not is_small:
                new, best = tried, net
            elif new:
                worse += 1
        if new is None:
            if is_fresh or not ranked:
                break
            fit = relinearize(fit)
            directions, tabu = [], set()
            continue
        before = {t.key for t in fit.named}
        fit, is_fresh = backward(new, count, log), False
        tabu |= {str(k) for k in before - {t.key for t in fit.named}}
    return backward(relinearize(fit), count, log)


def name(move):
    if len(move) == 1:
        return str(move[0].term.key)
    return f"{move[0].term.effect.name} at {len(move)}" 


def list_moves(fit, directions, tabu):
    """What may be added: each direction, and usual effects at all their places."""
    open_ = [d for d in directions if is_distinct(d.term, fit.named)]
    moves = [(d,) for d in open_]
    groups = {}
    for d in open_:
        if d.term.effect.is_usual(d.term):
            groups.setdefault(d.term.effect.name, {}).setdefault(d.term.targets, d)
    moves += [tuple(g.values()) for g in groups.values() if len(g) > 1]
    return [m for m in moves if name(m) not in tabu]


def rank(fit, moves, w):
    """(gain [nats], move, coordinates) of each beside the fit, the best first."""
    if not moves:
        return []
    h, g = normal_equations(fit, w)
    low, high, scale = fit.bounds
    step = solve_bounded_step(h, g, low - fit.values, high - fit.values, scale, 1e-9)
    at = fit.values + step
    free = np.flatnonzero((at > low + 1e-6 * scale) & (at < high - 1e-6 * scale))
    directions = list({id(d): d for m in moves for d in m}.values())
    ends = np.cumsum([0, *(len(d.columns) for d in directions)])
    columns = {id(d): np.arange(a, b) for d, a, b in zip(directions, ends[:-1], ends[1:])}
    x = np.vstack([d.columns for d in directions])
    xw = x * w
    cross = xw @ fit.jacobian[free].T
    solved = cross @ invert(h[np.ix_(free, free)])
    rest = fit.errors + step @ fit.jacobian
    score = xw @ rest - solved @ (g + h @ step)[free]
    out = []
    for move in moves:
        a = np.concatenate([columns[id(d)] for d in move])
        whole = xw[a] @ x[a].T
        own = whole - solved[a] @ cross[a].T
        if (np.diag(own) < 1e-4 * np.diag(whole)).any():
            continue
        bounds = [coordinate_bounds(d) for d in move]
        lo, hi = (np.concatenate([b[k] for b in bounds]) for k in (0, 1))
        size = 1 / np.sqrt(np.diag(own))
        z = solve_bounded_step(own, score[a], lo, hi, size, 1e-9)
        gain = -(score[a] @ z + 0.5 * z @ own @ z)
        out.append((float(gain), move, z, a))
    before = loss(fit.motion, rest)
    out.sort(key=lambda each: -each[0])
    gains = []
    for gain, move, z, a in out[:FINALISTS]:
        change = z @ (x[a] - solved[a] @ fit.jacobian[free])
        gains.append((before - loss(fit.motion, rest + change), move, z))
    gains.sort(key=lambda each: -each[0])
    seen: dict[str, tuple] = {}  # the best direction of each term
    for each in gains:
        seen.setdefault(name(each[1]), each)
    return list(seen.values())


def add(fit, move, coordinates):
    """The fit with the terms of a move, from its coordinates on."""
    new, at = [], 0
    for d in move:
        z = coordinates[at : at + len(d.columns)]
        at += len(d.columns)
        is_finite = np.isfinite(d.start).all()
        v = d.start + z @ d.steps if is_finite else d.steps[0]
        new.append(np.clip(v, d.term.low, d.term.high))
    v = np.concatenate(new)
    terms = (*fit.terms, *(d.term for d in move))
    p = fit.count
    values = np.concatenate([fit.values[:p], v, fit.values[p:]])
    errors = fit.evaluate(values, terms)
    plain = errors - values[p + len(v) :] @ fit.jacobian[p:]
    which = touched(terms, len(move))
    jacobian = np.vstack(
        [fit.jacobian[:p], np.zeros((len(v), len(errors))), fit.jacobian[p:]]
    )
    tried = []
    for reference in (None, make_reference(fit.motion, terms, values[: p + len(v)])):
        jacobian[which] = differentiate(
            fit.motion, terms, values[: p + len(v)], plain,
            which=which, reference=reference,
        )  # fmt: skip
        new = replace(fit, terms=terms, values=values, errors=errors, jacobian=jacobian.copy())
        tried.append(descend(new))
    return min(tried, key=penalized)


def touched(terms, count):
    """Numbers of values whose response the last `count` terms may change."""
    new = terms[-count:]
    targets = [b for t in new for b in t.targets]
    out, at = [], 0
    for t in terms:
        k = len(t.parameters)
        if t in new or any(
            a.startswith(b) or b.startswith(a) for a in t.targets for b in targets
        ):
            out += range(at, at + k)
        at += k
    return out


def coordinate_bounds(d):
    """Bounds (k) of coordinates within those of the values."""
    if not np.isfinite(d.start).all():
        return np.zeros(len(d.steps)), np.ones(len(d.steps))
    lo, hi = np.full(len(d.steps), -np.inf), np.full(len(d.steps), np.inf)
    for k, step in enumerate(d.steps):
        for p in np.flatnonzero(step):
            a = (d.term.low[p] - d.start[p]) / step[p]
            b = (d.term.high[p] - d.start[p]) / step[p]
            lo[k], hi[k] = max(lo[k], min(a, b)), min(hi[k], max(a, b))
    return np.minimum(lo, 0), np.maximum(hi, 0)


def invert(h):
    """Inverse of a positive definite matrix whose units differ."""
    size = 1 / np.sqrt(np.maximum(np.diag(h), 1e-30))
    scaled = h * size * size[:, None]
    return np.linalg.inv(scaled + 1e-9 * np.eye(len(h))) * size * size[:, None]


def remove(fit, gone):
    """The fit without some terms, by their numbers."""
    keep = np.ones(len(fit.values), bool)
    for i in gone:
        keep[fit.slices[i]] = False
    terms = tuple(x for k, x in enumerate(fit.terms) if k not in gone)
    less = replace(fit, terms=terms, values=fit.values[keep], jacobian=fit.jacobian[keep])
    return descend(replace(less, errors=less.evaluate(less.values)))


def backward(fit, count, log):
    """Remove terms without which the loss is as low, but for their penalty."""
    needed = set()
    while True:
        gone, least = plan_removal(fit, count, needed)
        if not gone:
            return fit
        while True:
            less = remove(fit, gone)
            lost = penalized(less) - penalized(fit)
            log("     drop", [fit.terms[i].label for i in gone], "lost", round(lost, 1), "of", round(least[len(gone) - 1], 1))
            if lost <= least[len(gone) - 1]:
                fit = less
                break
            if len(gone) == 1:
                needed.add(fit.terms[gone[0]].key)
                break
            gone = gone[: len(gone) // 2]


def plan_removal(fit, count, needed):
    """Numbers of terms to remove, the most needless first, and what each may cost."""
    w = weigh(fit.motion, fit.errors)
    share = independence(fit.motion, fit.errors, w).mean()
    rows = w.size * share
    inverse = invert(normal_equations(fit, w)[0])
    offs = {}
    for i, t in list(enumerate(fit.terms))[fit.stated :]:
        if t.key in needed:
            continue
        nominal = np.clip([p.nominal for p in t.parameters], t.low, t.high)
        offs[i] = fit.values[fit.slices[i]] - nominal
    gone, least, total, spent = [], [], 0.0, 0.0
    while offs:
        best = None
        for i in offs:
            columns = np.concatenate([np.r_[fit.slices[k]] for k in [*gone, i]]).astype(int)
            off = np.concatenate([*(done[k] for k in gone), offs[i]]) if gone else offs[i]
            cost = 0.5 * off @ invert(inverse[np.ix_(columns, columns)]) @ off if len(off) else 0.0
            net = (cost - spent) * share - penalty(fit.terms[i], count, rows)
            if best is None or net < best[0]:
                best = net, cost, i
        net, cost, i = best
        if net >= 0:
            break
        if not gone:
            done = {}
        done[i] = offs.pop(i)
        spent = cost
        total += penalty(fit.terms[i], count, rows) / share
        gone.append(i)
        least.append(total)
    return gone, least


def split(fit):
    return [fit.values[a] for a in fit.slices]
