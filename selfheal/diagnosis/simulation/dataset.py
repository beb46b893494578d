"""Datasets: takes a model and recordings, gives what to fit and what is held out."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...errors import RecordingError, UnknownNameError
from ...recording import (
    Recording,
    check_against_model,
    list_model_names,
    shorten_names,
    split,
    strip_file,
)
from ..data.episodes import collect_signal_meanings
from ..data.robot_summary import Channel, RobotSummary
from ..data.segments import Segments, cut_segments
from .build import (
    MEASURED_SHARE,
    StateReconstruction,
    build_simulator,
    spread_moments,
    summarize_robot,
)
from .checkpoint import Checkpoint
from .model_variants import ModelCompiler
from .simulator import Simulator

if TYPE_CHECKING:
    from mujoco import MjModel

SHORT_SEGMENT = 0.5  # [s] of a segment; chosen: as long as the contract scores
# [s] of longer segments, in which slow effects show; chosen: each is four times as long
LONG_SEGMENTS = (2.0, 8.0)
# [s] of those that are fitted; chosen: in the longest friction sums up to what decides
FITTED_SEGMENTS = (*LONG_SEGMENTS, 32.0)
COARSENINGS = (4, 3, 2)  # steps of the model in one of a fit's simulation; chosen
# standard deviations of a reading's noise by which larger steps may change it; chosen:
# a hundredth of its variance
MAX_COARSENING_ERROR = 0.1
COARSENING_SEGMENTS = 8  # in which that is measured; chosen: 16 s
STEP_TOLERANCE = 1e-3  # [steps] between samples; chosen: rounding of times
# below these a diagnosis is refused; chosen: what is left may be noise
MIN_SNR = 3.0  # standard deviation of a signal over that of its noise
MIN_SEGMENTS = 3  # of the short ones


@dataclass(frozen=True, eq=False)
class Dataset:
    """A robot's recordings, divided into training and held-out data.

    Attributes:
        compiler: of the given model and its variants.
        training: simulator of the recordings that may be fitted.
        held_out: simulator of the recordings that fits are judged on.
        robot: summary of the robot.
        held_out_names: of the held-out episodes or parts of them, as the contract
            writes them.
    """

    compiler: ModelCompiler
    training: Simulator
    held_out: Simulator
    robot: RobotSummary
    held_out_names: tuple[str, ...]

    def with_noise_of(self, simulator: Simulator) -> "Dataset":
        """This dataset with the noise of a simulator's channels, by their names."""
        known = {c.name: c for c in simulator.channels}

        def with_noise(channels: Sequence[Channel]) -> tuple[Channel, ...]:
            return tuple(
                replace(c, noise=known[c.name].noise, ar1=known[c.name].ar1)
                for c in channels
            )

        return replace(
            self,
            training=self.training.with_channels(with_noise(self.training.channels)),
            held_out=self.held_out.with_channels(with_noise(self.held_out.channels)),
        )


def prepare_dataset(
    model: str | os.PathLike[str],
    recordings: Sequence[Recording],
    held_out: Sequence[str],
    memory: str | os.PathLike[str] | None = None,
) -> Dataset:
    """Divide recordings into training and held-out data.

    Args:
        model: path of an MJCF or a URDF.
        held_out: names of episodes or parts of them, as `recording.split` takes them.
        memory: folder of the checkpoint; None: nothing is kept.

    Raises:
        ModelError: MuJoCo cannot load the model.
        RecordingError: a recording does not fit the model, or nothing in it can be
            fitted.
        UnknownNameError: a held-out name is no episode.
    """
    compiler = ModelCompiler(os.fspath(model))
    for recording in recordings:  # what does not fit the model is the plainer fault
        check_against_model(recording, list_model_names(compiler.nominal))
    collect_signal_meanings(recordings)  # each has one, in training and held-out data
    pairs = _split_recordings(recordings, held_out)
    fitted = [fit for fit, _ in pairs if fit.episodes]
    simulator = build_simulator(compiler, fitted, recordings)
    simulator = replace(simulator, checkpoint=Checkpoint(memory))
    held_out_simulator = build_simulator(
        compiler, [h for _, h in pairs if h.episodes], recordings, simulator.channels
    )
    if not simulator.channels:
        raise RecordingError("no signal holds a reading that the model can predict")
    files = shorten_names([r.file for r in recordings])
    names = tuple(
        f"{file}:{name}"
        for file, (_, h) in zip(files, pairs, strict=True)
        for name in h.episodes
    )
    robot = summarize_robot(simulator)
    simulator, held_out_simulator = (
        replace(s, has_contact=robot.has_contact)
        for s in (simulator, held_out_simulator)
    )
    coarsening = choose_coarsening(simulator)
    if coarsening > 1:
        simulator, held_out_simulator = (
            s.coarsen(coarsening) for s in (simulator, held_out_simulator)
        )
        robot = replace(robot, timestep=simulator.timestep)
    return Dataset(compiler, simulator, held_out_simulator, robot, names)


