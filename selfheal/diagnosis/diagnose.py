"""A model and recordings in, a diagnosis out: locate, name, prove."""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RecordingError, UnknownNameError
from ..recording import Recording, split
from ..recording.data import Floats
from . import document as doc
from . import locate, score
from .effects import catalogue
from .fit import Base, Fit, Problem, fit, start_errors, try_term, whitened
from .free_form import FreeForm
from .name import Naming, Scored, better, held_out, name_effects, some_of
from .patch import difference, patched
from .plant import Workshop, parts
from .prepare import scene_of, world_of
from .result import Candidate, Diagnosis, Located, SignalFit, Trace
from .scene import Scene
from .stated import stated_terms
from .terms import Term
from .textual import Source, edits
from .windows import Windows, windows
from .world import World

WINDOW = 0.5  # [s] of a simulated piece; chosen: as long as the contract's
LONG = 2.0  # [s] of a piece in the last fit; chosen: slow effects show there
EXPLAINED = 0.5  # share of what can be explained that a name must explain; chosen
WHOLE = 0.9  # share of it that makes a mismatch explained; chosen
PROVEN = 0.98  # of the re-fitted model's held-out error, that names must stay below
HELD = 0.8  # least share removed on held-out episodes for "explained"; chosen
STILL = 0.01  # [rad or m] of motion below which a joint tells nothing; chosen
QUIET, SHORT = 3.0, 3  # least signal over noise, least windows, to say anything; chosen
ABOVE = 3.0  # times the noise that an unexplained residual must be, to be one; chosen

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class _Case:
    """A robot's recordings, parted.

    Attributes:
        workshop: of the given model.
        world: what may be fitted.
        held: what is judged on.
        scene: of the robot.
        names: of the held-out pieces, as the contract writes them.
    """

    workshop: Workshop
    world: World
    held: World
    scene: Scene
    names: tuple[str, ...]


def diagnose(
    model: str | os.PathLike[str],
    recordings: Sequence[Recording],
    *,
    held_out: Sequence[str] = (),
    seed: int = 0,
    progress: Progress | None = None,
) -> Diagnosis:
    """Where simulation and reality differ, and which physics was left out.

    Args:
        model: MJCF or URDF.
        recordings: of the real robot.
        held_out: episodes or pieces kept from the fit, as `recording.split` takes them.
        seed: of the windows that candidates are first tried on.
        progress: told what is being done and how far it is (0 to 1).

    Raises:
        ModelError: MuJoCo cannot load the model.
        RecordingError: a recording does not fit it, or is too short.
    """
    begun = time.monotonic()
    told = progress or (lambda what, share: None)
    case = _prepare(model, recordings, held_out)
    problem = _problem(case, WINDOW)
    _check_enough(case.world, problem)
    naming = name_effects(
        problem, case.scene, stated_terms(case.scene), catalogue().values(),
        rng=np.random.default_rng(seed), progress=told,
    )  # fmt: skip
    told("fitting everything once more", 0.0)
    naming = _polished(case, naming)
    told("looking for what has no name", 0.0)
    structure = _structure(case, naming)
    naming, verdict = _judged(naming, structure)
    proof = _Proof.of(case, naming)
    refuted: tuple[str, ...] = ()
    if naming.named and proof.numbers["patched"] > PROVEN * proof.numbers["refit"]:
        # what does not hold where nothing was fitted is no finding
        refuted = tuple(n.term.label for n in naming.named)
        naming, verdict = _bare(naming), "unlisted"
        proof = _Proof.of(case, naming)
    removed = _removed(proof.numbers)
    if verdict == "explained" and removed is not None and removed < HELD:
        verdict = "partly"
    remarks = _remarks(case, naming, structure, refuted)
    return _told(case, naming, verdict, proof, remarks, begun)


def _prepare(model, recordings, held_out) -> _Case:
    workshop = Workshop(os.fspath(model))
    pairs = _parted(recordings, held_out)
    world = world_of(workshop, [fit for fit, _ in pairs if fit.episodes])
    held = world_of(workshop, [h for _, h in pairs if h.episodes])
    if not world.signals:
        raise RecordingError("no signal holds a reading that the model can predict")
    names = tuple(
        f"{Path(h.file).name}:{name}" for _, h in pairs for name in h.episodes
    )
    return _Case(workshop, world, held, scene_of(world), names)


