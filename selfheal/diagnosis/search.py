"""A search for effects: takes windows and candidates, names what earns it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
from .fit import Fit, bounds, fit
from .noise import above, expected, loudest
from .problem import Problem, is_told, whitened
from .prune import BETTER, prices_of, pruned, swapped, without
from .rough import looked_about
from .screen import MANY, STEPS, Progress, screened, some_of
from .terms import Term, is_new, other_forms, says_anew
from .trial import Base

MOST = 6  # effects at once
WHITE = 0.6  # of the residuals, as many independent ones as white noise has; chosen
QUIET = 1.1  # times the noise, a residual beside names in which no other is looked for
BOUND = 1e-3  # of the way between its bounds, where a stated value is at one; chosen
LITTLE = 0.1  # of the held-out squared error, of a robot that touches; chosen
CHEAPEST = 3  # of several names, that are tried without; chosen


@dataclass
class Search:
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
    def of(cls, problem, stated, candidates, rng, progress, some) -> "Search":
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
                if tries and len(self.named) > MOST:  # most of them go anyway
                    break
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

    def beats(self, other: "Search") -> bool:
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


def _weighed_anew(problem: Problem, found: Fit, rounds: int) -> tuple[Problem, Scored]:
    """The problem with weights by what a fit leaves, and the fit there."""
    new = reweighed(problem, found)
    near = problem.carried(new, found.jacobian)
    start = looked_about(new, found.terms, found.values)
    return new, scored(new, found.terms, start, rounds=rounds, known=near)
