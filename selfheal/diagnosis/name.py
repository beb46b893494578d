"""Which physics is missing: takes a fitted model, gives effects that earn a name."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..recording.data import Floats
from .fit import Base, Fit, Problem, bounds, fit, step, try_term, whitened
from .plant import parts
from .scene import Scene
from .terms import Term

BLOCKS = 24  # at most, of neighboring windows, each predicted from the others; chosen
# candidates are tried on more and more steps of simulation, for more and more rounds,
# and ever fewer of them; chosen for a minute a joint
STEPS, ROUNDS, KEEP = (1500, 4000, 10000), (1, 3, 2), (12, 5, 5)
FITTED = 3  # of the last ones, with every other value fitted anew; chosen
SURE = 0.01  # p-value, corrected for every candidate tried, that earns a name; chosen
WORTH = 0.02  # least share of the held-out squared error that a name removes; chosen
STEADY = 1.0  # standard errors over the blocks that a gain must exceed; chosen
MOST = 6  # effects at once

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Scored:
    """A fit and how well it predicts what it did not see.

    Attributes:
        fit: of all windows.
        held: (W) squared residuals of each window, predicted from the other folds.
    """

    fit: Fit
    held: Floats


@dataclass(frozen=True, eq=False)
class Evidence:
    """Why an effect is named.

    Attributes:
        gain: nats per effective sample that it adds to held-out predictions.
        p_value: of that gain, corrected for all candidates tried.
        stability: share of resamples of the windows in which it, or what cannot be
            told from it, comes first.
    """

    gain: float
    p_value: float
    stability: float


@dataclass(frozen=True, eq=False)
class Named:
    """An effect that earned its name.

    Attributes:
        term: with its place.
        evidence: for it.
        equivalent: terms that explain as much, most likely first.
    """

    term: Term
    evidence: Evidence
    equivalent: tuple[Term, ...]


@dataclass(frozen=True, eq=False)
class Naming:
    """What a search ended with.

    Attributes:
        problem: the windows, weighted as in the end.
        stated: the fit of what the model states alone.
        final: the fit with the named effects.
        named: the effects.
        ranking: candidates of the first round and the cost each left, of 1.
    """

    problem: Problem
    stated: Scored
    final: Scored
    named: tuple[Named, ...]
    ranking: tuple[tuple[Term, float], ...]


def blocks_of(problem: Problem) -> np.ndarray:
    """(W) block of each window: neighbors in time share one."""
    return (
        np.arange(len(problem.windows))
        * min(BLOCKS, len(problem.windows))
        // len(problem.windows)
    )


def held_out(problem: Problem, found: Fit) -> Floats:
    """(W) squared residuals of each fold, with the values that the others ask for.

    One Gauss-Newton step from the fit of all: exact where the model is linear.
    """
    low, high, scale = bounds(found.terms)
    x, jac, r = found.values, found.jacobian, found.residuals
    of = blocks_of(problem)[problem.window_of]
    h, g = jac.T @ jac, jac.T @ r
    out = np.empty(len(r))
    for fold in np.unique(of):
        rows = of == fold
        a = jac[rows]
        move = step(h - a.T @ a, g - a.T @ r[rows], low - x, high - x, scale)
        out[rows] = (r[rows] + a @ move) ** 2
    return problem.by_window(out)


def scored(problem: Problem, terms: Sequence[Term], start: Floats, **more) -> Scored:
    """Fit, and predict every fold from the others."""
    found = fit(problem, terms, start, **more)
    return Scored(found, held_out(problem, found))


def better(problem: Problem, old: Scored, new: Scored, tried: float) -> float:
    """p-value that `new` predicts better than `old`, paying for `tried` tries.

    A likelihood ratio of held-out residuals with as many samples as are independent,
    and only where the gain is no single piece's.
    """
    from scipy.stats import chi2

    ratio = old.held.sum() / max(new.held.sum(), 1e-300)
    gains = np.bincount(blocks_of(problem), old.held - new.held)
    error = gains.std(ddof=1) * np.sqrt(len(gains)) if len(gains) > 1 else np.inf
    if ratio <= 1 or gains.sum() < STEADY * error:
        return 1.0
    free = max(1, len(new.fit.values) - len(old.fit.values))
    # the larger residuals are the old ones, and the more alike their neighbors
    nats = 0.5 * effective(problem, old.fit.residuals) * np.log(ratio)
    return float(min(1.0, tried * chi2.sf(2 * nats, free)))


def effective(problem: Problem, r: Floats) -> float:
    """How many independent samples the squared residuals (R) amount to.

    Each column of each window counts by its correlation time; the sum's spread by
    Satterthwaite's (1946) rule.
    """
    width = problem.windows.readings.shape[1]
    r = r.reshape(-1, width)
    edges = np.searchsorted(problem.windows.window, np.arange(len(problem.windows) + 1))
    energy, spread = 0.0, 0.0
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        for x in r[a:b].T:
            size = float(x @ x)
            if size > 0:
                energy += size
                spread += size**2 / (len(x) / _correlation_time(x))
    return energy**2 / spread if spread else 0.0


def _correlation_time(x: Floats) -> float:
    """Integrated correlation time of a series [samples], about zero."""
    n = len(x)
    if n < 4:
        return float(n)
    power = np.abs(np.fft.rfft(x, 2 * n)) ** 2
    rho = np.fft.irfft(power)[:n]
    rho = rho / rho[0]
    end = int(np.argmax(rho <= 0)) or n
    return float(min(n, 1 + 2 * rho[1:end].sum()))


def reweighed(problem: Problem, found: Fit) -> Problem:
    """Each column's residuals measured by how large they are now."""
    width = problem.windows.readings.shape[1]
    r = found.residuals.reshape(-1, width)
    known = np.isfinite(problem.windows.readings)
    size = np.sqrt((r**2).sum(axis=0) / np.maximum(known.sum(axis=0), 1))
    noise = np.concatenate([c.noise for c in problem.world.signals])
    least = np.where(np.isfinite(noise), noise, 0.0)
    sigma = np.maximum(size * problem.sigma, least)
    sigma = np.where(sigma > 0, sigma, problem.sigma)
    return whitened(replace(problem, sigma=sigma, whiten=()), found.terms, found.values)


