"""One case of missing drives against its truth: errors, names and verdict judged."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.diagnosis_runs import DOCUMENT, replay_inputs
from benchmarks.hidden.case import Experiment
from benchmarks.hidden.drafts import Draft
from benchmarks.hidden.drives import HORIZONS, draft_case
from benchmarks.hidden.effects.base import PlacedEffect
from benchmarks.hidden.judge.names import (
    ALSO,
    Judged,
    describe,
    judge_names,
    read_places,
    select_real_findings,
)
from benchmarks.hidden.judge.plain_fit import choose_evenly, fit_drives
from benchmarks.hidden.judge.sealed import (
    compute_rate,
    compute_share,
    read_json,
    select_kind,
)
from benchmarks.hidden.motions import command_table
from benchmarks.hidden.simulator import MotionPlan, Simulator
from benchmarks.hidden.truth import UnfitDraw
from benchmarks.replay_error import compute_score, extract_values, simulate_open_loop
from selfheal.files import atomic_path
from selfheal.recording import Recording, read

Pieces = Mapping[str, Recording]  # by horizon
NEAR_FLOOR = 1.3  # times the truth's error, within which "nothing" may be said
EXPLAINED = 0.9  # of what the truth removes of the given model's error
LEAST_SHARE = 0.1  # of the squared error, that an effect removes which has to be named
# horizons at which effects' shares are measured, and on how many pieces of the test
SHARED = {"0.5 s": 12, "2 s": 4}


def score_truth(
    experiment: Experiment, placed: Sequence[PlacedEffect], pieces: Recording
) -> float:
    """Score of the hidden physics itself."""
    robot = experiment.robot
    simulator = Simulator(experiment.make_hidden_robot(placed))
    found = {}
    for name, e in pieces.episodes.items():
        rows = np.round((e.time - e.time[0]) / robot.fine).astype(int)
        state = np.asarray(e.qpos0), np.asarray(e.qvel0)
        plan = MotionPlan("", rows, command_table(e.ctrl), *state)
        try:
            run = simulator.run(plan)
        except UnfitDraw:
            found[name] = {n: np.nan * s.values for n, s in e.signals.items()}
            continue
        clean = experiment.instruments.read_clean(run, simulator.compiled)
        found[name] = {n: signal.values for n, signal in clean.items()}
    return compute_score(found, pieces)


def measure_references(
    draft: Draft, experiment: Experiment, train: Recording, tests: Pieces
) -> Judged:
    """Errors by horizon of the given model, the plain fit and the truth; its effects.

    Returns:
        `errors` by model and horizon [1], `plain_fit` its values, and `effects`: name,
        targets, and the share of the squared error that each removes when added last.
    """
    given = draft.state_model().model
    fit = fit_drives(given, train)

    def predict(model: mujoco.MjModel, delay: float) -> dict[str, float]:
        return {
            name: compute_score(simulate_open_loop(model, pieces, delay), pieces)
            for name, pieces in tests.items()
        }

    errors = {
        "given": predict(given, 0.0),
        "plain": predict(fit.model, fit.delay),
        "true": {
            name: score_truth(experiment, draft.hidden, pieces)
            for name, pieces in tests.items()
        },
    }
    values = {"values": fit.values.tolist(), "delay": fit.delay}
    effects = _measure_shares(draft, experiment, tests)
    return {"errors": errors, "plain_fit": values, "effects": effects}


def _measure_shares(
    draft: Draft, experiment: Experiment, tests: Pieces
) -> list[Judged]:
    """What each effect removes of the squared error when added last to the others."""
    some = {
        name: choose_evenly(tests[name], count)
        for name, count in SHARED.items()
        if tests[name].episodes
    }

    def measure(placed: Sequence[PlacedEffect]) -> dict[str, float]:
        return {
            n: score_truth(experiment, placed, pieces) for n, pieces in some.items()
        }

    whole, found = measure(draft.hidden), []
    for one, rest in draft.list_missing():
        without = measure(rest)
        shares = {n: 1 - whole[n] ** 2 / without[n] ** 2 for n in some}
        found.append(
            {
                "names": (one.effect.name, *ALSO.get(one.effect.name, ())),
                "target": one.target,
                "values": one.values,
                "share": shares,
                "needed": max(shares.values()) >= LEAST_SHARE,
            }
        )
    return found


def judge_verdict(
    verdict: str, found: Mapping[str, float], errors: Mapping[str, Mapping[str, float]]
) -> bool:
    """Whether a verdict agrees with the errors at every horizon.

    Args:
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


