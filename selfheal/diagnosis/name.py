"""Which physics is missing: takes a fitted model, gives effects that earn a name."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..recording.data import Floats
from .fit import (
    Base,
    Fit,
    Problem,
    believed,
    bounds,
    fit,
    step,
    try_term,
    whitened,
)
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
WHITE = 0.6  # of the residuals, as many independent ones as white noise has; chosen
LEFT = 1.3  # times the noise, beside names that may stand for others; chosen
QUIET = 1.1  # times the noise, a residual beside names in which no other is looked for
BETTER = 0.97  # of the held-out error, below which another hypothesis is better; chosen
ABOVE = 2.0  # times the noise that an unexplained residual must be, to be one; chosen

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
    weights, pull = believed(found.terms, x)
    h, g = jac.T @ jac + np.diag(weights), jac.T @ r + pull
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


def above(problem: Problem, residuals: Floats) -> float:
    """Root mean square of residuals (R) over what the readings' noise would leave."""
    return float(np.sqrt((residuals**2).sum() / max(noise_of(problem), 1e-12)))


def noise_of(problem: Problem) -> float:
    """Squared residuals that the readings' noise alone would leave."""
    noise = np.concatenate([
        np.maximum(np.nan_to_num(c.noise), c.lattice / np.sqrt(12))
        for c in problem.world.signals
    ])  # fmt: skip
    count = np.isfinite(problem.windows.readings).sum(axis=0)
    return float((count * (noise / problem.sigma) ** 2).sum())


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
    """The same fit in windows that simulate about so many steps.

    Half of them those with the largest residuals, where an effect shows that does so
    rarely; the others drawn at random, where one that is wrong does harm.
    """
    problem, found = base.problem, base.fit
    size = len(problem.windows)
    count = int(np.clip(steps / problem.windows.steps.mean(), min(4, size), size))
    if count >= 0.8 * size:
        return base
    worst = np.argsort(-problem.by_window(found.residuals**2))
    others = rng.permutation(worst[(count + 1) // 2 :])
    chosen = np.sort(np.append(worst[: (count + 1) // 2], others[: count // 2]))
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
    Where that leaves something, once more from all the usual ones at once: the first
    one named alone may have stood for several.

    Args:
        problem: all windows that may be used.
        scene: of the robot.
        stated: terms of what the model states.
        effects: the catalogue.
        rng: chooses the windows on which candidates are tried first.
        progress: told what is being done and how far it is.
    """
    candidates = [term for effect in effects for term in effect.terms(scene)]
    progress("refitting what the model states", 0.0)
    problem = fewer(problem, STEPS[-1], rng)
    found = fit(problem, stated, np.ones(len(stated)))
    problem = reweighed(problem, found)
    now = scored(problem, tuple(stated), found.values)
    search = _Search(problem, now, len(stated), candidates, rng, progress)
    start = replace(search)
    search.forward()
    named = search.now.fit.terms[len(stated) :]
    odd = any(t.effect.rare for t in named) or len(named) > 1
    left = search.above > (LEFT if odd else ABOVE)
    if left and not search.is_white:
        other = start.with_all_usual()
        if other is not None and other.beats(search):
            search = other
    return search.ended()


@dataclass
class _Search:
    """Where a search for effects is.

    Attributes:
        problem: the windows.
        now: the best fit.
        stated: how many of its terms the model states.
        candidates: terms.
        rng: chooses windows.
        progress: told what is being done.
        first: what the first round gave.
        evidence: of each effect named, by its key.
        rivals: what cannot be told from it.
        others: what else might have taken its place.
    """

    problem: Problem
    now: Scored
    stated: int
    candidates: Sequence[Term]
    rng: np.random.Generator
    progress: Progress
    first: tuple[tuple[Term, float], ...] = ()
    evidence: dict[tuple, Evidence] = field(default_factory=dict)
    rivals: dict[tuple, tuple[Term, ...]] = field(default_factory=dict)
    others: dict[tuple, tuple[Term, ...]] = field(default_factory=dict)

    @property
    def named(self) -> tuple[Term, ...]:
        """The effects of now."""
        return self.now.fit.terms[self.stated :]

    @property
    def is_white(self) -> bool:
        """Whether what is left looks like noise that knows nothing of its past."""
        r = self.now.fit.residuals
        return bool(effective(self.problem, r) > WHITE * np.count_nonzero(r))

    @property
    def above(self) -> float:
        """What is left, of what noise would leave."""
        return above(self.problem, self.now.fit.residuals)

    def forward(self) -> None:
        """Add what earns a name, until nothing does."""
        tabu: set[tuple] = set()
        for _ in range(MOST):
            if self.is_white or (self.named and self.above < QUIET):
                break
            won = self._round(tabu)
            if won is None and tabu:
                tabu = set()
                continue
            if won is None or len(self.named) > MOST:
                break
            best, term, why, also, others = won
            key = _key(term)
            self.evidence[key], self.rivals[key], self.others[key] = why, also, others
            self.progress(f"fitting {term.label}", 0.0)
            before = self.named
            gone = self._look_back(best)
            tabu = {_key(t) for t in gone}  # for one round: what follows may need it
            replaced = tuple(t for t in before if t not in self.named)
            for new in self.named:  # one of them may have taken another's place
                self.evidence.setdefault(_key(new), why)
                self.rivals.setdefault(_key(new), replaced)
                self.others.setdefault(_key(new), replaced)

    def _round(self, tabu: set[tuple]):
        """The candidate that earns a name beside those named, if one does."""
        taken = {_key(t) for t in self.named} | tabu
        open_to = [
            t for t in self.candidates if _key(t) not in taken and _fresh(t, self.named)
        ]
        all_of_it = Base.of(self.problem, self.now.fit)
        bases = [some_of(all_of_it, steps, self.rng) for steps in STEPS]
        fits, independent = screened(bases, open_to, self.progress)
        part = bases[-1]
        if not self.first:
            self.first = tuple((f.terms[-1], f.cost / part.fit.cost) for f in fits)
        return _winner(
            part.problem,
            Scored(part.fit, held_out(part.problem, part.fit)),
            _finalists(part.problem, fits, self.progress),
            independent,
        )

    def _look_back(self, best: Scored) -> list[Term]:
        """Weigh anew, and undo what a later effect made needless or better explained.

        Returns:
            What went.
        """
        found = fit(self.problem, best.fit.terms, best.fit.values, rounds=6)
        self.problem = reweighed(self.problem, found)
        self.now = scored(self.problem, found.terms, found.values, rounds=4)
        gone: list[Term] = []
        while len(self.named) > 1:
            tries = []
            for term in self.named:
                less = without(self.problem, self.now.fit, term)
                held = held_out(self.problem, less)
                if held.sum() < (1 + WORTH) * self.now.held.sum():
                    tries.append((held.sum(), term, Scored(less, held)))
            if not tries:
                break
            _, term, self.now = min(tries, key=lambda x: x[0])
            gone.append(term)
        for term in self.named[:-1]:
            others = self.others.get(_key(term), ())
            self.now = _swapped(self.problem, self.now, term, others)
        return gone

    def with_all_usual(self) -> "_Search | None":
        """Another search, from all usual effects at once; None if there are none."""
        usual = [t for t in self.candidates if t.effect.common and len(t.targets) == 1]
        if not usual:
            return None
        self.progress(f"fitting {len(usual)} usual effects at once", 0.0)
        start = [np.array(t.starts[0]) for t in usual]
        terms = (*self.now.fit.terms, *usual)
        values = np.concatenate([self.now.fit.values, *start])
        found = fit(self.problem, terms, values, rounds=8)
        found = _pruned(self.problem, found, self.stated)
        self.problem = reweighed(self.problem, found)
        self._look_back(scored(self.problem, found.terms, found.values, rounds=4))
        for term in self.named:
            less = without(self.problem, self.now.fit, term)
            old = Scored(less, held_out(self.problem, less))
            p = better(self.problem, old, self.now, len(usual))
            if p >= SURE:
                self.now = old
                continue
            gain = np.bincount(blocks_of(self.problem), old.held - self.now.held)
            draws = self.rng.integers(len(gain), size=(400, len(gain)))
            nats = 0.5 * np.log(old.held.sum() / max(self.now.held.sum(), 1e-300))
            stable = float((gain[draws].sum(axis=1) > 0).mean())
            self.evidence[_key(term)] = Evidence(float(nats), p, stable)
            self.rivals[_key(term)] = self.others[_key(term)] = ()
        self.forward()
        return self

    def beats(self, other: "_Search") -> bool:
        """Whether this one predicts better, or as well by usual effects alone."""
        problem = self.problem
        theirs = other.now.fit
        against = scored(problem, theirs.terms, theirs.values, rounds=2)
        if self.now.held.sum() < BETTER * against.held.sum():
            return True
        odd = [sum(t.effect.rare for t in s.named) for s in (self, other)]
        return odd[0] < odd[1] and _as_good(problem, self.now, against)

    def ended(self) -> Naming:
        """What was found."""
        own = self.now.fit
        alone = scored(
            self.problem, own.terms[: self.stated], own.values[: self.stated]
        )
        named = tuple(
            Named(t, self.evidence[_key(t)], self.rivals[_key(t)]) for t in self.named
        )
        return Naming(self.problem, alone, self.now, named, self.first)


def _pruned(problem: Problem, found: Fit, stated: int) -> Fit:
    """Without the effects that cost next to nothing to take away, a half at a time."""
    while len(found.terms) > stated:
        base = Base.of(problem, found)
        ends = np.cumsum([0, *(len(t.parameters) for t in found.terms)])
        costs = []
        for i, term in enumerate(found.terms[stated:], stated):
            own = np.arange(ends[i], ends[i + 1])
            absent = np.array([p.absent for p in term.parameters])
            back = found.jacobian[:, own] @ (absent - found.values[own])
            costs.append(base.settle(found.residuals + back, hold=own)[0] / found.cost)
        order = np.argsort(costs)
        idle = [i for i in order if costs[i] < 1 + WORTH][: max(1, len(order) // 2)]
        if not idle:
            break
        keep = [i for i in range(len(found.terms)) if i - stated not in idle]
        values = parts(found.terms, found.values)
        start = np.concatenate([*(values[i] for i in keep), np.zeros(0)])
        found = fit(problem, [found.terms[i] for i in keep], start, rounds=2)
    return found


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
    """The candidate that earns a name, why, what cannot be told from it, all others."""
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
    best = min(
        near,
        key=lambda g: (g[1].effect.rare, len(g[1].parameters), g[0].held.sum()),
    )
    s, term, p = best
    also = tuple(
        g[1]
        for g in sorted(good, key=lambda x: x[0].held.sum())
        if g[1] is not term and _as_good(problem, g[0], s, 2.0)
    )
    gain = 0.5 * np.log(now.held.sum() / max(s.held.sum(), 1e-300))
    stability = _stability(problem, [(g[0].held, g[1]) for g in good], (term, *also))
    others = tuple(g[1] for g in good if g[1] is not term)
    return s, term, Evidence(float(gain), p, stability), also[:3], others


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


def _swapped(problem, now: Scored, term: Term, others: Sequence[Term]) -> Scored:
    """The fit with another term in one's place, if that predicts better.

    What looked best alone need not do so beside a later effect; and where the data do
    not tell, the usual effect with the least to choose is the one.
    """
    kept = [t for t in now.fit.terms if t is not term]
    others = [t for t in others if _fresh(t, kept)]
    if not others:
        return now
    base = Base.of(problem, without(problem, now.fit, term))
    tried = [try_term(base, other) for other in others]
    tried.sort(key=lambda f: held_out(problem, f).sum())
    for found in tried[:2]:
        full = scored(problem, found.terms, found.values, rounds=6)
        if full.held.sum() < BETTER * now.held.sum() or (
            _plainer(full.fit.terms[-1], term) and _as_good(problem, full, now)
        ):
            return full
    return now


def _plainer(new: Term, old: Term) -> bool:
    """Whether an effect is to be preferred where the data do not tell."""
    if new.effect.rare != old.effect.rare:
        return new.effect.rare < old.effect.rare
    return len(new.parameters) < len(old.parameters)


def without(problem: Problem, found: Fit, term: Term) -> Fit:
    """The fit of all terms but one."""
    values = parts(found.terms, found.values)
    rest = [i for i, t in enumerate(found.terms) if t is not term]
    start = np.concatenate([*(values[i] for i in rest), np.zeros(0)])
    return fit(problem, [found.terms[i] for i in rest], start, rounds=3)
