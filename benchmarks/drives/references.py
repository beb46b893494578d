"""What a case allows: errors of the given model, the plain fit and the truth itself."""

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from benchmarks.drives.case import Case
from benchmarks.drives.joint_reader import JointReader
from benchmarks.drives.pieces import (
    Piece,
    choose_evenly,
    compute_error,
    cut_all_horizons,
    measure_spread,
)
from benchmarks.drives.plain_fit import (
    apply_fit,
    find_driven,
    fit_drives,
    simulate_pieces,
)
from benchmarks.drives.plant import Plant
from benchmarks.drives.robots import write_mjcf
from benchmarks.drives.truth import Truth, list_effects

LEAST_SHARE = 0.1  # of the squared error, that an effect removes which has to be named
# horizons at which effects' shares are measured, and on how many pieces of the test
SHARED = {"0.5 s": 12, "2 s": 4}


def predict_by_truth(
    case: Case, truth: Truth, pieces: Sequence[Piece], columns: np.ndarray
) -> list[np.ndarray]:
    """Positions (T, n) [rad or m] of pieces, by the hidden physics.

    Args:
        case: whose robot moves.
        truth: its own, or that without an effect.
        pieces: to predict.
        columns: (n) of `qpos` that are read.
    """
    plant = Plant(case.robot, truth)

    def predict(piece: Piece) -> np.ndarray:
        run = plant.run(piece.time, piece.ctrl, piece.qpos, piece.qvel)
        return run.qpos[:, columns]

    return [predict(piece) for piece in pieces]


def measure_references(case: Case) -> dict[str, Any]:
    """Errors by horizon of the given model, the plain fit and the truth; its effects.

    Returns:
        `errors` by model and horizon [1], `plain_fit` its values, and `effects`: name,
        targets, and the share of the squared error that each removes when added last.
    """
    given = mujoco.MjModel.from_xml_string(write_mjcf(case.robot))
    reader = JointReader(given, case.train)
    spread = measure_spread(case.test, reader)
    horizons = cut_all_horizons(case.test, reader)
    fit = fit_drives(reader, case.train)
    models = [given, apply_fit(given, fit, find_driven(given))]
    errors: dict[str, dict[str, float]] = {"given": {}, "plain": {}, "true": {}}
    for name, pieces in horizons.items():
        found = simulate_pieces(models, pieces, [0.0, fit.delay], reader.columns)
        errors["given"][name] = compute_error(pieces, found[0], spread)
        errors["plain"][name] = compute_error(pieces, found[1], spread)
        true = predict_by_truth(case, case.truth, pieces, reader.columns)
        errors["true"][name] = compute_error(pieces, true, spread)
    values = {
        "coulomb": list(fit.coulomb),
        "viscous": list(fit.viscous),
        "armature": list(fit.armature),
        "delay": fit.delay,
    }
    effects = _measure_shares(case, horizons, spread, reader.columns)
    return {"errors": errors, "plain_fit": values, "effects": effects}


def _measure_shares(
    case: Case,
    horizons: Mapping[str, Sequence[Piece]],
    spread: np.ndarray,
    columns: np.ndarray,
) -> list[dict[str, Any]]:
    """What each effect removes of the squared error when added last to the others.

    Args:
        case: whose effects are measured.
        horizons: pieces of each.
        spread: (n) [rad or m] of the readings.
        columns: (n) of `qpos` that are read.
    """
    some = {name: choose_evenly(horizons[name], count)
            for name, count in SHARED.items() if horizons[name]}  # fmt: skip

    def measure(truth: Truth, name: str) -> float:
        rest = predict_by_truth(case, truth, some[name], columns)
        return compute_error(some[name], rest, spread)

    whole, found = {name: measure(case.truth, name) for name in some}, []
    for effect in list_effects(case.robot, case.truth):
        rest = effect.remove(case.truth)
        shares = {n: 1 - whole[n] ** 2 / measure(rest, n) ** 2 for n in some}
        found.append({
            "names": effect.names,
            "targets": effect.targets,
            "values": effect.values,
            "share": shares,
            "needed": max(shares.values()) >= LEAST_SHARE,
        })  # fmt: skip
    return found