def some_of(base: Base, steps: int, rng: np.random.Generator) -> Base:
    """The same fit in windows, drawn at random, that simulate about so many steps."""
    problem, found = base.problem, base.fit
    size = len(problem.windows)
    count = int(np.clip(steps / problem.windows.steps.mean(), min(4, size), size))
    if count >= 0.8 * size:
        return base
    chosen = np.sort(rng.permutation(size)[:count])
    width = problem.windows.readings.shape[1]
    rows = problem.windows.rows(chosen)[:, None] * width + np.arange(width)
    rows = rows.ravel()
    part = Fit(found.terms, found.values, found.residuals[rows], found.jacobian[rows])
    return Base.of(problem.take(chosen), part)


def fewer(problem: Problem, steps: int, rng: np.random.Generator) -> Problem:
    """As many of the windows, drawn at random, as simulate about so many steps."""
    size = len(problem.windows)
    count = int(np.clip(steps / problem.windows.steps.mean(), 24, size))
    if count >= 0.8 * size:
        return problem
    return problem.take(np.sort(rng.permutation(size)[:count]))


def _key(term: Term) -> tuple:
    return term.effect.name, term.targets, tuple(term.note.items())


def screened(
    bases: Sequence[Base], candidates: Sequence[Term], progress: Progress
) -> tuple[list[Fit], float]:
    """Candidates' fits, the best first, in the last of the bases.

    And how many independent candidates there were, by how alike their answers to the
    residuals are (participation ratio of their correlations; Galwey 2009).

    Args:
        bases: the same fit in more and more windows; fewer and fewer candidates are
            tried in them.
        candidates: to be tried.
        progress: told which one is.
    """
    left = [(0.0, term) for term in candidates]
    fits: list[Fit] = []
    answers: list[Floats] = []
    for stage, (base, rounds, keep) in enumerate(zip(bases, ROUNDS, KEEP, strict=True)):
        tried = []
        for i, (_, term) in enumerate(left):
            progress(f"trying {term.label}", i / len(left))
            found = try_term(base, term, rounds=rounds)
            if stage == 0:
                answers.append(base.fit.residuals - found.residuals)
            values = found.values[len(base.fit.values) :]
            begun = replace(term, starts=(tuple(values),))
            tried.append((found.cost / base.fit.cost, begun, found, term))
        tried.sort(key=lambda x: x[0])
        tried = tried[:keep]
        left = [(cost, begun) for cost, begun, _, _ in tried]
        fits = [found for _, _, found, _ in tried]
    return fits, _independent(np.array(answers))


