"""What cannot be diagnosed: takes a case, refuses it and says what would fit."""

from collections.abc import Sequence

import numpy as np

from ...errors import ModelError, RecordingError
from ...recording.data import Floats
from ..data.robot_summary import POSITION_LIKE
from ..data.segments import Segments
from ..effects.base import Term
from .dataset import SHORT, WINDOW, Dataset, cut_readable_segments
from .simulator import Simulator

LOST = 0.5  # share of pieces that the given model may not survive; chosen
AS_GIVEN = np.zeros(0)  # values of no terms


def check_dataset(dataset: Dataset) -> None:
    """Refuse what no fit could make sense of, before any fit.

    Raises:
        RecordingError: too short, without a reading to be judged on, or nothing moves.
        ModelError: what moves has no name, or the model diverges nearly everywhere;
            the message says where and when.
    """
    _check_joint_names(dataset)
    segments = cut_readable_segments(dataset.training, WINDOW)
    _check_length(dataset, segments)
    _check_motion(dataset)
    count, episode, time = find_divergence(dataset.training, segments)
    if count > LOST * len(segments):
        raise ModelError(
            f"{dataset.compiler.path}: the model diverges, first in episode "
            f"{episode!r} at {time:.4g} s, in {count} of {len(segments)} pieces; would "
            "fit: a smaller timestep, another integrator, or commands and initial "
            "states that it can stand"
        )


def _check_joint_names(dataset: Dataset) -> None:
    """Refuse joints of which neither a finding nor a replay could speak."""
    model = dataset.compiler.nominal
    slide, hinge = 2, 3  # mjtJoint
    unnamed = [
        int(model.jnt_bodyid[j])
        for j in range(model.njnt)
        if model.jnt_type[j] in (slide, hinge) and not model.joint(j).name
    ]
    if unnamed:
        where = ", ".join(
            f"a joint of body {model.body(b).name or b!r}" for b in unnamed
        )
        raise ModelError(
            f"{dataset.compiler.path}: no name has {where}; would fit: a name for "
            "every hinge and slide"
        )


def _check_length(dataset: Dataset, segments: Segments) -> None:
    seconds, least = (
        float(segments.lengths.sum()) * dataset.training.timestep,
        SHORT * WINDOW,
    )
    if seconds < least:
        raise RecordingError(
            f"{seconds:.3g} s of readings are too few to decide anything; would fit: "
            f"at least {least} s, better 20 s, beside what is held out"
        )


def _check_motion(dataset: Dataset) -> None:
    scored = [c for c in dataset.training.channels if c.is_scored]
    if not scored:
        raise RecordingError(
            f"no signal of kind {', '.join(POSITION_LIKE)} has a reading; would fit: "
            "at least one of them"
        )
    read = np.concatenate([episode.readings for episode in dataset.training.episodes])
    if not any(np.nanstd(read[:, c.columns], axis=0).any() for c in scored):
        raise RecordingError(
            f"no position-like signal moves ({', '.join(c.name for c in scored)}); "
            "would fit: a recording in which the robot moves"
        )
    columns = [c.columns for c in dataset.held_out.channels if c.is_scored]
    judged = (
        np.isfinite(episode.readings[:, k])
        for episode in dataset.held_out.episodes
        for k in columns
    )
    if not any(known.any() for known in judged):
        raise RecordingError(
            f"what is held out ({', '.join(dataset.held_out_names)}) has no reading of "
            "a position-like signal to be judged on; would fit: other episodes"
        )


def find_divergence(
    simulator: Simulator,
    segments: Segments,
    terms: Sequence[Term] = (),
    values: Floats = AS_GIVEN,
) -> tuple[int, str, float]:
    """In how many windows a simulation is lost; where and when it is first.

    Args:
        simulator: that is simulated.
        segments: the windows.
        terms: what is true beyond the given model.
        values: (P) of their parameters.

    Returns:
        Count, id of the episode, time in it [s] to within two steps; 0, "", NaN where
        none is lost.
    """
    lost = _find_diverged(simulator, segments, terms, values)
    if not len(lost):
        return 0, "", np.nan
    w = int(lost[0])
    episode = simulator.episodes[int(segments.episode[w])]
    low, high = 0, int(segments.lengths[w])  # alive, lost
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
        len(lost),
        episode.id,
        episode.start + (int(segments.first_step[w]) + high) * simulator.timestep,
    )


def _find_diverged(
    simulator: Simulator, segments: Segments, terms, values: Floats
) -> np.ndarray:
    """Numbers of the windows that are lost."""
    predicted = simulator.simulate(terms, values[None], segments)[0]
    return np.unique(segments.segment_of_sample[~np.isfinite(predicted).all(axis=1)])