def _split_recordings(
    recordings: Sequence[Recording], held_out: Sequence[str]
) -> list[tuple[Recording, Recording]]:
    """Divide each recording into what may be fitted and what is held out.

    Args:
        held_out: names of episodes or parts of them; none: each recording's last part.

    Raises:
        UnknownNameError: a name that is no episode.
        RecordingError: nothing is left to fit.
    """
    if not held_out or len(recordings) == 1:
        return [split(r, held_out=held_out) for r in recordings]
    by_recording: list[list[str]] = [[] for _ in recordings]
    for entry in held_out:
        by_recording[_find_recording(recordings, entry)].append(entry)
    pairs = []
    for recording, entries in zip(recordings, by_recording, strict=True):
        whole = {strip_file(entry, recording.file) for entry in entries}
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
    """Number of the recording that a held-out name means; `UnknownNameError`: none."""
    has_path = [entry.startswith(f"{r.file}:") for r in recordings]
    has_name = [strip_file(entry, r.file) != entry for r in recordings]
    if any(matches := has_path if any(has_path) else has_name):
        return matches.index(True)
    for i, recording in enumerate(recordings):
        if any(entry == n or entry.startswith(f"{n}[") for n in recording.episodes):
            return i
    files = shorten_names([r.file for r in recordings])
    each = zip(files, recordings, strict=True)
    valid = [f"{file}:{name}" for file, r in each for name in r.episodes]
    raise UnknownNameError("held-out episode", entry, valid)


def choose_coarsening(simulator: Simulator) -> int:
    """How many steps of the given model one of a fit's simulations may have.

    As many as change no signal by more than a share of its noise, in segments of 2 s.
    Where something touches, the motion is that of the model's own step alone.
    """
    gaps = np.concatenate([np.diff(e.sample_steps) for e in simulator.episodes])
    noise = np.concatenate([c.noise for c in simulator.channels])
    if simulator.has_contact or not len(gaps):
        return 1
    for count in COARSENINGS:
        if count > np.median(gaps) + STEP_TOLERANCE:
            continue
        coarse = simulator.coarsen(count)
        segments = cut_readable_segments(coarse, LONG_SEGMENTS[0])
        if not len(segments) or segments.is_single_readings:
            continue
        some = np.linspace(0, len(segments) - 1, COARSENING_SEGMENTS).astype(int)
        segments = segments.select(np.unique(some))
        pairs = (coarse, segments), (simulator, segments.with_finer_steps(count))
        predicted = [s.leapfrog.simulate((), np.zeros((1, 0)), w)[0] for s, w in pairs]
        change = (predicted[0] - predicted[1]) ** 2
        change[~np.isfinite(segments.readings)] = 0.0
        if (np.sqrt(change.mean(axis=0)) <= MAX_COARSENING_ERROR * noise).all():
            return count
    return 1


def cut_readable_segments(simulator: Simulator, seconds: float) -> Segments:
    """Cut episodes into segments that begin where the state is measured.

    An episode in which the state is mostly not measured, or is not where a segment
    would begin, stays whole.

    Args:
        seconds: of a segment [s].
    """
    steps = max(2, round(seconds / simulator.timestep))
    parts = []
    for i, episode in enumerate(simulator.episodes):
        moments = spread_moments(episode.sample_steps[-1])
        cut = _is_state_known(simulator, i, moments).mean() > MEASURED_SHARE
        part = cut_segments(simulator.episodes, steps if cut else None, only=i)
        if cut:
            is_known = _is_state_known(simulator, i, part.first_step)
            part = (
                part.select(np.flatnonzero(is_known))
                if is_known.any()
                else cut_segments(simulator.episodes, None, only=i)
            )
        parts.append(part)
    return Segments.concatenate(parts)


def list_unmeasured_joints(simulator: Simulator) -> list[str]:
    """List the joints whose position no signal measures for most of the time."""
    model = simulator.compiler.nominal
    is_measured = StateReconstruction(simulator).is_measured
    return [
        _describe_joint(model, j)
        for j in range(model.njnt)
        if not is_measured[model.jnt_qposadr[j]]
    ]


def _describe_joint(model: "MjModel", joint: int) -> str:
    """A joint as a message names it; a floating base by its body."""
    if model.jnt_type[joint] == 0:  # mjtJoint: free
        return f"the free base {model.body(model.jnt_bodyid[joint]).name!r}"
    return f"joint {model.joint(joint).name!r}"


def _is_state_known(simulator: Simulator, episode: int, at: np.ndarray) -> np.ndarray:
    """(W) whether each joint's position is known at times `at` (W) [steps]."""
    return np.array(simulator.complete_state(episode, at).is_known.all(axis=1))
