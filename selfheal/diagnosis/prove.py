"""How far a naming holds: takes it, gives a verdict and held-out errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from ..recording.data import Floats
from . import score
from .case import LONG, WINDOW, Case, pieces_of
from .choose import strain_of_note
from .evidence import (
    ABOVE,
    Scored,
    better,
    for_score,
    reseated,
)
from .fit import CLOSE, Fit, fit, looked_about, rested
from .free_form import FreeForm
from .name import Named, Naming
from .noise import above, expected, loudest, most, noise_of
from .plant import parts
from .problem import Problem, is_told, start_errors, whitened
from .prune import is_plainer, swapped, without
from .screen import STEPS, drawn, fewer
from .terms import Term, is_new
from .trial import Base, try_term
from .windows import Windows
from .world import World

# steps of simulation in the last fit, about, and in all differences of it; chosen: a
# minute at 1 ms, and no more for a robot of which much is stated
POLISHED, SLOPES = 40000, 1e6
STEPPED = 15000  # of them in a fit to the model's own time step; chosen
EXPLAINED = 0.5  # share of what can be explained that a name must explain; chosen
LITTLE = 0.1  # of it in the held-out episodes: names that remove less are none; chosen
ROOM = 0.05  # of an error, less than which cannot be explained (contract section 2)
WHOLE = 0.9  # share of it that makes a mismatch explained; chosen
CLEARLY = 0.8  # of a hypothesis' held-out squared error, that of a better one; chosen
# least share of the squared error in held-out episodes that a name removes, and of what
# all of them together do; chosen
HELPS, TRIFLE = 0.01, 0.003
WORSE = 1.05  # times the re-fitted model's held-out error: no name stands; chosen
ASTRAY = 6.0  # times the floor: a replay that far off is not all explained; chosen
UNSEEN = 0.1  # of what a name removes in fitted episodes, what it changes in those held
# out, relative to the error there: less cannot refute it; chosen

Upheld = tuple[Naming, tuple[str, ...]]  # a hypothesis, and labels of what was refuted


def polished(case: Case, naming: Naming) -> Naming:
    """The same names, fitted to more pieces, to longer ones if those can be told."""
    found = naming.final.fit
    sigma = for_score(naming.problem, found)
    rng = np.random.default_rng(2)
    steps = int(np.clip(SLOPES / max(len(found.values), 1), STEPS[-1], POLISHED))
    short, long = (
        fewer(Problem(case.world, pieces_of(case.world, seconds), sigma), steps, rng)
        for seconds in (WINDOW, LONG)
    )
    problem = long if is_told(long, short, found.terms, found.values) else short
    return _refitted(whitened(problem, found.terms, found.values), naming)


def _refitted(problem: Problem, naming: Naming) -> Naming:
    """The same names in other windows."""
    found, stated = naming.final.fit, naming.stated.fit
    alone = fit(problem, stated.terms, stated.values, rounds=6)
    final = alone
    if naming.named:
        start = looked_about(problem, found.terms, found.values)
        final = fit(problem, found.terms, start, rounds=6)
        if problem.world.touches:  # the cost has many minima
            start = looked_about(problem, found.terms, final.values, CLOSE)
            if (start != final.values).any():
                new = fit(problem, found.terms, start, rounds=3, known=final.jacobian)
                final = min(final, new, key=lambda f: f.cost)
        else:
            problem, final = reseated(problem, final)
    # where something touches, or is left, the cost is too rough for it
    if not problem.world.touches and above(problem, final.residuals) <= ABOVE:
        final = rested(problem, final)
    whole = Scored.of(problem, final)
    less = Scored.of(problem, alone) if naming.named else whole
    return replace(naming, problem=problem, stated=less, final=whole)


def plainest(naming: Naming) -> Naming:
    """The same; what cannot be told from a name has its place if it is plainer.

    In more pieces than those that named it a number may turn out to do nothing, as the
    speed at which a motor's torque ends.
    """
    problem = naming.problem
    for name in naming.named:
        plainer = [t for t in name.equivalent if is_plainer(t, name.term)]
        final = swapped(problem, naming.final, name.term, plainer)
        if final is naming.final:
            continue
        rest = tuple(t for t in name.equivalent if t.key != final.last.key)
        new = replace(name, term=final.last, equivalent=(name.term, *rest))
        named = tuple(new if n is name else n for n in naming.named)
        naming = replace(naming, final=final, named=named)
    return naming


def likeliest(case: Case, hypotheses: Sequence[Upheld]) -> Upheld:
    """Of several the first, unless held-out episodes speak for another.

    Clearly, if that one says more or rarer things.
    """
    if len(hypotheses) == 1:
        return hypotheses[0]
    errors = _errors(case, [naming for naming, _ in hypotheses])
    best = int(np.argmin(errors))
    new, old = _sizes(hypotheses[best][0]), _sizes(hypotheses[0][0])
    simpler = all(n <= o for n, o in zip(new, old, strict=True))
    margin = 1.0 if simpler else CLEARLY
    return hypotheses[best if errors[best] < margin * errors[0] else 0]


def _sizes(naming: Naming) -> tuple[int, int]:
    """How many rare effects a hypothesis names, and numbers of all of them."""
    terms = [n.term for n in naming.named]
    return sum(t.effect.rare for t in terms), sum(len(t.parameters) for t in terms)


def in_question(case: Case, namings: Sequence[Naming]) -> list[Naming]:
    """The first of several, and those that are as good in the held-out episodes."""
    errors = _errors(case, namings) if len(namings) > 1 else [0.0]
    return [n for n, e in zip(namings, errors, strict=True) if e <= errors[0]]


def _errors(case: Case, namings: Sequence[Naming]) -> list[float]:
    """Squared residuals in held-out episodes, weighed as the first one's score."""
    sigma = for_score(namings[0].problem, namings[0].final.fit)
    held = Problem(case.held, pieces_of(case.held, WINDOW), sigma)
    return [_error(held, naming.final.fit) for naming in namings]


