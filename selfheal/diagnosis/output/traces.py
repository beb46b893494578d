"""The worst stretches: takes replays of held-out episodes, gives curves and poses."""

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from ...engine.poses import pose_bodies
from ...recording.data import Floats
from ..data.robot_summary import Channel
from ..data.segments import Segments
from ..effects.base import Term
from ..selection.replay_scores import HeldOutScores
from ..simulation.build import StateReconstruction
from ..simulation.dataset import Dataset
from ..simulation.sensors import NO_NOISE
from ..simulation.simulator import Simulator
from .result import PoseTrace, Trace

MAX_TRACES = 4  # stretches that a page may draw; chosen
# of a film; chosen: smooth, and soon rendered without a graphics card
FRAMES = 48
# [s] that they show; chosen: longer, fast motion would fall between two of them
LONGEST = 5.0
_POSE = 7  # origin and quaternion

Model = tuple[Sequence[Term], Floats]


def make_traces(
    dataset: Dataset, proof: HeldOutScores
) -> tuple[tuple[Trace, ...], PoseTrace | None]:
    """The worst stretches of the held-out episodes, by the re-fitted model.

    Of poses that were read once each, all of them in a row. In the worst stretch also
    the poses of all bodies.
    """
    simulator, segments = dataset.held_out.native, proof.segments
    fits = proof.refits["refit"], proof.refits["patched"]
    models = [((), np.zeros(0)), *((fit.terms, fit.values) for fit in fits)]
    predicted = [
        simulator.simulate(terms, values[None], segments)[0] for terms, values in models
    ]
    worst = []
    for c in simulator.channels:
        for k in range(c.first_column, c.first_column + c.width):
            apart = (predicted[1][:, k] - segments.readings[:, k]) / c.spread
            square = np.nan_to_num(apart**2, nan=0.0, posinf=0.0)
            by_segment = np.bincount(
                segments.segment_of_sample, square, minlength=len(segments)
            )
            w = int(by_segment.argmax())
            weight = 2 if c.is_scored else 1
            worst.append((by_segment[w] * weight, c, k, w, square))
    worst.sort(key=lambda x: -x[0])
    traces = []
    for _, c, k, w, _ in worst[:MAX_TRACES]:
        name = c.name if c.width == 1 else f"{c.name}[{k - c.first_column}]"
        episode, time, rows = _find_samples(simulator, segments, w)
        curves = (each[rows, k] for each in (segments.readings, *predicted))
        traces.append(Trace(episode, name, c.unit, time, *curves))
    if segments.is_single_readings:
        return tuple(traces), None
    *_, w, square = worst[0]
    chosen = models[0], models[2]
    return tuple(traces), make_pose_trace(simulator, segments, w, square, chosen)


def _find_samples(
    simulator: Simulator, segments: Segments, w: int
) -> tuple[str, Floats, np.ndarray]:
    """Episode, time (T) [s] and rows (T) of the samples of a segment.

    Where each episode was read once, of all, and numbers in the place of times.
    """
    if segments.is_single_readings:
        rows = np.arange(len(segments.segment_of_sample))
        return "", np.arange(1, len(rows) + 1, dtype=float), rows
    rows = np.flatnonzero(segments.segment_of_sample == w)
    episode = simulator.episodes[int(segments.episode[w])]
    steps = segments.first_step[w] + segments.sample_steps[rows]
    return episode.id, episode.start + steps * simulator.timestep, rows


def make_pose_trace(
    simulator: Simulator,
    segments: Segments,
    chosen: int,
    squares: Floats,
    models: tuple[Model, Model],
) -> PoseTrace:
    """Poses of all bodies in a segment, where it is long in its worst part.

    Args:
        segments: W of them, with M samples.
        squares: (M) squared errors, by which the worst part is found.
        models: terms and values (P) of the model as given, and of the patched one.
    """
    rows = segments.find_sample_rows(np.array([chosen]))
    one = segments.select(np.array([chosen]))
    at = _spread_frames(one.sample_steps, squares[rows], simulator.timestep)
    posed, poses = _add_pose_channels(simulator)
    readings = np.full((FRAMES, one.readings.shape[1] + poses), np.nan)
    of_one = np.zeros(FRAMES, int)
    frames = replace(one, segment_of_sample=of_one, sample_steps=at, readings=readings)
    given, patched = (
        posed.simulate(terms, values[None], frames)[0][:, -poses:]
        for terms, values in models
    )
    episode = simulator.episodes[int(one.episode[0])]
    steps = np.minimum(one.first_step[0] + at, episode.sample_steps[-1])
    measured, unread = _measure_poses(simulator, int(one.episode[0]), steps)
    time, predicted = episode.start + steps * simulator.timestep, (given, patched)
    return PoseTrace(episode.id, time, unread, measured, *map(_split_poses, predicted))


def _spread_frames(steps: Floats, squares: Floats, timestep: float) -> Floats:
    """Times (FRAMES) [steps] of a segment's samples (m), where the errors are largest.

    Args:
        steps: (m) of the samples since the segment began [steps].
        squares: (m) squared errors.
        timestep: of the simulation [s].
    """
    length = LONGEST / timestep
    total = np.concatenate([[0.0], np.cumsum(squares)])
    ends = np.searchsorted(steps, steps + length, side="right")
    first = steps[np.argmax(total[ends] - total[:-1])]
    first = max(steps[0], min(first, steps[-1] - length))
    return np.linspace(first, min(first + length, steps[-1]), FRAMES)


def _add_pose_channels(simulator: Simulator) -> tuple[Simulator, int]:
    """A simulator that gives the poses of all bodies, too, and their columns' number.

    Nothing reads them: in the episodes they are missing.
    """
    nbody = simulator.compiler.nominal.nbody
    first = simulator.episodes[0].readings.shape[1]
    width = _POSE * (nbody - 1)
    channels: list[Channel] = []
    for i in range(1, nbody):
        at = first + _POSE * (i - 1)
        body = cast(str, i)  # MuJoCo takes a number, too; a body may have no name
        for kind, column, size in (
            ("body_position", at, 3),
            ("body_orientation", at + 3, 4),
        ):
            own = (f"{kind} {i}", kind, body, "", size, column, 1.0, 1.0, 0.0)
            channels.append(Channel(*own, *np.repeat(NO_NOISE, size, axis=1)))
    room = (0, 0), (0, width)
    episodes = tuple(
        replace(e, readings=np.pad(e.readings, room, constant_values=np.nan))
        for e in simulator.episodes
    )
    posed = simulator.with_channels((*simulator.channels, *channels))
    return replace(posed, episodes=episodes), width


def _split_poses(columns: Floats) -> Floats:
    """Poses (F, B, 7) of predicted columns (F, 7 B), with unit quaternions."""
    poses = columns.reshape(len(columns), -1, _POSE).copy()
    poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True)
    return poses


def _measure_poses(
    simulator: Simulator, episode: int, steps: Floats
) -> tuple[Floats, tuple[str, ...]]:
    """Poses (F, B, 7) as read, and the names of joints that no reading tells.

    These are where the model as given, simulated, has them.

    Args:
        steps: (F) of its grid.
    """
    model = simulator.compiler.nominal
    states = StateReconstruction(simulator)
    qpos, _ = states(episode, np.round(steps).astype(int))
    unread = tuple(
        model.joint(j).name or f"number {j}"
        for j in range(model.njnt)
        if not states.is_known[model.jnt_qposadr[j]]
    )
    return pose_bodies(model, qpos), unread
