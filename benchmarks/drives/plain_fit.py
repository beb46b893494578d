"""The plain fit: dry friction, viscous friction and a rotor at every driven joint.

What an engineer would fit first, by `scipy.optimize.least_squares` on short simulated
pieces: nothing is chosen, and no code of selfheal takes part.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from scipy.optimize import least_squares

from benchmarks.drives.joint_reader import JointReader
from benchmarks.drives.pieces import Piece, choose_evenly, cut_pieces, measure_spread
from selfheal.recording import Recording

SECONDS = 0.5  # of a piece that is fitted
PIECES = 32  # fitted at most, evenly drawn; chosen: all motions, in a minute
ENOUGH = 1e-4  # relative change of cost or values at which a fit ends; chosen
LONGEST_DELAY = 0.06  # [s] of the commands


@dataclass(frozen=True)
class DriveFit:
    """Values of every driven joint.

    Attributes:
        coulomb: (n) [N m or N] dry friction.
        viscous: (n) [N m s/rad or N s/m].
        armature: (n) [kg m^2 or kg].
        delay: [s] of the commands.
    """

    coulomb: np.ndarray
    viscous: np.ndarray
    armature: np.ndarray
    delay: float


def apply_fit(model: Any, fit: DriveFit, dofs: np.ndarray) -> Any:
    """A copy of a model with a fit's values at degrees of freedom (n)."""
    changed = model.__copy__()
    changed.dof_frictionloss[dofs] = fit.coulomb
    changed.dof_damping[dofs] = fit.viscous
    changed.dof_armature[dofs] = fit.armature
    # how firmly dry friction holds follows from the inertia with the rotors
    mujoco.mj_setConst(changed, mujoco.MjData(changed))
    return changed


def average_commands(piece: Piece, step: float, delay: float) -> np.ndarray:
    """Mean command (K, nu) over each time step, held between samples, late by `delay`.

    Before its first sample a piece's command is that of the first sample.

    Args:
        piece: with the commands.
        step: [s] of the model.
        delay: [s] of the commands.
    """
    count = int(np.ceil(piece.time[-1] / step - 1e-9)) + 1
    edges = np.arange(count + 1) * step - delay
    # the integral of what is held is piecewise linear, so its differences are exact
    knots = np.concatenate([[-1.0], piece.time, [piece.time[-1] + 1.0]])
    held = np.concatenate([piece.ctrl[:1], piece.ctrl])
    area = np.concatenate(
        [np.zeros((1, held.shape[1])), np.cumsum(held * np.diff(knots)[:, None], 0)]
    )
    columns = [np.interp(edges, knots, column) for column in area.T]
    return np.diff(np.array(columns).T.reshape(count + 1, -1), axis=0) / step


def simulate_pieces(
    models: Sequence[Any],
    pieces: Sequence[Piece],
    delays: Sequence[float],
    columns: np.ndarray,
) -> list[list[np.ndarray]]:
    """Positions that models predict of pieces, open loop from their initial states.

    Args:
        models: of equal sizes.
        pieces: to predict.
        delays: [s] of the commands, one a model.
        columns: (n) of `qpos` that are read.

    Returns:
        By model and piece: (T, n) [rad or m].
    """
    first = models[0]
    data, step, nq = mujoco.MjData(first), float(first.opt.timestep), first.nq
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    size = mujoco.mj_stateSize(first, full)
    longest = max(len(average_commands(p, step, 0.0)) for p in pieces)
    starts = np.zeros((len(pieces), size))
    for row, piece in zip(starts, pieces, strict=True):
        row[1 : 1 + nq], row[1 + nq : 1 + nq + first.nv] = piece.qpos, piece.qvel
    controls = np.zeros((len(models), len(pieces), longest, first.nu))
    for per_model, delay in zip(controls, delays, strict=True):
        for row, piece in zip(per_model, pieces, strict=True):
            given = average_commands(piece, step, delay)
            row[: len(given)], row[len(given) :] = given, given[-1]
    states, _ = rollout.rollout(
        [model for model in models for _ in pieces],
        [data],
        np.tile(starts, (len(models), 1)),
        controls.reshape(-1, longest, first.nu) if first.nu else None,
        nstep=longest,
    )
    states = states.reshape(len(models), len(pieces), longest, size)[..., 1 : 1 + nq]
    grid = np.arange(longest + 1) * step
    return [
        [
            _sample(grid, np.vstack([piece.qpos, rows])[:, columns], piece.time)
            for piece, rows in zip(pieces, per_model, strict=True)
        ]
        for per_model in states
    ]


