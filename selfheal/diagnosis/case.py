"""A robot's recordings made ready for a diagnosis: parted, checked, cut to pieces."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import RecordingError, UnknownNameError
from ..recording import (
    Recording,
    check_against_model,
    names_of,
    short_names,
    split,
    without_file,
)
from .logs import meanings
from .memory import Memory, about
from .plant import Workshop
from .prepare import Reckoned, scene_of, world_of
from .problem import Problem
from .scene import Scene, by_column
from .state import estimate
from .windows import Windows, windows
from .world import World

WINDOW = 0.5  # [s] of a simulated piece; chosen: as long as the contract's
LONG = 2.0  # [s] of a longer one; chosen: slow effects show there
QUIET, SHORT = 3.0, 3  # least signal over noise, least windows, to say anything; chosen


@dataclass(frozen=True, eq=False)
class Case:
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

    def heard(self, world: World) -> "Case":
        """The same, with what another world of it knows of its readings' noise."""
        told = {c.name: c for c in world.signals}
        own = [
            tuple(replace(c, noise=told[c.name].noise, memory=told[c.name].memory)
                  if c.name in told else c for c in w.signals)
            for w in (self.world, self.held)
        ]  # fmt: skip
        return replace(
            self, world=self.world.hearing(own[0]), held=self.held.hearing(own[1])
        )


def prepare(
    model: str | os.PathLike[str],
    recordings: Sequence[Recording],
    held_out: Sequence[str],
    memory: str | os.PathLike[str] | None = None,
) -> Case:
    """A model and its recordings, parted; arguments and errors as of `diagnose`."""
    workshop = Workshop(os.fspath(model))
    for recording in recordings:  # what does not fit the model is the plainer fault
        check_against_model(recording, names_of(workshop.given))
    meanings(recordings)  # one in all, whichever part of them they come to lie in
    pairs = _parted(recordings, held_out)
    fitted = [fit for fit, _ in pairs if fit.episodes]
    world = world_of(workshop, fitted, recordings)
    world = replace(world, memory=Memory(memory, about(workshop, fitted)))
    held = world_of(workshop, [h for _, h in pairs if h.episodes], recordings)
    if not world.signals:
        raise RecordingError("no signal holds a reading that the model can predict")
    files = short_names([r.file for r in recordings])
    names = tuple(
        f"{file}:{name}"
        for file, (_, h) in zip(files, pairs, strict=True)
        for name in h.episodes
    )
    scene = scene_of(world)
    world, held = (replace(w, touches=scene.touches) for w in (world, held))
    return Case(workshop, world, held, scene, names)


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
        whole = {without_file(entry, recording.file) for entry in entries}
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
    exact = [entry.startswith(f"{r.file}:") for r in recordings]
    called = [without_file(entry, r.file) != entry for r in recordings]
    if any(fits := exact if any(exact) else called):
        return fits.index(True)
    for i, recording in enumerate(recordings):
        if any(entry == n or entry.startswith(f"{n}[") for n in recording.episodes):
            return i
    files = short_names([r.file for r in recordings])
    each = zip(files, recordings, strict=True)
    valid = [f"{file}:{name}" for file, r in each for name in r.episodes]
    raise UnknownNameError("held-out episode", entry, valid)


def problem_of(case: Case, seconds: float) -> Problem:
    """Windows of the fitted recordings, weighted by the given model's error."""
    world = case.world
    pieces = pieces_of(world, seconds)
    apart = world.simulate([], np.zeros((1, 0)), pieces)[0] - pieces.readings
    sigma = np.sqrt(
        np.nanmean(np.where(np.isfinite(apart), apart, np.nan) ** 2, axis=0)
    )
    spread = by_column(world.signals, "spread")
    sigma = np.clip(np.where(np.isfinite(sigma), sigma, spread), 1e-9 * spread, spread)
    return Problem(world, pieces, sigma)


def check_enough(world: World, problem: Problem) -> None:
    """Refuse what could only be answered with "nothing", for want of evidence.

    Raises:
        RecordingError: too short, or nothing moved.
    """
    if len(problem.windows) < SHORT and (lost := _untold(world)):
        raise RecordingError(
            f"no signal tells the position of {', '.join(lost)}, so that an episode is "
            f"one piece, and {len(world.logs)} are too few to decide anything; would "
            f"fit: record it, or at least {SHORT} episodes beside what is held out"
        )
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


def pieces_of(world: World, seconds: float) -> Windows:
    """Pieces that begin where the state can be read; whole episodes elsewhere."""
    steps = max(2, round(seconds / world.step))
    parts = []
    for i, log in enumerate(world.logs):
        cut = _is_read(world, i, np.linspace(0, log.at[-1], 9)[1:-1]).mean() > 0.5
        own = windows(world.logs, steps if cut else None, only=i)
        if cut:
            own = own.take(np.flatnonzero(_is_read(world, i, own.start)))
        parts.append(own)
    return Windows.joined(parts)


def _untold(world: World) -> list[str]:
    """Joints whose position no signal tells for most of the time."""
    model, known = world.workshop.given, Reckoned(world).is_read
    return [
        f"joint {model.joint(j).name!r}"
        for j in range(model.njnt)
        if not known[model.jnt_qposadr[j]]
    ]


def _is_read(world: World, log: int, at: np.ndarray) -> np.ndarray:
    """(W) whether every joint's position is told at times [steps] of an episode."""
    own, model = world.logs[log], world.workshop.given
    qpos, _, _ = estimate(model, world.signals, own, at, world.step, {})
    given = (at == 0) & (own.qpos0 is not None)
    return np.isfinite(qpos).all(axis=1) | given
