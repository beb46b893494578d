"""Folders of a diagnosis, and the score of a model on a recording."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from selfheal.diagnosis.output.result import Diagnosis, Localization
from selfheal.diagnosis.simulation import score
from selfheal.diagnosis.simulation.build import build_simulator
from selfheal.diagnosis.simulation.model_variants import ModelCompiler
from selfheal.mjcf.edit import Edit, apply_edits
from selfheal.recording import Recording


def write_empty_diagnosis(folder: Path, model: Path) -> Path:
    """The folder of a diagnosis that found nothing."""
    folder.mkdir()
    (folder / "diagnosis.json").write_text(json.dumps(make_document()))
    (folder / "patched.xml").write_text(apply_edits(model, (), folder))
    return folder


def make_document(**members: object) -> dict:
    """The document of a diagnosis that found nothing, but for some members."""
    document = {"format": "selfheal-diagnosis", "version": 1, "verdict": "nothing"}
    return {**document, "findings": [], "refit": [], "fit": {}, **members}


def make_small_diagnosis(
    model: str, document: Mapping[str, object], **fields: object
) -> Diagnosis:
    """A diagnosis of which nothing but its document is made up, and some fields."""
    located = Localization((), (), np.zeros((0, 0)), np.zeros((0, 0)))
    found = Diagnosis(
        model, document, (), "", "", (), located, (), (), (), seconds=1.0, simulations=2
    )
    return replace(found, **fields)


def save_diagnosis(
    path: Path, edits: Sequence[Edit], findings: Sequence[dict] = ()
) -> Path:
    """The folder of a diagnosis of a model, of edits and findings that are made up."""
    document = make_document(verdict="explained", findings=list(findings))
    text = apply_edits(path, edits, path.parent)
    made = make_small_diagnosis(str(path), document, edits=edits, patched=text)
    made.save(path.parent / "out")
    return path.parent / "out"


def write_finding(out: Path, **finding: object) -> None:
    """Let the diagnosis find one thing: friction of the elbow, but for some fields."""
    path = out / "diagnosis.json"
    document = json.loads(path.read_text())
    parameters = [{"name": "frictionloss", "value": 0.1}]
    found = {"effect": "coulomb_friction", "target": "joint:elbow"}
    found["parameters"] = parameters
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
