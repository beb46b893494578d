"""Which physics is missing: takes a fitted model, gives effects that earn a name."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from .evidence import Evidence, Scored, scored
from .onset import dated, placed
from .problem import Problem
from .scene import Scene
from .screen import SEARCHED, STEPS, Progress, drawn, fewer, overlooked
from .search import Search
from .terms import Term


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


def begin_search(
    problem: Problem,
    scene: Scene,
    stated: Sequence[Term],
    effects: Iterable,
    *,
    rng: np.random.Generator,
    progress: Progress = lambda what, share: None,
) -> Search:
    """A search in which nothing has a name yet.

    Args:
        problem: all windows that may be used.
        scene: of the robot.
        stated: terms of what the model states.
        effects: the catalogue.
        rng: chooses the windows on which candidates are tried first.
        progress: told what is being done and how far it is.
    """
    kinds = [effect for effect in effects if not effect.rounds]
    candidates = tuple(term for effect in kinds for term in effect.terms(scene))
    progress("refitting what the model states", 0.0)
    some = drawn(problem, _steps(len(stated)), rng)
    begin = partial(Search.of, problem, stated, candidates, rng, progress)
    search = begin(some)
    if search.is_done:
        odd = overlooked(problem, some, search.problem, search.now.fit)
        search = begin(np.union1d(some, odd)) if len(odd) else search
    return search


def _steps(stated: int) -> int:
    """Steps of simulation in a search, of a robot of which so many terms are stated."""
    return min(STEPS[-1], int(SEARCHED / max(stated, 1)))


def name_effects(search: Search, problem: Problem, longer: Problem) -> list[Naming]:
    """Find the effects without which the recordings cannot be explained.

    Forward, with a look back after each step: what a later effect makes needless goes.
    Where that leaves something (more than a tenth, if something touches: the cost is
    rough there), once more from all the usual ones at once: the first one named alone
    may have stood for several. And in longer pieces, if the starts allow it: slow
    effects show there.

    Args:
        search: in which nothing has a name yet.
        problem: all windows that may be used.
        longer: the same in longer pieces.

    Returns:
        One hypothesis, or what both searches found, the likelier first.
    """
    start, candidates = replace(search), search.candidates
    search.forward()
    # poses do not show what most robots have
    if search.is_done or problem.windows.is_single:
        return [_ended(search, problem)]
    # what the first search set aside for a name, the second one tries in its place
    likely = [t for t in candidates if t in search.candidates or t.effect.is_usual(t)]
    other = replace(
        start, claims=dict(search.claims), first=search.first, candidates=likely
    )
    longer = replace(
        fewer(longer, _steps(search.stated), search.rng), sigma=search.problem.sigma,
        world=search.problem.world,
    )  # fmt: skip
    if not other.with_all_usual(longer, {t.key for t in search.named}):
        return [_ended(search, problem)]
    both = (other, search) if other.beats(search) else (search, other)
    return [_ended(s, problem) for s in both]


def _ended(search: Search, whole: Problem) -> Naming:
    """What a search found, in some of the `whole`'s windows."""
    terms = search.named
    if any(t.onset for t in terms):
        search.now = placed(search.problem, whole, search.now)
        terms = search.named
    own = search.now.fit
    alone = scored(search.problem, *own.but(*terms), known=own.near(*terms))
    claims = [(t, search.claims[t.key]) for t in terms]
    named = tuple(Named(t, c.evidence, dated(c.rivals, t.onset)) for t, c in claims)
    return Naming(search.problem, alone, search.now, named, search.first)
