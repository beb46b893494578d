"""How far a naming holds: takes it, gives a verdict and held-out errors."""

from dataclasses import dataclass, replace

import numpy as np

from ..recording.data import Floats
from . import document as doc
from . import score
from .case import Case, pieces_of
from .fit import Base, Fit, Problem, fit, start_errors, try_term, whitened
from .free_form import FreeForm
from .name import Naming, Scored, better, held_out, some_of
from .plant import parts
from .stated import stated_terms
from .windows import Windows

LONG = 2.0  # [s] of a piece in the last fit; chosen: slow effects show there
EXPLAINED = 0.5  # share of what can be explained that a name must explain; chosen
WHOLE = 0.9  # share of it that makes a mismatch explained; chosen
ABOVE = 3.0  # times the noise that an unexplained residual must be, to be one; chosen


def polished(case: Case, naming: Naming) -> Naming:
    """The same names, fitted to longer pieces."""
    found = naming.final.fit
    pieces = pieces_of(case.world, LONG)
    start = Problem(case.world, pieces, naming.problem.sigma)
    problem = whitened(start, found.terms, found.values)
    count = len(stated_terms(case.scene))
    alone = fit(problem, found.terms[:count], naming.stated.fit.values, rounds=3)
    alone = _spared(problem, alone)
    if naming.named:
        final = _spared(problem, fit(problem, found.terms, found.values, rounds=4))
    else:
        final = alone
    return replace(
        naming, problem=problem, stated=Scored(alone, held_out(problem, alone)),
        final=Scored(final, held_out(problem, final)),
    )  # fmt: skip


def _spared(problem: Problem, found: Fit) -> Fit:
    """Without changes to stated values that the data do not ask for."""
    errors = doc.uncertainty(problem, found)
    firsts = np.cumsum([0, *(len(t.parameters) for t in found.terms)])[:-1]
    idle = [
        t.effect.name == "stated" and abs(found.values[i] - 1) < doc.LEVEL * errors[i]
        for t, i in zip(found.terms, firsts, strict=True)
    ]
    if not any(idle):
        return found
    keep = [k for k, free in enumerate(idle) if not free]
    terms = tuple(found.terms[k] for k in keep)
    values = [parts(found.terms, found.values)[k] for k in keep]
    less = fit(problem, terms, np.concatenate([*values, np.zeros(0)]), rounds=3)
    return less if less.cost < 1.01 * found.cost else found


@dataclass(frozen=True)
class Structure:
    """What the named effects leave.

    Attributes:
        p_value: that a torque of free form explains no more of it.
        share: of the squared error that it explains.
        above: root mean square of the residual over the noise's.
        explained: share of what can be explained that the names explain.
    """

    p_value: float
    share: float
    above: float
    explained: float

    @property
    def left(self) -> bool:
        """Whether something is left that is no noise."""
        return (self.p_value < 0.01 and self.share > 0.05) or self.above > ABOVE


def structure_of(case: Case, naming: Naming) -> Structure:
    """What is left beside the names, by a torque of free form and by its size."""
    problem, now = naming.problem, naming.final
    base = some_of(Base.of(problem, now.fit), 15000, np.random.default_rng(1))
    held = Scored(base.fit, held_out(base.problem, base.fit))
    p, share = 1.0, 0.0
    terms = FreeForm().terms(case.scene)
    for term in terms:
        found = try_term(base, term, rounds=2)
        new = Scored(found, held_out(base.problem, found))
        p = min(p, better(base.problem, held, new, len(terms)))
        share = max(share, 1 - new.held.sum() / held.held.sum())
    noise = _noise(problem)
    most = naming.stated.held.sum() - noise
    gain = naming.stated.held.sum() - now.held.sum()
    return Structure(
        p, share, float(np.sqrt(now.held.sum() / max(noise, 1e-12))),
        float(gain / max(most, 1e-12)),
    )  # fmt: skip


def _noise(problem: Problem) -> float:
    """Squared residuals that the readings' noise alone would leave."""
    noise = np.concatenate([
        np.maximum(np.nan_to_num(c.noise), c.lattice / np.sqrt(12))
        for c in problem.world.signals
    ])  # fmt: skip
    count = np.isfinite(problem.windows.readings).sum(axis=0)
    return float((count * (noise / problem.sigma) ** 2).sum())


def bare(naming: Naming) -> Naming:
    """The same without any name."""
    return replace(naming, named=(), final=naming.stated)


@dataclass(frozen=True, eq=False)
class Proof:
    """Errors on held-out episodes.

    Attributes:
        pieces: that were replayed.
        count: readings (E, S).
        squares: squared errors (E, S) of each model.
        numbers: scores, of the floor too.
    """

    pieces: Windows
    count: Floats
    squares: dict[str, Floats]
    numbers: dict[str, float]

    @classmethod
    def of(cls, case: Case, naming: Naming) -> "Proof":
        """Of the model as given, re-fitted, and with what was named."""
        world, none = case.held, ((), np.zeros(0))
        found, stated = naming.final.fit, naming.stated.fit
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
        return cls(pieces, count, squares, numbers)


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
    if not room >= 0.05 * numbers["refit"]:
        return None
    return (numbers["refit"] - numbers["patched"]) / room
