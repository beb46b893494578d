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

    def relinearized(self):
        p = self.count
        plain = self.errors - self.values[p:] @ self.jacobian[p:]
        j = differentiate(self.motion, self.terms, self.values[:p], plain)
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
        fit = descend(fit.relinearized(), 4)
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
        ranked = rank(part, _propose(part, open_), weigh(part.motion, part.errors))
        keys = list(dict.fromkeys(d.term for _, d, _ in ranked))
        open_ = keys[:FINALISTS]
    return _propose(fit, open_)


def _propose(fit, terms):
    p = fit.count
    plain = fit.errors - fit.values[p:] @ fit.jacobian[p:]
    return propose_directions(fit.motion, fit.terms, fit.values[:p], plain, terms)


def search(motion, nominal_terms, candidates, log=print, most=60):
    """The better of the sets that are reached from none and from all usual effects."""
    count = len(candidates)
    first = start(motion, nominal_terms)
    log("FULL START")
    full = search_from(start_full(first, candidates, log), candidates, log, most)
    log("EMPTY START")
    empty = search_from(first, candidates, log, most)
    def score(fit):
        return penalized(fit) + sum(penalty(t, count, fit.errors.size) for t in fit.named)
    log("score full", round(score(full), 1), len(full.named), "empty", round(score(empty), 1), len(empty.named))
    return min(full, empty, key=score)


def start_full(fit, candidates, log):
    """All usual effects at once, without those that do nothing."""
    usual = []
    for t in candidates:
        if t.effect.is_usual(t) and is_distinct(t, usual):
            usual.append(t)
    log("usual", [t.label for t in usual])
    p = fit.count
    nominal = np.concatenate([np.clip([q.nominal for q in t.parameters], t.low, t.high) for t in usual])
    values = np.concatenate([fit.values[:p], nominal, fit.values[p:]])
    terms = (*fit.terms, *usual)
    jacobian = np.vstack([fit.jacobian[:p], np.zeros((len(nominal), fit.errors.size)), fit.jacobian[p:]])
    fit = replace(fit, terms=terms, values=values, jacobian=jacobian)
    fit = replace(fit, errors=fit.evaluate(values))
    fit = relinearize(fit, 8)
    log("full", penalized(fit), {t.label: np.round(v, 4).tolist() for t, v in zip(fit.named, split(fit)[fit.stated:])})
    return backward(fit, len(candidates), log)


def search_from(fit, candidates, log, most):
    motion, count = fit.motion, len(candidates)
    directions, is_fresh, tabu = [], False, set()
    log("start", penalized(fit))
    while len(fit.named) < most:
        if not directions:
            directions = propose(fit, candidates)
            is_fresh = True
            log("columns", len(directions))
        w = weigh(motion, fit.errors)
        noise = estimate_noise(motion, fit.terms, fit.values[None, :fit.count], fit.evaluate(np.append(fit.values[:fit.count],np.zeros(fit.nuisance))))
        log("   ratio", np.round(1.4826*np.median(np.abs(fit.errors.reshape(-1,motion.width)),axis=0)/noise,2), np.round(np.sqrt((fit.errors.reshape(-1,motion.width)**2).mean(0))/noise,2), "nuisance", np.round(fit.values[fit.count:],2))
        share = independence(motion, fit.errors, w)
        rows = w.size * share.mean()
        ranked = rank(fit, [d for d in directions if d.term.key not in tabu and is_distinct(d.term, fit.named)], w)
        log("  ", len(fit.named), "share", np.round(share, 2), "  ".join(f"{d.term.label}[{len(d.columns)}] {g:.0f}" for g, d, _ in ranked[:4]))
        new, best = None, 0.0
        for gain, d, coordinates in ranked[:TRIED]:
            least = penalty(d.term, count, rows)
            if gain * share.mean() < least:
                break
            tried = add(fit, d, coordinates)
            gained = penalized(fit) - penalized(tried)
            is_small = d.term.is_negligible(tried.values_of(-1))
            log("     ", d.term.label, np.round(tried.values_of(-1), 5), round(gained), "predicted", round(gain), "small" if is_small else "")
            net = gained * share.mean() - least
            if net < 0 or is_small:
                tabu.add(d.term.key)
            elif net > best:
                new, best = tried, net
        if new is None:
            if is_fresh or not ranked:
                break
            fit = relinearize(fit)
            directions, tabu = [], set()
            continue
        before = {t.key for t in fit.named}
        fit, is_fresh = backward(new, count, log), False
        tabu |= before - {t.key for t in fit.named}
    fit = backward(relinearize(fit), count, log)
    return fit


