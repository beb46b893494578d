"""How far a naming holds: takes it, gives a verdict and held-out errors."""

from dataclasses import dataclass, replace

import numpy as np

from ..recording.data import Floats
from . import score
from .case import WINDOW, Case, pieces_of
from .evidence import ABOVE, Scored, better
from .fit import Fit, fit
from .free_form import FreeForm
from .name import Naming
from .noise import expected, loudest, most, noise_of
from .polish import stepped
from .problem import Problem, start_errors, whitened
from .refute import error_of, own_error
from .screen import drawn, fewer
from .trial import Base, try_term
from .windows import Windows
from .world import World

STEPPED = 15000  # steps of simulation in a fit to the model's own time step; chosen
EXPLAINED = 0.5  # share of what can be explained that a name must explain; chosen
LITTLE = 0.1  # of it in the held-out episodes: names that remove less are none; chosen
ROOM = 0.05  # of an error, less than which cannot be explained (contract section 2)
WHOLE = 0.9  # share of it that makes a mismatch explained; chosen
# times the re-fitted model's held-out error: no name stands, or none that explains its
# pieces; chosen
WORSE, OTHER = 1.05, 3.0
ASTRAY = 6.0  # times the floor: a replay that far off is not all explained; chosen


def _outlasting(case: Case, naming: Naming) -> float:
    """Share of the explainable error that the names remove in held-out pieces.

    Signals weighed as in the fit: the contract's score, over their spread there, is of
    little else than one that hardly moves in a few poses; and of a chaotic robot's
    replay it tells where that was when it began.
    """
    sigma, found = naming.problem.sigma, naming.final.fit
    held = Problem(case.held, pieces_of(case.held, WINDOW), sigma)
    held = whitened(held, found.terms, found.values)
    before, after = np.sqrt([own_error(held, naming.stated.fit), error_of(held, found)])
    room = before - np.sqrt(noise_of(held))
    return float((before - after) / max(room, ROOM * before))


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
    left = base.fit.cost
    before = own_error(problem, naming.stated.fit) if naming.named else left
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

    Not if they explain nearly all in its pieces and it is no other thing: a robot that
    falls, or is chaotic, is soon elsewhere whatever is true of it.
    """
    patched, refit = proof.numbers["patched"], proof.numbers["refit"]
    if not np.isfinite(patched):  # it diverges, whatever the re-fitted model does
        return True
    if patched > OTHER * refit:
        return True
    return patched > WORSE * refit and _outlasting(case, naming) < WHOLE


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
