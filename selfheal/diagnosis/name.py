"""Which physics is missing: takes a fitted model, gives effects that earn a name."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .evidence import (
    ABOVE,
    Evidence,
    Scored,
    above,
    as_good,
    better,
    blocks_of,
    effective,
    held_out,
    reweighed,
    scored,
)
from .fit import Base, Fit, Problem, fit, try_term
from .scene import Scene
from .screen import STEPS, Progress, fewer, screened, some_of
from .terms import Term

FITTED = 3  # of the last ones, with every other value fitted anew; chosen
SURE = 0.01  # p-value, corrected for every candidate tried, that earns a name; chosen
WORTH = 0.02  # least share of the held-out squared error that a name removes; chosen
MOST = 6  # effects at once
WHITE = 0.6  # of the residuals, as many independent ones as white noise has; chosen
LEFT = 1.3  # times the noise, beside names that may stand for others; chosen
QUIET = 1.1  # times the noise, a residual beside names in which no other is looked for
BETTER = 0.97  # of the held-out error, below which another hypothesis is better; chosen


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


def _key(term: Term) -> tuple:
    return term.effect.name, term.targets, tuple(term.note.items())


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
        return odd[0] < odd[1] and as_good(problem, self.now, against)

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
        idle_terms = (found.terms[stated + i] for i in idle)
        found = fit(problem, *found.but(*idle_terms), rounds=2)
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
    close = [g for g in good if as_good(problem, g[0], lead, 2.0)]
    usual = [g for g in close if not g[1].effect.rare] or close
    near = [g for g in usual if as_good(problem, g[0], usual[0][0])]
    # of those that the data cannot rank, a usual one, with the least to choose
    best = min(
        near,
        key=lambda g: (g[1].effect.rare, len(g[1].parameters), g[0].held.sum()),
    )
    s, term, p = best
    also = tuple(
        g[1]
        for g in sorted(good, key=lambda x: x[0].held.sum())
        if g[1] is not term and as_good(problem, g[0], s, 2.0)
    )
    gain = 0.5 * np.log(now.held.sum() / max(s.held.sum(), 1e-300))
    stability = _stability(problem, [(g[0].held, g[1]) for g in good], (term, *also))
    others = tuple(g[1] for g in good if g[1] is not term)
    return s, term, Evidence(float(gain), p, stability), also[:3], others


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
            _plainer(full.fit.terms[-1], term) and as_good(problem, full, now)
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
    return fit(problem, *found.but(term), rounds=3)