def upheld(case: Case, naming: Naming) -> Upheld:
    """Only the names that help in the held-out episodes, and labels of the others.

    A name that makes far less difference there than where it was fitted, as that of a
    rotor's inertia where nothing moves fast, is not refuted. What could not be told
    from one that is refuted takes its place, if it helps.
    """
    gone: list[str] = []
    start = Problem(case.held, pieces_of(case.held, WINDOW), naming.problem.sigma)
    while naming.named:
        found, alone = naming.final.fit, naming.stated.fit
        held = whitened(start, found.terms, found.values)
        told = held.at(found.terms, found.values)
        error = float(told @ told)
        before = _own_error(held, alone)
        least = max(HELPS * error, TRIFLE * (before - error))
        weakest = None
        values = dict(zip(found.terms, parts(found.terms, found.values), strict=True))
        for name in naming.named:
            less = without(naming.problem, found, name.term)
            other = held.at(less.terms, less.values)
            gain = _own_error(held, less, other) - error
            if name.term.is_faint(values[name.term]):
                weakest = -np.inf, name, less
                break
            relief = less.strain - found.strain
            if relief > strain_of_note(held, found) and gain > -least:
                continue
            changed = float(((other - told) ** 2).sum()) / error
            if changed < UNSEEN * (less.cost / found.cost - 1):
                continue
            if gain < least and (weakest is None or gain < weakest[0]):
                weakest = gain, name, less
        if weakest is None:
            break
        _, name, less = weakest
        gone.append(name.term.label)
        instead, best = in_its_place(naming.problem, held, name, less)
        named = [[n] if n is not name else instead for n in naming.named]
        naming = replace(
            naming, final=Scored.of(naming.problem, best), named=tuple(chain(*named))
        )
    return naming, tuple(gone)


def in_its_place(
    problem: Problem, held: Problem, refuted: Named, less: Fit
) -> tuple[list[Named], Fit]:
    """Of what was equivalent to a name, what helps the most if anything does."""
    instead, best, least = [], less, (1 - HELPS) * _error(held, less)
    for term in refuted.equivalent:
        if not is_new(term, less.terms):
            continue
        tried = try_term(Base.of(problem, less), term)
        found = fit(problem, tried.terms, tried.values, rounds=6)
        if (error := _error(held, found)) < least:
            others = tuple(t for t in refuted.equivalent if t is not term)
            instead = [replace(refuted, term=found.terms[-1], equivalent=others)]
            best, least = found, error
    return instead, best


def _outlasting(case: Case, naming: Naming) -> float:
    """Share of the explainable error that the names remove in held-out pieces.

    Signals weighed as in the fit: the contract's score, over their spread there, is of
    little else than one that hardly moves in a few poses; and of a chaotic robot's
    replay it tells where that was when it began.
    """
    sigma, found = naming.problem.sigma, naming.final.fit
    held = Problem(case.held, pieces_of(case.held, WINDOW), sigma)
    held = whitened(held, found.terms, found.values)
    before, after = np.sqrt([_own_error(held, naming.stated.fit), _error(held, found)])
    room = before - np.sqrt(noise_of(held))
    return float((before - after) / max(room, ROOM * before))