def _parted(
    recordings: Sequence[Recording], held_out: Sequence[str]
) -> list[tuple[Recording, Recording]]:
    """Of each recording, what may be fitted and what is held out.

    Raises:
        UnknownNameError: a name that is no episode.
        RecordingError: nothing is left to fit.
    """
    if not held_out or len(recordings) == 1:
        return [split(r, held_out=held_out) for r in recordings]
    own: list[list[str]] = [[] for _ in recordings]
    for entry in held_out:
        own[_owner(recordings, entry)].append(entry)
    pairs = []
    for recording, entries in zip(recordings, own, strict=True):
        whole = {e.removeprefix(f"{recording.file}:") for e in entries}
        whole = {e.removeprefix(f"{Path(recording.file).name}:") for e in whole}
        none = replace(recording, episodes={})
        if not entries:
            pairs.append((recording, none))
        elif whole >= set(recording.episodes):
            pairs.append((none, recording))
        else:
            pairs.append(split(recording, held_out=entries))
    if not any(fit.episodes for fit, _ in pairs):
        raise RecordingError("held out is everything; nothing is left to fit")
    return pairs


def _owner(recordings: Sequence[Recording], entry: str) -> int:
    """Which of several recordings a held-out name speaks of."""
    for i, recording in enumerate(recordings):
        for file in (recording.file, Path(recording.file).name):
            if entry.startswith(f"{file}:"):
                return i
    for i, recording in enumerate(recordings):
        if any(entry == n or entry.startswith(f"{n}[") for n in recording.episodes):
            return i
    valid = [f"{Path(r.file).name}:{n}" for r in recordings for n in r.episodes]
    raise UnknownNameError("held-out episode", entry, valid)


def _problem(case: _Case, seconds: float) -> Problem:
    """Windows of the fitted recordings, weighted by the given model's error."""
    world = case.world
    pieces = _windows(world, seconds)
    stated = stated_terms(case.scene)
    apart = world.simulate([], np.zeros((1, 0)), pieces)[0] - pieces.readings
    sigma = np.sqrt(
        np.nanmean(np.where(np.isfinite(apart), apart, np.nan) ** 2, axis=0)
    )
    spread = np.concatenate([np.full(c.width, c.spread) for c in world.signals])
    sigma = np.clip(np.where(np.isfinite(sigma), sigma, spread), 1e-9 * spread, spread)
    return whitened(Problem(world, pieces, sigma), stated, np.ones(len(stated)))


def _check_enough(world: World, problem: Problem) -> None:
    """Refuse what could only be answered with "nothing", for want of evidence.

    Raises:
        RecordingError: too short, or nothing moved.
    """
    if len(problem.windows) < SHORT:
        raise RecordingError(
            f"{len(problem.windows)} pieces of {WINDOW} s are too few to decide "
            f"anything; would fit: at least {SHORT}, better 40, beside what is held out"
        )
    loud = [
        c.name for c in world.signals
        if c.scored and not c.spread < QUIET * np.sqrt(np.nansum(c.noise**2))
    ]  # fmt: skip
    if not loud:
        raise RecordingError(
            "no position-like signal moves by more than its noise; would fit: a "
            "recording in which the robot moves"
        )


def _windows(world: World, seconds: float) -> Windows:
    """Pieces that begin where the state can be read; whole episodes elsewhere."""
    steps = max(2, round(seconds / world.step))
    parts = []
    for i, log in enumerate(world.logs):
        parts.append(
            windows(world.logs, steps if _readable(world, log) else None, only=i)
        )
    return Windows.joined(parts)


def _readable(world: World, log) -> bool:
    """Whether readings tell every joint's position all along."""
    from .state import estimate

    at = np.linspace(0, log.at[-1], 9)[1:-1]
    qpos, _, _ = estimate(world.workshop.given, world.signals, log, at, world.step, {})
    return bool(np.isfinite(qpos).all(axis=1).mean() > 0.5)


def _polished(case: _Case, naming: Naming) -> Naming:
    """The same names, fitted to longer pieces."""
    found = naming.final.fit
    pieces = _windows(case.world, LONG)
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
class _Structure:
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


