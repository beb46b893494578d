"""What a user is told: takes a proven naming, gives a Diagnosis."""

import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import ModelError
from ..recording.data import Floats
from . import document as doc
from . import locate, score
from .case import Case
from .fit import Fit, sloped
from .intervals import uncertainty
from .name import Naming
from .patch import difference, patched
from .problem import Problem
from .prove import Proof, Structure, removed_share
from .result import Candidate, Diagnosis, Located, SignalFit, Trace
from .scene import Channel
from .stated import is_loose
from .terms import Term
from .textual import Edit, Source, compiled, edits
from .usable import divergence
from .windows import Windows
from .world import World

FEW = 6  # names that a remark lists; chosen
UNPATCHED = (
    "patched.xml is the model as given, for its text cannot say what was found; "
    "selfheal replay applies all of it. {}. Of a model without such elements, as "
    "mujoco.MjSpec.to_xml writes one, a patch could be made: diagnose that."
)
STILL = 0.01  # [rad or m] of motion below which a joint tells nothing; chosen


def answer_of(
    case: Case,
    naming: Naming,
    verdict: str,
    proof: Proof,
    structure: Structure,
    refuted: Sequence[str],
    begun: float,
) -> Diagnosis:
    """The document, the patched model, and what a page draws beside them."""
    found, stated, numbers = proof.patched, proof.stated, proof.numbers
    located, where = _located(case, naming)
    problem = naming.problem
    errors = uncertainty(problem, sloped(problem, naming.final.fit))
    refit = doc.refit_of(found, errors)
    remarks = _remarks(case, naming, structure, refuted, refit)
    text, diff, changes, unpatched = patch_or_given(case, found)
    document = {
        "format": "selfheal-diagnosis",
        "version": 1,
        "verdict": verdict,
        "findings": doc.findings_of(naming, errors, where),
        "refit": refit,
        "fit": {"held_out": list(case.names), **numbers,
                "explainable_removed": removed_share(numbers)},
    }  # fmt: skip
    if unpatched:
        document["unpatched"] = unpatched  # a replay then makes up for it
        remarks = (UNPATCHED.format(unpatched), *remarks)
    return Diagnosis(
        os.path.abspath(case.workshop.path), doc.plain(document), changes, text, diff,
        _traces(case, proof.pieces, stated, found),
        located, _signals(case, proof.squares, proof.count), _candidates(naming),
        remarks, time.monotonic() - begun,
        int(case.world.counted[0] + case.held.counted[0]),
        more_than_noise=structure.left,
    )  # fmt: skip


def _located(case: Case, naming: Naming):
    """The map of the re-fitted model's error, and where each finding acts."""
    world, problem = case.world, naming.problem
    pieces = problem.windows
    stated, final = naming.stated.fit, naming.final.fit
    before = _squares(problem, stated.terms, stated.values)
    share, p = locate.grid(world, case.scene, pieces, before)
    located = Located(tuple(c.name for c in world.signals), locate.REGIMES, share, p)
    where: dict[int, dict[str, Any]] = {}
    after = _squares(problem, final.terms, final.values)
    masks = locate.regimes(world, case.scene, pieces)
    for n, named in enumerate(naming.named):
        if named.term.effect.rounds:
            own = {"name": named.term.places[0]["signal"], "share_of_error": 1.0,
                   "p_value": named.evidence.p_value}  # fmt: skip
            where[n] = {"signals": [own], "regime": "always", "windows": []}
            continue
        less = _squares(problem, *final.but(named.term))
        where[n] = _where(case, pieces, masks, less - after)
        if onset := named.term.onset:
            where[n]["onset"] = {
                k: getattr(onset, k) for k in ("episode", "time", "low", "high")
            }
    return located, where


def _squares(problem: Problem, terms: Sequence[Term], values: Floats) -> Floats:
    """Squared residuals (M, S) in standard deviations, summed over columns."""
    r = problem.raw.at(terms, values)
    r = r.reshape(problem.windows.readings.shape)
    return np.stack(
        [(r[:, c.columns] ** 2).sum(axis=1) for c in problem.world.signals], axis=1
    )