def _independent(answers: Floats) -> float:
    """How many of (n, R) answers are independent, between 1 and n."""
    size = np.linalg.norm(answers, axis=1)
    unit = answers[size > 0] / size[size > 0, None]
    return len(unit) ** 2 / max(float(((unit @ unit.T) ** 2).sum()), 1.0)


def name_effects(
    problem: Problem,
    scene: Scene,
    stated: Sequence[Term],
    effects: Iterable,
    *,
    rng: np.random.Generator,
    progress: Progress = lambda what, share: None,
) -> Naming:
    """Find the effects without which the recordings cannot be explained.

    Forward, with a look back after each step: what a later effect makes needless goes.

    Args:
        problem: all windows that may be used.
        scene: of the robot.
        stated: terms of what the model states.
        effects: the catalogue.
        rng: chooses the windows on which candidates are tried first.
        progress: told what is being done and how far it is.
    """
    candidates = [term for effect in effects for term in effect.terms(scene)]
    stated = tuple(stated)
    begin = np.ones(len(stated))
    progress("refitting what the model states", 0.0)
    problem = fewer(problem, STEPS[-1], rng)
    found = fit(problem, stated, begin)
    problem = reweighed(problem, found)
    now = scored(problem, stated, found.values)
    first: tuple[tuple[Term, float], ...] = ()
    evidence: dict[tuple, Evidence] = {}
    rivals: dict[tuple, tuple[Term, ...]] = {}
    tabu: set[tuple] = set()
    for _ in range(MOST):
        kept = now.fit.terms[len(stated) :]
        taken = {_key(t) for t in kept} | tabu
        open_to = [t for t in candidates if _key(t) not in taken and _fresh(t, kept)]
        all_of_it = Base.of(problem, now.fit)
        bases = [some_of(all_of_it, steps, rng) for steps in STEPS]
        fits, independent = screened(bases, open_to, progress)
        part = bases[-1]
        if not first:
            first = tuple((f.terms[-1], f.cost / part.fit.cost) for f in fits)
        won = _winner(
            part.problem,
            Scored(part.fit, held_out(part.problem, part.fit)),
            _finalists(part.problem, fits, progress),
            independent,
        )
        if won is None and tabu:
            tabu = set()
            continue
        if won is None:
            break
        best, term, why, also = won
        evidence[_key(term)], rivals[_key(term)] = why, also
        progress(f"fitting {term.label}", 0.0)
        before = now.fit.terms[len(stated) :]
        problem, now, gone = _look_back(problem, best, len(stated), rivals)
        tabu = {_key(t) for t in gone}  # for one round: what follows may need it
        after = now.fit.terms[len(stated) :]
        for new in after:  # one of them may have taken another's place
            evidence.setdefault(_key(new), why)
            rivals.setdefault(_key(new), tuple(t for t in before if t not in after))
    alone = scored(problem, stated, now.fit.values[: len(stated)])
    named = tuple(
        Named(t, evidence[_key(t)], rivals[_key(t)])
        for t in now.fit.terms[len(stated) :]
    )
    return Naming(problem, alone, now, named, first)


def _fresh(term: Term, kept: Sequence[Term]) -> bool:
    """Whether a term says something new beside those kept."""
    return not any(
        term.effect.name == t.effect.name and set(term.targets) & set(t.targets)
        for t in kept
    )


def _finalists(problem: Problem, fits: Sequence[Fit], progress) -> list[Scored]:
    """The candidates' predictions, the best ones' with everything else fitted anew."""
    found = [Scored(f, held_out(problem, f)) for f in fits]
    found.sort(key=lambda s: s.held.sum())
    for i in range(min(FITTED, len(found))):
        old = found[i]
        progress(f"fitting {old.fit.terms[-1].label}", i / FITTED)
        new = scored(problem, old.fit.terms, old.fit.values, rounds=3)
        if new.held.sum() < old.held.sum():
            found[i] = new
    return found