def _structure(case: _Case, naming: Naming) -> _Structure:
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
    return _Structure(
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


def _bare(naming: Naming) -> Naming:
    """The same without any name."""
    return replace(naming, named=(), final=naming.stated)


@dataclass(frozen=True, eq=False)
class _Proof:
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
    def of(cls, case: _Case, naming: Naming) -> "_Proof":
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


def _judged(naming: Naming, structure: _Structure) -> tuple[Naming, str]:
    """The verdict; names that explain too little are taken back."""
    if naming.named and structure.left and structure.explained < EXPLAINED:
        return _bare(naming), "unlisted"
    if naming.named:
        whole = structure.explained > WHOLE or not structure.left
        return naming, "explained" if whole else "partly"
    return naming, "unlisted" if structure.left else "nothing"


def _told(
    case: _Case, naming: Naming, verdict: str, proof: _Proof, remarks, begun: float
) -> Diagnosis:
    found, stated, numbers = naming.final.fit, naming.stated.fit, proof.numbers
    located, where = _located(case, naming)
    text, diff = _patch(case, found)
    document = {
        "format": "selfheal-diagnosis",
        "version": 1,
        "verdict": verdict,
        "findings": doc.findings_of(naming, where),
        "refit": doc.refit_of(naming),
        "fit": {"held_out": list(case.names), **numbers,
                "explainable_removed": _removed(numbers)},
    }  # fmt: skip
    return Diagnosis(
        doc.plain(document), text, diff, _traces(case, proof.pieces, stated, found),
        located, _signals(case, proof.squares, proof.count), _candidates(naming),
        remarks, time.monotonic() - begun,
        int(case.world.counted[0] + case.held.counted[0]),
    )  # fmt: skip


def _floor(case: _Case, pieces: Windows, found: Fit) -> float:
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


def _removed(numbers: dict[str, float]) -> float | None:
    room = numbers["refit"] - numbers["floor"]
    if not room >= 0.05 * numbers["refit"]:
        return None
    return (numbers["refit"] - numbers["patched"]) / room


def _located(case: _Case, naming: Naming):
    """The map of the re-fitted model's error, and where each finding acts."""
    world, problem = case.world, naming.problem
    pieces = problem.windows
    before = _squares(problem, naming.stated.fit)
    share, p = locate.grid(world, case.scene, pieces, before)
    located = Located(tuple(c.name for c in world.signals), locate.REGIMES, share, p)
    where = {}
    masks = locate.regimes(world, case.scene, pieces)
    for n, named in enumerate(naming.named):
        less = _squares(problem, _without(naming.final.fit, named.term))
        gain = less - _squares(problem, naming.final.fit)
        where[n] = _where(case, pieces, masks, gain)
    return located, where


def _without(found: Fit, term: Term) -> Fit:
    """The same fit with one effect taken away and nothing fitted anew."""
    ends = np.cumsum([0, *(len(t.parameters) for t in found.terms)])
    rest = [i for i, t in enumerate(found.terms) if t is not term]
    values = [found.values[ends[i] : ends[i + 1]] for i in rest]
    terms = tuple(found.terms[i] for i in rest)
    return replace(found, terms=terms, values=np.concatenate([*values, np.zeros(0)]))


def _squares(problem: Problem, found: Fit) -> Floats:
    """Squared residuals (M, S) in standard deviations, summed over columns."""
    plain = replace(problem, whiten=())
    r = plain.residuals(found.terms, found.values[None])[0]
    r = r.reshape(problem.windows.readings.shape)
    return np.stack(
        [(r[:, c.columns] ** 2).sum(axis=1) for c in problem.world.signals], axis=1
    )


def _where(case: _Case, pieces: Windows, masks, gain: Floats) -> dict[str, Any]:
    world = case.world
    by_signal = np.maximum(gain.sum(axis=0), 0)
    by_signal = by_signal / max(by_signal.sum(), 1e-300)
    order = np.argsort(-by_signal)
    signals = [
        {"name": world.signals[s].name, "share_of_error": by_signal[s],
         "p_value": _helped(pieces, gain[:, s])}
        for s in order if by_signal[s] > 0.02
    ]  # fmt: skip
    by_window = np.bincount(pieces.window, gain.sum(axis=1), minlength=len(pieces))
    worst = np.argsort(-by_window)[:3]
    return {
        "signals": signals,
        "regime": _regime(masks, gain),
        "windows": [_window(world, pieces, int(w)) for w in worst],
    }


def _helped(pieces: Windows, gain: Floats) -> float:
    """p-value that an effect lowers a signal's error, over windows."""
    from scipy.stats import wilcoxon

    each = np.bincount(pieces.window, gain, minlength=len(pieces))
    each = each[each != 0]
    return float(wilcoxon(each, alternative="greater").pvalue) if len(each) > 5 else 1.0


def _regime(masks: np.ndarray, gain: Floats) -> str:
    """Where the gain is densest, if anywhere."""
    total, size = gain.sum(), gain.size
    best, density = "always", 1.5
    for r, name in enumerate(locate.REGIMES):
        inside = masks[r]
        if inside.sum() < locate.FEW or total <= 0:
            continue
        share = gain[inside].sum() / total
        if share > 0.3 and share / (inside.sum() / size) > density:
            best, density = name, share / (inside.sum() / size)
    return best


def _window(world: World, pieces: Windows, w: int) -> dict[str, Any]:
    log = world.logs[int(pieces.log[w])]
    start = log.start + pieces.start[w] * world.step
    return {"episode": log.id, "start": start,
            "end": start + pieces.steps[w] * world.step}  # fmt: skip


def _patch(case: _Case, found: Fit) -> tuple[str, str]:
    path = Path(case.workshop.path)
    home = path.resolve().parent
    given = patched(path, (), home)
    plant = case.workshop.plant(found.terms)
    changes = edits(Source(given), plant, found.terms, found.values)
    text = patched(path, changes, home)
    return text, difference(given, text)


def _traces(case: _Case, pieces: Windows, stated: Fit, found: Fit) -> tuple[Trace, ...]:
    """The worst stretches of the held-out episodes, by the re-fitted model."""
    world, none = case.held, ((), np.zeros(0))
    each = [
        world.simulate(terms, values[None], pieces)[0]
        for terms, values in (none, (stated.terms, stated.values),
                              (found.terms, found.values))
    ]  # fmt: skip
    worst = []
    for c in world.signals:
        for k in range(c.first, c.first + c.width):
            apart = (each[1][:, k] - pieces.readings[:, k]) / c.spread
            square = np.nan_to_num(apart**2, nan=0.0, posinf=0.0)
            by = np.bincount(pieces.window, square, minlength=len(pieces))
            w = int(by.argmax())
            worst.append((by[w] * (2 if c.scored else 1), c, k, w))
    worst.sort(key=lambda x: -x[0])
    return tuple(_trace(world, pieces, each, c, k, w) for _, c, k, w in worst[:4])


def _trace(world: World, pieces: Windows, each, c, k: int, w: int) -> Trace:
    rows = np.flatnonzero(pieces.window == w)
    log = world.logs[int(pieces.log[w])]
    at = log.start + (pieces.start[w] + pieces.at[rows]) * world.step
    name = c.name if c.width == 1 else f"{c.name}[{k - c.first}]"
    return Trace(log.id, name, c.unit, at, pieces.readings[rows, k],
                 *(e[rows, k] for e in each))  # fmt: skip


def _signals(case: _Case, squares, count) -> tuple[SignalFit, ...]:
    world, noise = case.held, score.noise_floor(case.held)
    return tuple(
        SignalFit(
            c.name, c.scored, floor=float(noise[s]),
            **{k: score.interval(world, x, count, s) for k, x in squares.items()},
        )
        for s, c in enumerate(world.signals)
    )  # fmt: skip


def _candidates(naming: Naming) -> tuple[Candidate, ...]:
    named = {(n.term.effect.name, n.term.targets) for n in naming.named}
    return tuple(
        Candidate(t.effect.name, ", ".join(t.targets), left,
                  (t.effect.name, t.targets) in named)
        for t, left in naming.ranking
    )  # fmt: skip


def _remarks(
    case: _Case, naming: Naming, structure: _Structure, refuted: Sequence[str]
) -> tuple[str, ...]:
    """What a reader should know before believing the rest."""
    found = [
        f"Joint {j.name} moved by less than {STILL} {j.unit}: what is wrong with it, "
        "if anything is, these recordings cannot show."
        for j in case.scene.joints
        if j.measured and j.range < STILL
    ]
    if refuted:
        found.append(
            f"What fitted best, {'; '.join(refuted)}, did not hold on the held-out "
            "episodes, so nothing is named."
        )
    if structure.left and structure.share > 0.05:
        found.append(
            f"A torque of free form would explain {structure.share:.0%} of what is "
            "left."
        )
    loose = [e["parameter"] for e in doc.refit_of(naming) if _is_loose(naming, e)]
    if loose:
        found.append(f"Not pinned down by these data: {', '.join(loose)}.")
    return tuple(found)


def _is_loose(naming: Naming, entry: dict[str, Any]) -> bool:
    """Whether a stated value's interval is as wide as what a user would grant it."""
    term = next(t for t in naming.final.fit.terms if t.targets[0] == entry["parameter"])
    (p,) = term.parameters
    return entry["high"] - entry["low"] > 0.9 * abs(entry["given"]) * (p.high - p.low)
