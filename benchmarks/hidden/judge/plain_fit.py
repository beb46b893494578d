"""The plain fit: dry friction, viscous friction and a rotor at every driven joint.

What an engineer would fit first, by `scipy.optimize.least_squares` on short simulated
pieces: nothing is chosen, and no code of selfheal takes part.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.optimize import least_squares

from benchmarks.replay_error import list_errors, simulate_open_loop
from selfheal.recording import Recording

PIECES = 32  # fitted at most, evenly drawn; chosen: all motions, in a minute
ENOUGH = 1e-4  # relative change of cost or values at which a fit ends; chosen
LONGEST_DELAY = 0.06  # [s] of the commands
NUDGE = 0.02  # of a scale, for a slope


@dataclass(frozen=True)
class DriveFit:
    """A model with the values that were fitted.

    Attributes:
        values: (3, n) dry friction [N m or N], viscous friction and rotors.
        delay: [s] of the commands.
    """

    model: mujoco.MjModel
    values: np.ndarray
    delay: float


def choose_evenly(pieces: Recording, count: int) -> Recording:
    """At most `count` of a recording's episodes, evenly drawn."""
    names = list(pieces.episodes)
    at = np.unique(np.linspace(0, len(names) - 1, count).astype(int))
    return replace(pieces, episodes={names[i]: pieces.episodes[names[i]] for i in at})


def find_driven(model: mujoco.MjModel) -> np.ndarray:
    """Degrees of freedom (n) that have an actuator, or all where there is none."""
    moved = model.actuator_trnid[:, 0]
    return np.unique(model.jnt_dofadr[moved]) if model.nu else np.arange(model.nv)


def _guess_scales(
    model: mujoco.MjModel, pieces: Recording, dofs: np.ndarray
) -> np.ndarray:
    """Likely sizes (3, n) of dry friction, viscous friction and rotors."""
    data, given, inertias = mujoco.MjData(model), [], []
    full, speeds = np.zeros((model.nv, model.nv)), []
    for e in pieces.episodes.values():
        data.qpos[:], data.qvel[:], data.ctrl[:] = e.qpos0, e.qvel0, e.ctrl[0]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        shown = data.qfrc_actuator if model.nu else data.qfrc_bias
        given.append(np.abs(shown[dofs]))
        inertias.append(np.diag(full)[dofs])
        speeds.append(data.qvel[dofs].copy())
    speed = np.sqrt(np.mean(np.square(speeds), 0)) + 1e-6
    friction = 0.1 * np.mean(given, 0) + 1e-9
    rotor = 0.3 * np.mean(inertias, 0) + 0.1 * friction / speed
    return np.array([friction, friction / speed, rotor])


def fit_drives(model: mujoco.MjModel, recording: Recording) -> DriveFit:
    """The plain fit of a model.

    Args:
        recording: pieces of what is diagnosed, which state where they start.
    """
    pieces, dofs = choose_evenly(recording, PIECES), find_driven(model)
    scales = np.append(_guess_scales(model, pieces, dofs).ravel(), 0.01)

    def apply(x: np.ndarray) -> DriveFit:
        values, changed = (x * scales)[:-1].reshape(3, -1), model.__copy__()
        (
            changed.dof_frictionloss[dofs],
            changed.dof_damping[dofs],
            changed.dof_armature[dofs],
        ) = values
        # how firmly dry friction holds follows from the inertia with the rotors
        mujoco.mj_setConst(changed, mujoco.MjData(changed))
        return DriveFit(changed, values, float((x * scales)[-1]))

    def measure(x: np.ndarray) -> np.ndarray:
        fit = apply(x)
        predicted = simulate_open_loop(fit.model, pieces, fit.delay)
        return np.concatenate([e.ravel() for e in list_errors(predicted, pieces)])

    def slope(x: np.ndarray) -> np.ndarray:
        now = measure(x)
        steps = NUDGE * np.eye(len(x))
        return np.array([(measure(x + s) - now) / NUDGE for s in steps]).T

    stated = [
        model.dof_frictionloss[dofs],
        model.dof_damping[dofs],
        model.dof_armature[dofs],
        np.zeros(1),
    ]
    ends = np.full(len(scales), np.inf)
    ends[-1] = LONGEST_DELAY / scales[-1]
    start = np.maximum(np.concatenate(stated) / scales, 0.3)
    found = least_squares(
        measure,
        start,
        slope,
        bounds=(np.zeros(len(scales)), ends),
        ftol=ENOUGH,
        xtol=ENOUGH,
        max_nfev=30,
    )
    return apply(found.x)
