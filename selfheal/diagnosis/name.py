"""Which physics is missing: takes a fitted model, gives effects that earn a name."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from .choose import (
    STRAINED,
    SURE,
    WORTH,
    Claim,
    drastic,
    finalists,
    relieving,
    winner,
)
from .evidence import (
    ABOVE,
    LEFT,
    Evidence,
    Scored,
    as_good,
    better,
    blocks_of,
    effective,
    for_score,
    refitted,
    reweighed,
    scored,
    seated,
)
from .fit import Fit, bounds, fit, looked_about
from .noise import above, expected, loudest
from .onset import began, dated, placed
from .problem import Problem, is_told, whitened
from .prune import BETTER, prices_of, pruned, swapped, without
from .scene import Scene
from .screen import (
    MANY,
    SEARCHED,
    STEPS,
    Progress,
    drawn,
    fewer,
    overlooked,
    screened,
    some_of,
)
from .terms import Onset, Term, is_new, other_forms, says_anew
from .trial import Base

MOST = 6  # effects at once
WHITE = 0.6  # of the residuals, as many independent ones as white noise has; chosen
QUIET = 1.1  # times the noise, a residual beside names in which no other is looked for
BOUND = 1e-3  # of the way between its bounds, where a stated value is at one; chosen
LITTLE = 0.1  # of the held-out squared error, of a robot that touches; chosen
CHEAPEST = 3  # of several names, that are tried without; chosen


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


def name_effects(
    problem: Problem,
    longer: Problem,
    scene: Scene,
    stated: Sequence[Term],
    effects: Iterable,
    *,
    rng: np.random.Generator,
    progress: Progress = lambda what, share: None,
    is_provable: Callable[[Onset], bool] = lambda onset: True,
) -> list[Naming]:
    """Find the effects without which the recordings cannot be explained.

    Forward, with a look back after each step: what a later effect makes needless goes.
    Where that leaves something (more than a tenth, if something touches: the cost is
    rough there), once more from all the usual ones at once: the first one named alone
    may have stood for several. And in longer pieces, if the starts allow it: slow
    effects show there. Where only later pieces are not explained, effects set in then.

    Args:
        problem: all windows that may be used.
        longer: the same in longer pieces.
        scene: of the robot.
        stated: terms of what the model states.
        effects: the catalogue.
        rng: chooses the windows on which candidates are tried first.
        progress: told what is being done and how far it is.
        is_provable: whether it is worth the while to look for what sets in then.

    Returns:
        One hypothesis, or what both searches found, the likelier first; none where
        something sets in that is not worth it.
    """
    kinds = [effect for effect in effects if not effect.rounds]
    candidates = tuple(term for effect in kinds for term in effect.terms(scene))
    progress("refitting what the model states", 0.0)
    steps = min(STEPS[-1], int(SEARCHED / max(len(stated), 1)))
    some = drawn(problem, steps, rng)
    begin = partial(_Search.of, problem, stated, candidates, rng, progress)
    search = begin(some)
    if search.is_done:
        odd = overlooked(problem, some, search.problem, search.now.fit)
        search = begin(np.union1d(some, odd)) if len(odd) else search
    if not search.is_done and (onset := began(search.problem, search.now.fit)):
        if not is_provable(onset):
            return []
        search.candidates = candidates = dated(candidates, onset)
    start = replace(search)
    search.forward()
    # poses do not show what most robots have
    if search.is_done or problem.windows.is_single:
        return [search.ended(problem)]
    # what the first search set aside for a name, the second one tries in its place
    likely = [t for t in candidates if t in search.candidates or t.effect.is_usual(t)]
    other = replace(
        start, claims=dict(search.claims), first=search.first, candidates=likely
    )
    longer = replace(
        fewer(longer, steps, rng), sigma=search.problem.sigma,
        world=search.problem.world,
    )  # fmt: skip
    if not other.with_all_usual(longer, {t.key for t in search.named}):
        return [search.ended(problem)]
    both = (other, search) if other.beats(search) else (search, other)
    return [s.ended(problem) for s in both]


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
        claims: to each name ever given, by the effect's key; written to.
        first: what the first round gave.
    """

    problem: Problem
    now: Scored
    stated: int
    candidates: Sequence[Term]
    rng: np.random.Generator
    progress: Progress
    claims: dict[tuple, Claim]
    first: tuple[tuple[Term, float], ...] = ()

    @classmethod
    def of(cls, problem, stated, candidates, rng, progress, some) -> "_Search":
        """In some of the windows, where nothing has a name yet."""
        given = np.ones(len(stated))
        problem = whitened(problem.take(some), stated, given)
        found = fit(problem, stated, given)
        problem, now = _weighed_anew(problem, found, 8)
        return cls(problem, now, len(stated), candidates, rng, progress, claims={})

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
    def is_of_step(self) -> bool:
        """Whether noise and the time step's error leave as much as is left."""
        found = self.now.fit
        return found.cost <= expected(self.problem, found)

    @property
    def is_loud(self) -> bool:
        """Whether one column is far off, whatever the others are."""
        return loudest(self.problem, self.now.fit) > ABOVE

    @property
    def is_enough(self) -> bool:
        """Whether the names left little, of a robot whose cost is rough anyway."""
        nats = sum(self.claims[t.key].evidence.gain for t in self.named)
        return self.problem.world.touches and np.exp(-2 * nats) < LITTLE

    @property
    def is_strained(self) -> bool:
        """Whether stated values alone are so far off that a name might mend it."""
        if self.named:
            return False
        if self.problem.world.touches:  # roughness drives all of them some way
            return bool(self.relievers)
        return self.now.fit.strain > STRAINED

    @property
    def relievers(self) -> list[Term]:
        """What says a stated value anew; where something touches, one at its bound."""
        found = self.now.fit
        stated = list(found.terms[: self.stated])
        if self.problem.world.touches:
            low, high, _ = bounds(found.terms)
            room = np.minimum(found.values - low, high - found.values) / (high - low)
            stated = [t for t, own in zip(stated, room, strict=False) if own < BOUND]
        return [t for t in self.candidates if says_anew(t, stated)]

    @property
    def above(self) -> float:
        """What is left, of what noise would leave."""
        return above(self.problem, self.now.fit.residuals)

    @property
    def is_done(self) -> bool:
        """Whether nothing is left that another hypothesis could explain."""
        odd = any(t.effect.rare for t in self.named) or len(self.named) > 1
        strict = odd and not self.problem.world.touches
        near = self.above <= (LEFT if strict else ABOVE)
        quiet = self.is_white or near or self.is_of_step or self.is_enough
        return quiet and not self.is_loud

    def forward(self) -> None:
        """Add what earns a name, until nothing does."""
        tabu: set[tuple] = set()
        for _ in range(MOST):
            quiet = self.is_white or (self.named and self.above < QUIET)
            done = (quiet or self.is_of_step) and not self.is_loud
            if done and not self.is_strained:
                break
            won = self._round(tabu)
            if won is None and tabu:
                tabu = set()
                continue
            if won is None or len(self.named) > MOST:
                break
            best, claim = won
            self.claims[best.last.key] = claim
            self.progress(f"fitting {best.last.label}", 0.0)
            before = self.named
            gone = self._look_back(best)
            tabu = {t.key for t in gone}  # for one round: what follows may need it
            replaced = tuple(t for t in before if t not in self.named)
            swapped = Claim(claim.evidence, replaced, replaced)
            for new in self.named:  # one of them may have taken another's place
                self.claims.setdefault(new.key, swapped)

    def _round(self, tabu: set[tuple]) -> tuple[Scored, Claim] | None:
        """The candidate that earns a name beside those named, if one does."""
        taken = {t.key for t in self.named} | tabu
        open_to = [
            t for t in self.candidates if t.key not in taken and is_new(t, self.named)
        ]
        all_of_it = Base.of(self.problem, self.now.fit)
        bases = [some_of(all_of_it, steps, self.rng) for steps in STEPS]
        fits, independent, again = screened(bases, open_to, self.progress)
        part = bases[-1]
        if len(open_to) > MANY and not part.problem.windows.is_single:
            kept = [t for t in self.candidates if t not in open_to]
            self.candidates = [*again, *kept]
        if not self.first:
            self.first = tuple((f.terms[-1], f.cost / part.fit.cost) for f in fits)
        finals = finalists(part.problem, fits, self.progress)
        if part.problem.windows.is_single:
            finals = refitted(part, finals, open_to)
        whole = drastic(part, self.stated, open_to, self.progress)
        said = {s.last.key for s in whole}
        finals = [*whole, *(s for s in finals if s.last.key not in said)]
        now = Scored.of(part.problem, part.fit)
        won = winner(part.problem, now, finals, independent)
        if won is None and self.is_strained:
            anew = [t for t in self.relievers if t.key not in taken]
            won = relieving(part, now, anew, self.progress)
        return won

    def _look_back(self, best: Scored) -> list[Term]:
        """Weigh anew, and undo what a later effect made needless or better explained.

        Returns:
            What went.
        """
        same = len(best.fit.residuals) == len(self.now.fit.residuals)
        near = best.fit.jacobian if same else None
        problem, at = self.problem, (best.fit.terms, best.fit.values)
        if best.seat and problem.is_rough:  # begun from what was read
            problem = whitened(replace(problem.raw, shift=None), *at)
        elif best.seat:
            problem = seated(problem, *at)
        found = fit(problem, *at, rounds=6, known=near)
        self.problem, self.now = _weighed_anew(problem, found, 4)
        return self._undo()

    def _undo(self) -> list[Term]:
        """Let what is needless go, and what is better explained change its name.

        Returns:
            What went.
        """
        gone: list[Term] = []
        while len(self.named) > 1:
            tries = []
            prices = prices_of(Base.of(self.problem, self.now.fit), self.stated)
            for term in sorted(self.named, key=lambda t: prices[t])[:CHEAPEST]:
                own = without(self.problem, self.now.fit, term)
                less = Scored.of(self.problem, own)
                if less.error < (1 + WORTH) * self.now.error:
                    tries.append((term, less))
            if not tries:
                break
            term, self.now = min(tries, key=lambda x: x[1].error)
            gone.append(term)
        for term in () if self.problem.windows.is_single else self.named[:-1]:
            self.now = swapped(self.problem, self.now, term, self._others(term))
        return gone

    def _others(self, term: Term) -> Sequence[Term]:
        """What might take a name's place: what it was told from, or its other forms."""
        if term.key in self.claims:
            return self.claims[term.key].others
        return other_forms(term, self.candidates)

    def with_all_usual(self, longer: Problem, first: set[tuple]) -> bool:
        """Begin from all usual effects at once, in longer pieces if the starts allow.

        Returns:
            False where that is no other search than one from nothing, or than the
            one that found the names `first`.
        """
        usual = [t for t in self.candidates if t.effect.is_usual(t)]
        if not usual:
            return False
        self.progress(f"fitting {len(usual)} usual effects at once", 0.0)
        start = [np.array(t.starts[0]) for t in usual]
        terms = (*self.now.fit.terms, *usual)
        values = np.concatenate([self.now.fit.values, *start])
        found = fit(self.problem, terms, values, rounds=8)
        told = is_told(longer, self.problem, terms, found.values)
        if told:
            self.problem = whitened(longer, terms, found.values)
            found = fit(self.problem, terms, found.values, rounds=8)
        found = pruned(self.problem, found, self.stated)
        self.problem, self.now = _weighed_anew(self.problem, found, 4)
        self._undo()
        self._doubt(len(usual))
        if not told and {t.key for t in self.named} in (set(), first):
            return False
        self.forward()
        return True

    def _doubt(self, tried: int) -> None:
        """Keep the names that each are worth it, of so many that were tried."""
        for term in self.named:
            old = Scored.of(self.problem, without(self.problem, self.now.fit, term))
            p = better(self.problem, old, self.now, tried)
            if p >= SURE:
                self.now = old
                continue
            gain = np.bincount(blocks_of(self.problem), old.held - self.now.held)
            draws = self.rng.integers(len(gain), size=(400, len(gain)))
            nats = 0.5 * np.log(old.error / max(self.now.error, 1e-300))
            stable = float((gain[draws].sum(axis=1) > 0).mean())
            self.claims[term.key] = Claim(Evidence(float(nats), p, stable))

    def beats(self, other: "_Search") -> bool:
        """Whether this one predicts better, or as well by usual effects alone."""
        sigma = for_score(self.problem, self.now.fit)
        problem = replace(self.problem, sigma=sigma)
        problem = whitened(problem, self.now.fit.terms, self.now.fit.values)
        mine, theirs = (
            scored(problem, s.now.fit.terms, s.now.fit.values, rounds=2)
            for s in (self, other)
        )
        if mine.error < BETTER * theirs.error:
            return True
        odd = [sum(t.effect.rare for t in s.named) for s in (self, other)]
        return odd[0] < odd[1] and as_good(problem, mine, theirs)

    def ended(self, whole: Problem) -> Naming:
        """What was found, in some of the `whole`'s windows."""
        if any(t.onset for t in self.named):
            self.now = placed(self.problem, whole, self.now)
        own, terms = self.now.fit, self.named
        alone = scored(self.problem, *own.but(*terms), known=own.near(*terms))
        claims = [(t, self.claims[t.key]) for t in self.named]
        named = tuple(Named(t, c.evidence, dated(c.rivals, t.onset)) for t, c in claims)
        return Naming(self.problem, alone, self.now, named, self.first)


def _weighed_anew(problem: Problem, found: Fit, rounds: int) -> tuple[Problem, Scored]:
    """The problem with weights by what a fit leaves, and the fit there."""
    new = reweighed(problem, found)
    near = problem.carried(new, found.jacobian)
    start = looked_about(new, found.terms, found.values)
    return new, scored(new, found.terms, start, rounds=rounds, known=near)
