"""The score of a model on a recording, by this package."""

from pathlib import Path

import numpy as np

from selfheal.diagnosis.simulation import score
from selfheal.diagnosis.simulation.build import build_simulator
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from selfheal.recording import Recording


def score_model(
    model: Path, recording: Recording
) -> tuple[float, np.ndarray, tuple[str, ...]]:
    """The score, the errors (C) of all channels in it, and their names."""
    simulator = build_simulator(ModelCompiler(str(model)), [recording])
    segments = score.cut_replay_segments(simulator)
    squares = score.sum_squared_errors(simulator, segments, (), np.zeros(0))
    count = score.count_readings(simulator, segments)
    names = tuple(c.name for c in simulator.channels)
    errors = score.normalize_errors(simulator, squares, count)
    return score.compute_score(simulator, squares, count), errors, names