def _error(problem: Problem, found: Fit) -> float:
    """Sum of squared residuals of a fit in other windows than its own."""
    return float((problem.at(found.terms, found.values) ** 2).sum())


def _own_error(problem: Problem, found: Fit, told: Floats | None = None) -> float:
    """The same; where starts were sought, from those likeliest for this fit.

    `told`: (R) residuals from the problem's own starts, if they are known.
    """
    if problem.shift is not None:
        return _error(whitened(problem, found.terms, found.values), found)
    return _error(problem, found) if told is None else float(told @ told)


@dataclass(frozen=True)
class Structure:
    """What the named effects leave.

    Attributes:
        p_value: that a torque of free form explains no more of it.
        share: of the squared error that it explains.
        above: root mean square of the residual over what noise and time step leave.
        loudest: the same in the worst scored column.
        explained: share of what can be explained that the names explain.
    """

    p_value: float
    share: float
    above: float
    loudest: float
    explained: float

    @property
    def left(self) -> bool:
        """Whether something is left that is no noise."""
        shown = self.p_value < 0.01 and self.share > 0.05
        return (shown and self.above > 1) or max(self.above, self.loudest) > ABOVE


def structure_of(case: Case, naming: Naming) -> Structure:
    """What is left beside the names, by a torque of free form and by its size."""
    now, rng = naming.final.fit, np.random.default_rng(1)
    pieces = Problem(case.world, pieces_of(case.world, WINDOW), naming.problem.sigma)
    problem = whitened(fewer(pieces, 15000, rng), now.terms, now.values)
    base = Base.of(problem, fit(problem, now.terms, now.values, rounds=0))
    held = Scored.of(problem, base.fit)
    p, share = 1.0, 0.0
    terms = FreeForm().terms(case.scene)
    for term in terms:
        new = Scored.of(problem, try_term(base, term, rounds=2))
        p = min(p, better(problem, held, new, len(terms)))
        share = max(share, 1 - new.error / held.error)
    before, left = _own_error(problem, naming.stated.fit), base.fit.cost
    noise = expected(problem, base.fit)
    if naming.named and problem.windows.is_single:
        noise = max(noise, most(problem, base.fit.residuals))
    return Structure(
        p, share, float(np.sqrt(left / max(noise, 1e-12))),
        loudest(problem, base.fit),
        float((before - left) / max(before - noise, 1e-12)),
    )  # fmt: skip


def bare(naming: Naming) -> Naming:
    """The same without any name."""
    return replace(naming, named=(), final=naming.stated)


def stepped(base: Base) -> Fit:
    """The same effects, with stated values that suit the model's own time step.

    What a user sees who replays the model: half a step early, and damped otherwise
    than in continuous time. A fit in continuous time gives the effects' truth.
    """
    problem, found = base.problem, base.fit
    plain = replace(problem.raw, centered=False)
    plain = whitened(plain, found.terms, found.values)
    near = problem.carried(plain, found.jacobian)
    fixed = [
        t if t.effect.name == "stated" else _fixed(t, v)
        for t, v in zip(found.terms, parts(found.terms, found.values), strict=True)
    ]
    best = fit(plain, fixed, found.values, rounds=2, known=near)
    return replace(best, terms=found.terms)


def _fixed(term: Term, values: Floats) -> Term:
    """The term with no other values than these."""
    parameters = tuple(
        replace(p, low=float(v), high=float(v))
        for p, v in zip(term.parameters, values, strict=True)
    )
    return replace(term, parameters=parameters)