def _winner(problem, now: Scored, finals, tried: float):
    """The candidate that earns a name, why, and what cannot be told from it."""
    good = []
    for s in finals:
        term = s.fit.terms[-1]
        p = better(problem, now, s, tried)
        if p < SURE and s.held.sum() < (1 - WORTH) * now.held.sum():
            good.append((s, term, p))
    if not good:
        return None
    good.sort(key=lambda x: x[0].held.sum())
    lead = good[0][0]
    close = [g for g in good if _as_good(problem, g[0], lead, 2.0)]
    usual = [g for g in close if not g[1].effect.rare] or close
    near = [g for g in usual if _as_good(problem, g[0], usual[0][0])]
    # of those that the data cannot rank, a usual one, with the least to choose
    best = min(near, key=lambda g: (len(g[1].parameters), g[0].held.sum()))
    s, term, p = best
    also = tuple(
        g[1]
        for g in sorted(good, key=lambda x: x[0].held.sum())
        if g[1] is not term and _as_good(problem, g[0], s, 2.0)
    )
    gain = 0.5 * np.log(now.held.sum() / max(s.held.sum(), 1e-300))
    stability = _stability(problem, [(g[0].held, g[1]) for g in good], (term, *also))
    return s, term, Evidence(float(gain), p, stability), also[:3]


def _as_good(problem, other: Scored, lead: Scored, errors: float = 1.0) -> bool:
    """Whether the windows do not tell that `other` predicts worse than `lead`."""
    apart = np.bincount(blocks_of(problem), other.held - lead.held)
    noise = apart.std(ddof=1) * np.sqrt(len(apart)) if len(apart) > 1 else np.inf
    ratio = other.held.sum() / max(lead.held.sum(), 1e-300)
    nats = 0.5 * effective(problem, lead.fit.residuals) * np.log(max(ratio, 1e-300))
    return bool(apart.sum() <= errors * noise and ratio < 1.5) or bool(nats < errors)


def _stability(problem, helds, winners) -> float:
    """Share of bootstraps of the blocks in which one of the winners comes first."""
    rng = np.random.default_rng(0)
    block = blocks_of(problem)
    sums = np.array([np.bincount(block, held) for held, _ in helds])
    draws = rng.integers(sums.shape[1], size=(400, sums.shape[1]))
    first = sums[:, draws].sum(axis=-1).argmin(axis=0)
    names = {_key(t) for t in winners}
    return float(np.mean([_key(helds[i][1]) in names for i in first]))


def _look_back(problem, best: Scored, stated: int, rivals):
    """Weigh anew, and undo what a later effect made needless or better explained."""
    found = fit(problem, best.fit.terms, best.fit.values, rounds=6)
    problem = reweighed(problem, found)
    now = scored(problem, found.terms, found.values, rounds=4)
    gone: list[Term] = []
    while len(now.fit.terms) > stated + 1:
        tries = []
        for term in now.fit.terms[stated:]:
            less = without(problem, now.fit, term)
            held = held_out(problem, less)
            if held.sum() < (1 + WORTH) * now.held.sum():
                tries.append((held.sum(), term, Scored(less, held)))
        if not tries:
            break
        _, term, now = min(tries, key=lambda x: x[0])
        gone.append(term)
    for term in now.fit.terms[stated:-1]:
        now = _swapped(problem, now, term, rivals.get(_key(term), ()))
    return problem, now, gone


def _swapped(problem, now: Scored, term: Term, rivals: Sequence[Term]) -> Scored:
    """The fit with one of a term's rivals in its place, if that predicts better."""
    others = [t for t in now.fit.terms if t is not term]
    rivals = [r for r in rivals if _fresh(r, others)]
    if not rivals:
        return now
    base = Base.of(problem, without(problem, now.fit, term))
    tried = [try_term(base, rival) for rival in rivals]
    helds = [Scored(f, held_out(problem, f)) for f in tried]
    best = min(helds, key=lambda s: s.held.sum())
    if best.held.sum() > 0.97 * now.held.sum():
        return now
    full = scored(problem, best.fit.terms, best.fit.values, rounds=6)
    return full if full.held.sum() < 0.97 * now.held.sum() else now


def without(problem: Problem, found: Fit, term: Term) -> Fit:
    """The fit of all terms but one."""
    values = parts(found.terms, found.values)
    rest = [i for i, t in enumerate(found.terms) if t is not term]
    start = np.concatenate([*(values[i] for i in rest), np.zeros(0)])
    return fit(problem, [found.terms[i] for i in rest], start, rounds=3)
