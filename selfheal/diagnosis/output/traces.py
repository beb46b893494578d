"""The worst stretches: takes replays of held-out episodes, gives curves and poses."""

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..selection.replay_scores import HeldOutScores
from ..simulation.dataset import Dataset
from ..simulation.simulator import Simulator
from .pose_trace import make_pose_trace
from .result import PoseTrace, Trace

MAX_TRACES = 4  # stretches that a page may draw; chosen


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