@dataclass(frozen=True, eq=False)
class Proof:
    """Errors on held-out episodes.

    Attributes:
        stated: the re-fitted model, as MuJoCo steps it.
        patched: that with what was named.
        pieces: that were replayed.
        count: readings (E, S).
        squares: squared errors (E, S) of each model.
        numbers: scores, of the floor too.
    """

    stated: Fit
    patched: Fit
    pieces: Windows
    count: Floats
    squares: dict[str, Floats]
    numbers: dict[str, float]

    @classmethod
    def of(cls, case: Case, naming: Naming) -> "Proof":
        """Of the model as given, re-fitted, and with what was named."""
        world, none = case.held, ((), np.zeros(0))
        some = drawn(naming.problem, STEPPED, np.random.default_rng(3))
        fits = [naming.stated.fit, *([naming.final.fit] if naming.named else ())]
        plain = [stepped(Base.of(naming.problem, f).take(some)) for f in fits]
        stated, found = plain[0], plain[-1]
        pieces = score.replayed(world)
        count = score.counts(world, pieces)
        models = {"given": none, "refit": (stated.terms, stated.values),
                  "patched": (found.terms, found.values)}  # fmt: skip
        squares = {
            k: score.errors(world, pieces, terms, values)
            for k, (terms, values) in models.items()
        }
        numbers = {k: score.score(world, s, count) for k, s in squares.items()}
        numbers["floor"] = min(_floor(case, pieces, found), numbers["patched"])
        return cls(stated, found, pieces, count, squares, numbers)


def judged(naming: Naming, structure: Structure) -> tuple[Naming, str]:
    """The verdict; names that explain too little are taken back."""
    if naming.named and structure.left and structure.explained < EXPLAINED:
        return bare(naming), "unlisted"
    if naming.named:
        whole = structure.explained > WHOLE or not structure.left
        return naming, "explained" if whole else "partly"
    return naming, "unlisted" if structure.left else "nothing"


def _floor(case: Case, pieces: Windows, found: Fit) -> float:
    """Score that the readings' noise alone would leave, as far as it is known.

    Noise is in what a prediction is compared with and, where the initial state was
    read, in what it starts from.
    """
    world = case.held
    kick = start_errors(world, pieces)
    told = world.simulate(
        found.terms, np.tile(found.values, (len(kick), 1)), pieces, kick=kick
    )
    moved = np.nansum((told[1:] - told[0]) ** 2, axis=0)
    squares = []
    for c in world.signals:
        noise = np.nansum(np.nan_to_num(c.noise) ** 2)
        read = np.isfinite(pieces.readings[:, c.columns]).all(axis=1)
        start = moved[read][:, c.columns].sum(axis=1)
        squares.append((noise + (start.mean() if read.any() else 0)) / c.spread**2)
    scored = np.array([c.scored for c in world.signals])
    return float(np.sqrt(np.mean(np.array(squares)[scored]))) if scored.any() else 0.0


def removed_share(numbers: dict[str, float]) -> float | None:
    """The contract's explainable_removed; None where too little could be."""
    room = numbers["refit"] - numbers["floor"]
    if not room >= ROOM * numbers["refit"]:
        return None
    return (numbers["refit"] - numbers["patched"]) / room


def is_worse(case: Case, naming: Naming, proof: Proof) -> bool:
    """Whether the names make a replay of what is held out worse.

    Not if they explain nearly all in its pieces: a robot that falls, or is chaotic, is
    soon elsewhere whatever is true of it.
    """
    patched = proof.numbers["patched"]
    if not np.isfinite(patched):  # it diverges, whatever the re-fitted model does
        return True
    worse = patched > WORSE * proof.numbers["refit"]
    return worse and _outlasting(case, naming) < WHOLE


def is_little(case: Case, naming: Naming, proof: Proof) -> bool:
    """Whether names remove next to nothing of what can be explained where held out."""
    if proof.pieces.is_single:
        return _outlasting(case, naming) < LITTLE
    removed = removed_share(proof.numbers)
    if removed is None or removed >= LITTLE:
        return False
    return _outlasting(case, naming) < EXPLAINED


def is_astray(case: Case, naming: Naming, proof: Proof) -> bool:
    """Whether what is held out is further from the replay than noise can make it.

    Of a robot that something touches in most episodes: in one it may fall on another
    side by chance. And with the time step's own error taken away as well as with it. Of
    single readings nothing tells the noise.
    """
    if proof.pieces.is_single:
        return False
    world, found, far = case.held, naming.final.fit, ASTRAY * proof.numbers["floor"]
    if _usual(world, proof.squares["patched"], proof.count) <= far:
        return False
    finer = score.errors(world, proof.pieces, found.terms, found.values, centered=True)
    return _usual(world, finer, proof.count) > far


def _usual(world: World, squares: Floats, count: Floats) -> float:
    """Score of squared errors (E, S); where something touches, of half the episodes."""
    if not world.touches:
        return score.score(world, squares, count)
    each = zip(squares, count, strict=True)
    return float(np.nanmedian([score.score(world, s[None], n[None]) for s, n in each]))