def _where(case: Case, pieces: Windows, masks, gain: Floats) -> dict[str, Any]:
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
    """p-value that an effect lowers a signal's error, over windows, few or many."""
    from scipy.stats import wilcoxon

    each = np.bincount(pieces.window, gain, minlength=len(pieces))
    each = each[each != 0]
    return float(wilcoxon(each, alternative="greater").pvalue) if len(each) else 1.0


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


def patch_or_given(case: Case, found: Fit) -> tuple[str, str, list[Edit], str]:
    """What `patch_of` gives; or the given text, and why there is no patch."""
    try:
        return *patch_of(case, found), ""
    except ModelError as error:
        path = Path(case.workshop.path)
        return patched(path, (), path.resolve().parent), "", [], str(error)


def patch_of(case: Case, found: Fit) -> tuple[str, str, list[Edit]]:
    """Text of patched.xml beside the given model, its difference, and the edits.

    Raises:
        ModelError: what was found has no place in the text, or MuJoCo refuses it.
    """
    path = Path(case.workshop.path)
    home = path.resolve().parent
    plant = case.workshop.plant(found.terms)
    changes = edits(Source(path), plant, found.terms, found.values)
    compiled(path, changes)
    text = patched(path, changes, home)
    return text, difference(patched(path, (), home), text), changes


def _traces(case: Case, pieces: Windows, stated: Fit, found: Fit) -> tuple[Trace, ...]:
    """The worst stretches of the held-out episodes, by the re-fitted model.

    Of poses that were read once, all of them in a row.
    """
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
    if pieces.is_single:
        pose = np.arange(1, len(pieces.window) + 1, dtype=float)
        return tuple(
            Trace("", _column(c, k), c.unit, pose, pieces.readings[:, k],
                  *(e[:, k] for e in each))
            for _, c, k, _ in worst[:4]
        )  # fmt: skip
    return tuple(_trace(world, pieces, each, c, k, w) for _, c, k, w in worst[:4])


def _column(c: Channel, k: int) -> str:
    """Name of one of all columns."""
    return c.name if c.width == 1 else f"{c.name}[{k - c.first}]"


def _trace(world: World, pieces: Windows, each, c, k: int, w: int) -> Trace:
    rows = np.flatnonzero(pieces.window == w)
    log = world.logs[int(pieces.log[w])]
    at = log.start + (pieces.start[w] + pieces.at[rows]) * world.step
    return Trace(log.id, _column(c, k), c.unit, at, pieces.readings[rows, k],
                 *(e[rows, k] for e in each))  # fmt: skip


def _signals(case: Case, squares, count) -> tuple[SignalFit, ...]:
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
    case: Case,
    naming: Naming,
    structure: Structure,
    refuted: Sequence[str],
    refit: Sequence[Mapping[str, Any]],
) -> tuple[str, ...]:
    """What a reader should know before believing the rest."""
    found = [
        f"Joint {j.name} moved by less than {STILL} {j.unit}: what is wrong with it, "
        "if anything is, these recordings cannot show."
        for j in case.scene.joints
        if j.measured and j.range < STILL
    ]
    pieces = naming.problem.windows
    count, episode, time = divergence(case.world, pieces)
    if count:
        found.append(
            f"The model as given diverges in {count} of {len(pieces)} pieces, first in "
            f"episode {episode} at {time:.4g} s."
        )
    if refuted:
        found.append(
            f"What also fitted, {'; '.join(refuted)}, did not help in the "
            "held-out episodes, so it is not named."
        )
    if structure.left and structure.share > 0.05:
        found.append(
            f"A torque of free form would explain {100 * structure.share:.0f} % of "
            "what is left."
        )
    loose = [e["parameter"] for e in refit if is_loose(e)]
    if loose:
        more = f" and {len(loose) - FEW} more" if len(loose) > FEW else ""
        found.append(f"Not pinned down by these data: {', '.join(loose[:FEW])}{more}.")
    return tuple(found)
