"""Closed loops: takes the joints that were read, gives those that constraints place.

A model's equality constraints (connect, weld, joint, tendon) have residuals r(q) and a
Jacobian J. With the joints that were read held, Newton steps of the others solve

    J_u du = -r,   J_u v_u = -J_m v_m,

by least squares, where u are the degrees of freedom that were not read, and m those
that were.
"""

from copy import copy
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...recording.data import Floats

if TYPE_CHECKING:
    from mujoco import MjModel

MAX_NEWTON_STEPS = 50  # chosen: from anywhere near a solution five are enough
MAX_JOINT_STEP = 0.3  # [rad or m] of a Newton step; chosen: keeps the assembly mode
CLOSED_STEP = 1e-9  # [rad or m]; chosen: below any reading's noise
# steps from the model's own pose to the first that was read; chosen: small ones stay
# on the branch in which the model is assembled
APPROACH_STEPS = 10
# singular value of J_u, of the largest one, below which the loop leaves a direction
# free; chosen: a hundredth of a joint's own lever
MIN_SINGULAR_VALUE_SHARE = 1e-2
# largest residual of the constraints [m or rad] of a loop that is closed; chosen: what
# noise and soft constraints leave
CLOSED_RESIDUAL = 1e-2


class ClosedState(NamedTuple):
    """A state in which loops are closed.

    Attributes:
        qpos: (nq) as read, and as the constraints have it where nothing was.
        qvel: (nv) likewise.
        response: (nv, nv) how all positions move with each; of a joint that was not
            read, by the constraints.
        is_known: (nq) whether a position was read or follows from those that were.
    """

    qpos: Floats
    qvel: Floats
    response: Floats
    is_known: np.ndarray


class LoopClosure:
    """Closes the loops of one model, from one state to the next."""

    def __init__(self, model: "MjModel") -> None:
        """`model`: compiled, as given."""
        import mujoco

        self._model = copy(model)
        bits = mujoco.mjtDisableBit
        others = bits.mjDSBL_CONTACT | bits.mjDSBL_LIMIT | bits.mjDSBL_FRICTIONLOSS
        self._model.opt.disableflags |= int(others)
        self._model.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
        self._data = mujoco.MjData(self._model)
        self._pose = np.array(model.qpos0)
        sizes = np.diff([*model.jnt_qposadr, model.nq])
        self._dof_of_qpos = np.repeat(np.asarray(model.jnt_dofadr, int), sizes)
        self._is_first = True

    def close(self, qpos: Floats, qvel: Floats) -> ClosedState:
        """Close the loops in a state, beginning at the solution of the last one.

        Args:
            qpos: (nq); NaN where nothing was read.
            qvel: (nv); NaN where nothing was read.
        """
        model = self._model
        is_read = np.isfinite(qpos)
        is_free = ~is_read[model.jnt_qposadr]
        free = np.repeat(is_free, np.diff([*model.jnt_dofadr, model.nv]))
        begin = self._pose.copy()
        count = APPROACH_STEPS if self._is_first else 1
        for share in np.linspace(0, 1, count + 1)[1:]:
            moved = begin[is_read] + share * (qpos[is_read] - begin[is_read])
            self._pose[is_read] = moved
            residual, jacobian = self._solve(free)
        self._is_first = False
        response, is_determined = _follow(jacobian, free)
        is_closed = bool(np.abs(residual).max(initial=0.0) < CLOSED_RESIDUAL)
        velocity = np.where(free, 0.0, np.nan_to_num(qvel))
        is_known = is_read | (is_closed & is_determined[self._dof_of_qpos])
        return ClosedState(self._pose.copy(), response @ velocity, response, is_known)

    def _solve(self, free: np.ndarray) -> tuple[Floats, Floats]:
        """Move the free degrees of freedom (nv) to where the constraints are least.

        Returns:
            Residuals (ne) and Jacobian (ne, nv) of the constraints there.
        """
        import mujoco

        step = np.zeros(self._model.nv)
        for _ in range(MAX_NEWTON_STEPS):
            residual, jacobian = self._evaluate()
            step[free] = -_pseudo_inverse(jacobian[:, free]) @ residual
            longest = max(np.abs(step).max(initial=0.0), 1e-300)
            step *= min(1.0, MAX_JOINT_STEP / longest)
            mujoco.mj_integratePos(self._model, self._pose, step, 1.0)
            if np.abs(step).max(initial=0.0) < CLOSED_STEP:
                break
        return self._evaluate()

    def _evaluate(self) -> tuple[Floats, Floats]:
        """Residuals (ne) and Jacobian (ne, nv) of the equality constraints."""
        import mujoco

        self._data.qpos[:] = self._pose
        mujoco.mj_fwdPosition(self._model, self._data)
        count = self._data.ne
        jacobian = np.array(self._data.efc_J).reshape(-1, self._model.nv)[:count]
        return np.array(self._data.efc_pos[:count]), jacobian


def _pseudo_inverse(jacobian: Floats) -> Floats:
    """Inverse of a Jacobian (ne, k) in the directions that it tells."""
    return np.array(np.linalg.pinv(jacobian, rcond=MIN_SINGULAR_VALUE_SHARE), float)


def _follow(jacobian: Floats, free: np.ndarray) -> tuple[Floats, np.ndarray]:
    """How positions follow each other by constraints.

    Args:
        jacobian: (ne, nv) of the constraints.
        free: (nv) whether a degree of freedom was not read.

    Returns:
        Response (nv, nv), the identity beside what follows; and whether the constraints
        determine each free one (nv).
    """
    response, is_determined = np.eye(len(free)), np.zeros(len(free), bool)
    own = jacobian[:, free]
    if own.size:
        inverse = _pseudo_inverse(own)
        response[np.ix_(free, ~free)] = -inverse @ jacobian[:, ~free]
        resolution = inverse @ own  # the identity where all is determined
        is_determined[free] = np.diag(resolution) > 1 - MIN_SINGULAR_VALUE_SHARE
    return response, is_determined
