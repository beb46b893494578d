"""Folders of a diagnosis, and the score of a model on a recording."""

import json
from pathlib import Path

import numpy as np

from selfheal.diagnosis.simulation import score
from selfheal.diagnosis.simulation.build import build_simulator
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from selfheal.mjcf.edit import apply_edits
from selfheal.recording import Recording


def write_empty_diagnosis(folder: Path, model: Path) -> Path:
    """The folder of a diagnosis that found nothing."""
    folder.mkdir()
    document = {"format": "selfheal-diagnosis", "version": 1, "findings": [],
                "refit": []}  # fmt: skip
    (folder / "diagnosis.json").write_text(json.dumps(document))
    (folder / "patched.xml").write_text(apply_edits(model, (), folder))
    return folder


def write_finding(out: Path, **finding: object) -> None:
    """Let the diagnosis find one thing: friction of the elbow, but for some fields."""
    path = out / "diagnosis.json"
    document = json.loads(path.read_text())
    found = {"effect": "coulomb_friction", "target": "joint:elbow",
             "parameters": [{"name": "frictionloss", "value": 0.1}]}  # fmt: skip
    document["findings"] = [{**found, **finding}]
    path.write_text(json.dumps(document))


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