def read_case(case: Path, keys: Path, replay: tuple[str, ...] = ()) -> Judged:
    """All that is said of one case of a folder.

    What the case allows is measured once, and kept beside its key.

    Args:
        replay: words that start a replay; empty: the test is not replayed.
    """
    sealed = keys / case.name
    key = json.loads((sealed / "key.json").read_text())
    tests = {name: read(sealed / f"test {name}.h5") for name in HORIZONS}
    draft, experiment, _ = draft_case(key["kind"], key["seed"], key["attempt"])
    known = sealed / "references.json"
    if not known.is_file():
        train = read(sealed / "train 0.5 s.h5")
        measured = measure_references(draft, experiment, train, tests)
        with atomic_path(known) as path:
            path.write_text(json.dumps(measured, indent=1, default=float) + "\n")
    references, run = json.loads(known.read_text()), read_json(case / "run.json")
    document = read_json(case / DOCUMENT)
    findings = select_real_findings(document, key)
    errors = references["errors"]
    # without a diagnosis the user has the model as given
    found = _score_replays(case, tests, replay) if document and replay else {}
    verdict = document.get("verdict", "failed")
    return {
        "case": case.name,
        "kind": key["kind"],
        "robot": f"{key['robot']}, {experiment.robot.drive}, {key['rate']:.0f} Hz",
        "run": {k: v for k, v in run.items() if k != "stderr"},
        "verdict": verdict,
        "found": describe(findings),
        **judge_names(findings, references["effects"], read_places(case)),
        "errors": {**errors, "selfheal": found or errors["given"]},
        "replayed": bool(found),
        "honest": judge_verdict(verdict, found, errors) if found else None,
    }


def _score_replays(
    case: Path, tests: Pieces, replay: Sequence[str]
) -> dict[str, float]:
    """Scores of a diagnosis' replay by horizon; none where it does not replay."""
    found = {}
    for name, pieces in tests.items():
        played = replay_inputs((case / DOCUMENT).parent, pieces, replay)
        if played is None:
            return {}
        found[name] = compute_score(extract_values(played), pieces)
    return found


def compute_figures(cases: Sequence[Judged]) -> dict[str, Judged]:
    """Figures by kind."""
    kinds = dict.fromkeys(c["kind"] for c in cases)
    return {kind: _summarize_kind(select_kind(cases, kind)) for kind in kinds}


def _summarize_kind(cases: Sequence[Judged]) -> Judged:
    figures: Judged = {"cases": len(cases)}
    for name in HORIZONS:
        for other in ("plain", "true"):
            ratios = [
                c["errors"]["selfheal"][name] / c["errors"][other][name] for c in cases
            ]
            figures[f"error / {other}, {name}"] = float(np.median(ratios))
    needed, named = (sum(c[key] for c in cases) for key in ("needed", "named"))
    names, false = sum(c["names"] for c in cases), sum(len(c["false"]) for c in cases)
    honest = [c["honest"] for c in cases if c["honest"] is not None]
    seconds = [c["run"].get("seconds", np.nan) for c in cases]
    return figures | {
        "effects named": compute_share(named, needed),
        "false names": compute_share(false, names),
        "verdicts that agree with the errors": compute_rate(honest),
        "without a diagnosis": compute_rate(not c["replayed"] for c in cases),
        "seconds, median": float(np.median(seconds)),
        "seconds, largest": float(max(seconds)),
    }