def _sample(grid: np.ndarray, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Values (K, n) on a grid (K) [s], linearly interpolated at times (T) [s]."""
    return np.array([np.interp(times, grid, column) for column in values.T]).T


def _guess_scales(model: Any, pieces: Sequence[Piece], dofs: np.ndarray) -> np.ndarray:
    """Likely sizes (3, n) of dry friction, viscous friction and rotors."""
    data, given, inertias = mujoco.MjData(model), [], []
    full = np.zeros((model.nv, model.nv))
    for piece in pieces:
        data.qpos[:], data.qvel[:], data.ctrl[:] = piece.qpos, piece.qvel, piece.ctrl[0]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        shown = data.qfrc_actuator if model.nu else data.qfrc_bias
        given.append(np.abs(shown[dofs]))
        inertias.append(np.diag(full)[dofs])
    speeds = np.sqrt(np.mean([piece.qvel[dofs] ** 2 for piece in pieces], 0)) + 1e-6
    friction = 0.1 * np.mean(given, 0) + 1e-9
    rotor = 0.3 * np.mean(inertias, 0) + 0.1 * friction / speeds
    return np.array([friction, friction / speeds, rotor])


class _Residuals:
    """Residuals of the pieces and their slopes, for `least_squares`."""

    def __init__(
        self, reader: JointReader, pieces: Sequence[Piece], spread: np.ndarray
    ) -> None:
        self.model = model = reader.model
        self.columns, self.pieces, self.spread = reader.columns, pieces, spread
        self.dofs = find_driven(model)
        self.scales = np.append(_guess_scales(model, pieces, self.dofs).ravel(), 0.01)

    def read(self, x: np.ndarray) -> DriveFit:
        """The fit of scaled values (3 n + 1)."""
        values = x * self.scales
        coulomb, viscous, armature = values[:-1].reshape(3, -1)
        return DriveFit(coulomb, viscous, armature, float(values[-1]))

    def compute(self, points: np.ndarray) -> np.ndarray:
        """Residuals (K, R) of points (K, 3 n + 1)."""
        fits = [self.read(x) for x in points]
        models = [apply_fit(self.model, fit, self.dofs) for fit in fits]
        delays = [fit.delay for fit in fits]
        found = simulate_pieces(models, self.pieces, delays, self.columns)
        rows = [
            np.concatenate([
                ((p - piece.seen) / self.spread).ravel()
                for p, piece in zip(predicted, self.pieces, strict=True)
            ])
            for predicted in found
        ]  # fmt: skip
        return np.clip(np.nan_to_num(np.array(rows), nan=10.0), -10, 10)

    def compute_slopes(self, x: np.ndarray) -> np.ndarray:
        """Jacobian (R, 3 n + 1) by differences of a fiftieth of a scale."""
        steps = 0.02 * np.eye(len(x))
        rows = self.compute(np.vstack([x, x + steps]))
        return (rows[1:] - rows[0]).T / 0.02


def find_driven(model: Any) -> np.ndarray:
    """Degrees of freedom (n) that have an actuator, or all where there is none."""
    return np.unique(model.jnt_dofadr[model.actuator_trnid[:, 0]]) if model.nu else (
        np.arange(model.nv)
    )  # fmt: skip


def fit_drives(reader: JointReader, recording: Recording) -> DriveFit:
    """The plain fit of a model to a recording.

    Args:
        reader: has the model as given.
        recording: for the diagnosis.
    """
    pieces = choose_evenly(cut_pieces(recording, reader, SECONDS), PIECES)
    residuals = _Residuals(reader, pieces, measure_spread(recording, reader))
    size = len(residuals.scales)
    model, dofs = reader.model, residuals.dofs
    stated = [model.dof_frictionloss[dofs], model.dof_damping[dofs],
              model.dof_armature[dofs], np.zeros(1)]  # fmt: skip
    start = np.maximum(np.concatenate(stated) / residuals.scales, 0.3)
    ends = np.full(size, np.inf)
    ends[-1] = LONGEST_DELAY / residuals.scales[-1]
    found = least_squares(
        lambda x: residuals.compute(x[None])[0],
        start,
        residuals.compute_slopes,
        bounds=(np.zeros(size), ends),
        ftol=ENOUGH,
        xtol=ENOUGH,
        max_nfev=30,
    )
    return residuals.read(found.x)
