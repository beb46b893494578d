"""Folders of a diagnosis."""

import json
from pathlib import Path

from selfheal.mjcf.edit import apply_edits


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
