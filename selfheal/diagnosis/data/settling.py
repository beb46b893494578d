"""Joints at rest: takes a pose and commands, gives where nothing read a joint.

A robot that was not moving when an episode begins has its unread joints where weight,
springs, loops and the first command put them.
"""

from copy import copy
from typing import TYPE_CHECKING

import numpy as np

from ...recording.data import Floats
from .loop_closure import LoopClosure

if TYPE_CHECKING:
    from mujoco import MjModel

HELD_INERTIA_RATIO = 1e6  # times a joint's inertia, that of one that is held; chosen
SETTLING_SECONDS = 3.0  # [s]; chosen: ten periods of a gripper's finger
# [s] in which added damping takes a joint's speed away; chosen: fast, and far above
# any time step
DAMPING_SECONDS = 0.05
MAX_REST_SPEED = 0.02  # [rad/s or m/s] of what has settled; chosen: about a sensor's
HINGE_OR_SLIDE = (2, 3)  # mjtJoint


def settle_unread_joints(
    model: "MjModel", qpos: Floats, is_read: np.ndarray, ctrl: Floats
) -> Floats | None:
    """Simulate a robot whose unread hinges and slides alone move, until they rest.

    Args:
        qpos: (nq) to begin at.
        is_read: (nq) whether a position is held.
        ctrl: (nu) commands.

    Returns:
        (nq) the pose in which they rest; None where they do not.
    """
    import mujoco

    model = copy(model)
    moves = np.isin(model.jnt_type, HINGE_OR_SLIDE) & ~is_read[model.jnt_qposadr]
    if not moves.any():
        return None
    held = ~moves[model.dof_jntid]
    model.dof_armature[held] += HELD_INERTIA_RATIO * model.dof_M0[held]
    model.dof_damping[~held] += model.dof_M0[~held] / DAMPING_SECONDS
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = qpos, ctrl
    mujoco.mj_step(model, data, nstep=round(SETTLING_SECONDS / model.opt.timestep))
    if not np.abs(data.qvel[~held]).max() < MAX_REST_SPEED:
        return None
    return np.where(is_read, qpos, data.qpos)


def place_unread_joints(
    model: "MjModel", qpos: Floats, qvel: Floats, is_first: np.ndarray, ctrl: Floats
) -> tuple[Floats, Floats, Floats | None, np.ndarray]:
    """Fill in states in which something was not read.

    Args:
        qpos: (W, nq); NaN where nothing was read.
        qvel: (W, nv); NaN where nothing was read.
        is_first: (W) whether a state is the first one of its episode.
        ctrl: (nu) the episode's first commands.

    Returns:
        qpos, qvel, response and is_known, as `CompletedState` has them.
    """
    is_known, response = np.isfinite(qpos), None
    filled = np.where(is_known, qpos, model.qpos0)
    if model.neq:
        loops, response = LoopClosure(model), np.empty((len(qpos), model.nv, model.nv))
        qvel = qvel.copy()
        for i, (q, v) in enumerate(zip(qpos, qvel, strict=True)):
            closed = loops.close(q, v)
            filled[i], qvel[i], response[i] = closed.qpos, closed.qvel, closed.response
            is_known[i] |= closed.is_known
    for k in np.flatnonzero(is_first & ~is_known.all(axis=1)):
        rest = settle_unread_joints(model, filled[k], is_known[k], ctrl)
        filled[k] = filled[k] if rest is None else rest
    return filled, qvel, response, is_known
