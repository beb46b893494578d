"""Checks: takes a dataset, refuses what cannot be diagnosed, says what would fit."""

from collections.abc import Sequence

import numpy as np

from ...errors import ModelError, RecordingError
from ...printable import join_names
from ...recording.data import Floats
from ..data.episodes import MIN_SPREAD
from ..data.robot_summary import POSITION_LIKE
from ..data.segments import Segments
from ..effects.base import Term
from .dataset import (
    MIN_SEGMENTS,
    SHORT_SEGMENT,
    Dataset,
    cut_readable_segments,
)
from .simulator import Simulator

# share of the segments in which the given model may diverge, at most; chosen: most
# readings must be comparable
MAX_DIVERGED_SHARE = 0.5
NO_VALUES = np.zeros(0)  # of no terms


def check_dataset(dataset: Dataset) -> None:
    """Refuse a dataset of which no fit could make sense, before any fit.

    Raises:
        RecordingError: the recordings are too short, have no reading to be judged on,
            or show no motion.
        ModelError: a joint has no name, or the model diverges in most segments; the
            message says where and when.
    """
    _check_joint_names(dataset)
    segments = cut_readable_segments(dataset.training, SHORT_SEGMENT)
    _check_length(dataset, segments)
    _check_motion(dataset)
    count, episode, time = find_divergence(dataset.training, segments)
    if count > MAX_DIVERGED_SHARE * len(segments):
        raise ModelError(
            f"{dataset.compiler.path}: the model diverges, first in episode "
            f"{episode!r} at {time:.4g} s, in {count} of {len(segments)} pieces; would "
            "fit: a smaller timestep, another integrator, or commands and initial "
            "states that it can stand"
        )


def _check_joint_names(dataset: Dataset) -> None:
    """Refuse joints without a name: no finding or replay could name them."""
    model = dataset.compiler.nominal
    slide, hinge = 2, 3  # mjtJoint
    bodies = [
        int(model.jnt_bodyid[j])
        for j in range(model.njnt)
        if model.jnt_type[j] in (slide, hinge) and not model.joint(j).name
    ]
    if bodies:
        where = join_names(
            f"a joint of body {model.body(b).name or b!r}" for b in bodies
        )
        raise ModelError(
            f"{dataset.compiler.path}: no name has {where}; would fit: a name for "
            "every hinge and slide"
        )


def _check_length(dataset: Dataset, segments: Segments) -> None:
    """Refuse fewer seconds of readings than the fewest segments have."""
    seconds = float(segments.lengths.sum()) * dataset.training.timestep
    least = MIN_SEGMENTS * SHORT_SEGMENT
    if seconds < least:
        raise RecordingError(
            f"{seconds:.3g} s of readings are too few to decide anything; would fit: "
            f"at least {least} s, better 20 s, beside what is held out"
        )


def _check_motion(dataset: Dataset) -> None:
    """Refuse recordings without motion, and without a reading to be judged on."""
    scored = [c for c in dataset.training.channels if c.is_scored]
    if not scored:
        raise RecordingError(
            f"no signal of kind {', '.join(POSITION_LIKE)} has a reading; would fit: "
            "at least one of them"
        )
    if not any(c.spread > MIN_SPREAD for c in scored):
        raise RecordingError(
            f"no position-like signal moves ({join_names(c.name for c in scored)}); "
            "would fit: a recording in which the robot moves"
        )
    columns = [c.columns for c in dataset.held_out.channels if c.is_scored]
    is_read = (
        np.isfinite(episode.readings[:, k])
        for episode in dataset.held_out.episodes
        for k in columns
    )
    if not any(known.any() for known in is_read):
        raise RecordingError(
            f"what is held out ({join_names(dataset.held_out_names)}) has no reading "
            "of a position-like signal to be judged on; would fit: other episodes"
        )


def find_divergence(
    simulator: Simulator,
    segments: Segments,
    terms: Sequence[Term] = (),
    values: Floats = NO_VALUES,
) -> tuple[int, str, float]:
    """Find in how many segments a simulation diverges, and the first time it does.

    The time is found by bisection of the first diverging segment.

    Args:
        values: (P) of the parameters of the terms, which the given model lacks.

    Returns:
        Count, id of the episode, time in the episode [s] to within two steps; 0, "",
        NaN where no simulation diverges.
    """
    diverged = _find_diverged(simulator, segments, terms, values)
    if not len(diverged):
        return 0, "", np.nan
    w = int(diverged[0])
    episode = simulator.episodes[int(segments.episode[w])]
    low, high = 0, int(segments.lengths[w])  # steps: still finite, diverged
    while high - low > 1:
        middle = (low + high) // 2
        cut = Segments(
            segments.episode[[w]],
            segments.first_step[[w]],
            np.array([middle]),
            np.array([0]),
            np.array([float(middle)]),
            np.zeros((1, episode.readings.shape[1])),
        )
        if len(_find_diverged(simulator, cut, terms, values)):
            high = middle
        else:
            low = middle
    return (
        len(diverged),
        episode.id,
        episode.start + (int(segments.first_step[w]) + high) * simulator.timestep,
    )


def _find_diverged(
    simulator: Simulator, segments: Segments, terms: Sequence[Term], values: Floats
) -> np.ndarray:
    """Numbers of the segments in which terms with values (P) diverge."""
    predicted = simulator.simulate(terms, values[None], segments)[0]
    return np.unique(segments.segment_of_sample[~np.isfinite(predicted).all(axis=1)])