def rank(fit, directions, w):
    """(gain [nats], direction, coordinates) of each beside the fit, the best first."""
    if not directions:
        return []
    h, g = normal_equations(fit, w)
    x = np.vstack([d.columns for d in directions])
    xw = x * w
    low, high, scale = fit.bounds
    step = solve_bounded_step(h, g, low - fit.values, high - fit.values, scale, 1e-9)
    at = fit.values + step
    free = np.flatnonzero((at > low + 1e-6 * scale) & (at < high - 1e-6 * scale))
    cross = xw @ fit.jacobian[free].T
    solved = cross @ invert(h[np.ix_(free, free)])
    rest = fit.errors + step @ fit.jacobian
    score = xw @ rest - solved @ (g + h @ step)[free]
    ends = np.cumsum([0, *(len(d.columns) for d in directions)])
    before = loss(fit.motion, rest)
    out = []
    for d, a, b in zip(directions, ends[:-1], ends[1:]):
        whole = xw[a:b] @ x[a:b].T
        own = whole - solved[a:b] @ cross[a:b].T
        if (np.diag(own) < 1e-4 * np.diag(whole)).any():
            continue
        lo, hi = coordinate_bounds(d)
        size = 1 / np.sqrt(np.diag(own))
        z = solve_bounded_step(own, score[a:b], lo, hi, size, 1e-9)
        gain = -(score[a:b] @ z + 0.5 * z @ own @ z)
        out.append((float(gain), d, z, solved[a:b]))
    out.sort(key=lambda each: -each[0])
    gains = []
    for gain, d, z, others in out[:FINALISTS]:
        change = z @ (d.columns - others @ fit.jacobian[free])
        gains.append((before - loss(fit.motion, rest + change), d, z))
    return _best_of_each(gains)


def _best_of_each(gains):
    """The best direction of each term, the best term first."""
    gains.sort(key=lambda each: -each[0])
    seen: dict[tuple, tuple] = {}
    for each in gains:
        seen.setdefault(each[1].term.key, each)
    return list(seen.values())


def add(fit, d, coordinates):
    origin = np.where(np.isfinite(d.start), d.start, 0.0)
    is_finite = np.isfinite(d.start).all()
    v = origin + coordinates @ d.steps if is_finite else d.steps[0]
    v = np.clip(v, d.term.low, d.term.high)
    terms = (*fit.terms, d.term)
    p = fit.count
    values = np.concatenate([fit.values[:p], v, fit.values[p:]])
    errors = fit.evaluate(values, terms)
    plain = errors - values[p + len(v):] @ fit.jacobian[p:]
    own = differentiate_some(fit.motion, terms, values[:p + len(v)], plain, touched(terms))
    jacobian = np.vstack([fit.jacobian[:p], np.zeros((len(v), len(errors))), fit.jacobian[p:]])
    for i, column in own.items():
        jacobian[i] = column
    return descend(replace(fit, terms=terms, values=values, errors=errors, jacobian=jacobian))


def touched(terms):
    """Numbers of values whose response the last term may change."""
    new = terms[-1]
    out, at = [], 0
    for t in terms:
        k = len(t.parameters)
        if t is new or any(a.startswith(b) or b.startswith(a) for a in t.targets for b in new.targets):
            out += range(at, at + k)
        at += k
    return out


def differentiate_some(motion, terms, values, errors, which):
    scale = np.concatenate([t.scale for t in terms])
    high = np.concatenate([t.high for t in terms])
    step = 1e-2 * scale
    step = np.where(values + step > high, -step, step)
    points = np.tile(values, (len(which), 1))
    points[np.arange(len(which)), which] += step[which]
    reference = make_reference(motion, terms, values)
    changes = compute_errors(motion, terms, points, reference=reference) - errors
    return {i: c / step[i] for i, c in zip(which, changes)}


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
