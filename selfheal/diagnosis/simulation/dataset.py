"""A robot's recordings made ready for a diagnosis: parted, checked, cut to pieces."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import RecordingError, UnknownNameError
from ...recording import (
    Recording,
    check_against_model,
    names_of,
    short_names,
    split,
    without_file,
)
from ..data.episodes import collect_signal_meanings
from ..data.robot_summary import RobotSummary
from ..data.segments import Segments, cut_segments
from ..data.state_estimate import estimate_state
from .build import StateReconstruction, build_simulator, summarize_robot
from .checkpoint import Checkpoint
from .model_variants import ModelCompiler
from .simulator import Simulator

WINDOW = 0.5  # [s] of a simulated piece; chosen: as long as the contract's
LONG = 2.0  # [s] of a longer one; chosen: slow effects show there
QUIET, SHORT = 3.0, 3  # least signal over noise, least windows, to say anything; chosen


@dataclass(frozen=True, eq=False)
class Dataset:
    """A robot's recordings, parted.

    Attributes:
        workshop: of the given model.
        world: what may be fitted.
        held: what is judged on.
        scene: of the robot.
        names: of the held-out pieces, as the contract writes them.
    """

    compiler: ModelCompiler
    training: Simulator
    held_out: Simulator
    robot: RobotSummary
    held_out_names: tuple[str, ...]

    def with_noise_of(self, simulator: Simulator) -> "Dataset":
        """The same, with what another world of it knows of its readings' noise."""
        predicted = {c.name: c for c in simulator.channels}
        own = [
            tuple(replace(c, noise=predicted[c.name].noise, ar1=predicted[c.name].ar1)
                  if c.name in predicted else c for c in w.channels)
            for w in (self.training, self.held_out)
        ]  # fmt: skip
        return replace(
            self,
            training=self.training.with_channels(own[0]),
            held_out=self.held_out.with_channels(own[1]),
        )


def prepare_dataset(
    model: str | os.PathLike[str],
    recordings: Sequence[Recording],
    held_out: Sequence[str],
    memory: str | os.PathLike[str] | None = None,
) -> Dataset:
    """A model and its recordings, parted; arguments and errors as of `diagnose`."""
    compiler = ModelCompiler(os.fspath(model))
    for recording in recordings:  # what does not fit the model is the plainer fault
        check_against_model(recording, names_of(compiler.nominal))
    collect_signal_meanings(
        recordings
    )  # one in all, whichever part of them they come to lie in
    pairs = _split_recordings(recordings, held_out)
    fitted = [fit for fit, _ in pairs if fit.episodes]
    simulator = build_simulator(compiler, fitted, recordings)
    simulator = replace(simulator, checkpoint=Checkpoint(memory))
    held = build_simulator(compiler, [h for _, h in pairs if h.episodes], recordings)
    if not simulator.channels:
        raise RecordingError("no signal holds a reading that the model can predict")
    files = short_names([r.file for r in recordings])
    names = tuple(
        f"{file}:{name}"
        for file, (_, h) in zip(files, pairs, strict=True)
        for name in h.episodes
    )
    robot = summarize_robot(simulator)
    simulator, held = (
        replace(w, has_contact=robot.has_contact) for w in (simulator, held)
    )
    return Dataset(compiler, simulator, held, robot, names)


def _split_recordings(
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
        own[_find_recording(recordings, entry)].append(entry)
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


def _find_recording(recordings: Sequence[Recording], entry: str) -> int:
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


def cut_readable_segments(simulator: Simulator, seconds: float) -> Segments:
    """Pieces that begin where the state can be read; whole episodes elsewhere."""
    steps = max(2, round(seconds / simulator.timestep))
    parts = []
    for i, episode in enumerate(simulator.episodes):
        cut = (
            _is_state_known(
                simulator, i, np.linspace(0, episode.sample_steps[-1], 9)[1:-1]
            ).mean()
            > 0.5
        )
        own = cut_segments(simulator.episodes, steps if cut else None, only=i)
        if cut:
            own = own.select(
                np.flatnonzero(_is_state_known(simulator, i, own.first_step))
            )
        parts.append(own)
    return Segments.concatenate(parts)


def _list_unmeasured_joints(simulator: Simulator) -> list[str]:
    """Joints whose position no signal tells for most of the time."""
    model, known = (
        simulator.compiler.nominal,
        StateReconstruction(simulator).is_measured,
    )
    return [
        f"joint {model.joint(j).name!r}"
        for j in range(model.njnt)
        if not known[model.jnt_qposadr[j]]
    ]


def _is_state_known(simulator: Simulator, episode: int, at: np.ndarray) -> np.ndarray:
    """(W) whether every joint's position is told at times [steps] of an episode."""
    own, model = simulator.episodes[episode], simulator.compiler.nominal
    qpos, _, _ = estimate_state(
        model, simulator.channels, own, at, simulator.timestep, {}
    )
    given = (at == 0) & (own.qpos0 is not None)
    return np.isfinite(qpos).all(axis=1) | given
