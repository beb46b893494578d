"""One diagnosed case against its truth: errors, names and verdict judged."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco

from benchmarks.drives.case import Case
from benchmarks.drives.joint_reader import JointReader
from benchmarks.drives.pieces import (
    Piece,
    compute_error,
    cut_all_horizons,
    measure_spread,
)
from benchmarks.drives.robots import write_mjcf
from benchmarks.drives.truth import EVERYWHERE
from benchmarks.sealed.judge import Places, are_alike, read_places
from selfheal.diagnosis.output.replay import replay_recording
from selfheal.errors import SelfhealError
from selfheal.recording import Recording

NEAR_FLOOR = 1.3  # times the truth's error, within which "nothing" may be said
EXPLAINED = 0.9  # of what the truth removes of the given model's error


def measure_replay(folder: Path, case: Case) -> dict[str, float] | None:
    """Errors of a diagnosis' replay by horizon; None where it does not replay.

    Args:
        folder: of the diagnosis.
        case: whose test is replayed, in the pieces of all other models.
    """
    given = mujoco.MjModel.from_xml_string(write_mjcf(case.robot))
    reader = JointReader(given, case.test)
    spread, errors = measure_spread(case.test, reader), {}
    for name, pieces in cut_all_horizons(case.test, reader).items():
        asked = Recording({f"{k:04d}": _ask(p) for k, p in enumerate(pieces)})
        try:
            played = replay_recording(folder, asked)
        except SelfhealError:
            return None
        found = [reader.read_positions(e) for e in played.episodes.values()]
        errors[name] = compute_error(pieces, found, spread)
    return errors


def _ask(piece: Piece) -> Any:
    """A piece as an episode of its own."""
    rows = slice(piece.first, piece.first + len(piece.time))
    signals = {
        name: replace(signal, values=signal.values[rows])
        for name, signal in piece.episode.signals.items()
    }
    return replace(
        piece.episode, time=piece.time, ctrl=piece.ctrl, signals=signals,
        qpos0=piece.qpos, qvel0=piece.qvel,
    )  # fmt: skip


def _is_named(
    finding: Mapping[str, Any], effect: Mapping[str, Any], places: Places
) -> bool:
    """Whether a finding's name, or one that it says may be it, is an effect's."""
    names, good = {finding["effect"], *finding.get("equivalent", ())}, effect["names"]
    if not (names & set(good) or are_alike(finding["effect"], good[0])):
        return False
    if EVERYWHERE[0] in effect["targets"]:
        return True
    at = places.find_place(finding)
    return any(at & places.same[target] for target in effect["targets"])


def judge_names(
    findings: Sequence[Mapping[str, Any]],
    effects: Sequence[Mapping[str, Any]],
    places: Places,
) -> dict[str, Any]:
    """Which needed effects were named at their place, and which names are false.

    Args:
        findings: of the diagnosis.
        effects: of the references, with `needed`.
        places: what is the same place in the model.
    """
    missed = [
        f"{e['names'][0]} {e['targets'][0]}"
        for e in effects
        if e["needed"] and not any(_is_named(f, e, places) for f in findings)
    ]
    false = [
        f"{f['effect']} {f['target']}"
        for f in findings
        if not any(_is_named(f, e, places) for e in effects)
    ]
    needed = sum(e["needed"] for e in effects)
    return {
        "needed": needed, "named": needed - len(missed), "missed": missed,
        "names": len(findings), "false": false,
    }  # fmt: skip


def judge_verdict(
    verdict: str, found: Mapping[str, float], errors: Mapping[str, Mapping[str, float]]
) -> bool:
    """Whether a verdict agrees with the errors at every horizon.

    Args:
        verdict: of the diagnosis.
        found: errors of its replay, by horizon.
        errors: of the given model and the truth, by model and horizon.
    """
    for name, error in found.items():
        given, true = errors["given"][name], errors["true"][name]
        if verdict == "nothing" and error > NEAR_FLOOR * true:
            return False
        explainable = given - true
        removed = given - error
        if verdict == "explained" and removed < EXPLAINED * explainable:
            return False
    return True


def score_case(
    folder: Path, case: Case, references: Mapping[str, Any], run: Mapping[str, Any]
) -> dict[str, Any]:
    """All that is said of one diagnosed case.

    Args:
        folder: of the case; its diagnosis lies in `diagnosis`, if there is one.
        case: as it was made.
        references: of `measure_references`.
        run: record of the diagnosing process.
    """
    file = folder / "diagnosis" / "diagnosis.json"
    document = json.loads(file.read_text()) if file.is_file() else {}
    findings = document.get("findings", [])
    if case.log.steps:  # rounded readings are named rightly, and hide nothing
        findings = [f for f in findings if f["effect"] != "quantization"]
    judged: dict[str, Any] = {
        "case": case.name,
        "robot": case.robot.name,
        "joints": len(case.robot.links),
        "actuators": case.robot.style,
        "rate": case.log.rate,
        "seconds": run["seconds"],
        "late": run["late"],
        "said": "" if document else run.get("stderr", ""),
        "verdict": document.get("verdict", "failed"),
        "found": [f"{f['effect']} {f['target']}" for f in findings],
        **judge_names(findings, references["effects"], read_places(folder)),
    }
    errors = dict(references["errors"])
    # without a diagnosis the user has the model as given
    found = measure_replay(file.parent, case) if document else None
    errors["selfheal"] = found or errors["given"]
    judged["errors"] = errors
    judged["replayed"] = found is not None
    judged["honest"] = (
        judge_verdict(judged["verdict"], found, errors) if found else None
    )
    return judged
