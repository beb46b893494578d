"""Kinematics alone: a model and joint positions in, poses of its bodies out."""

from typing import TYPE_CHECKING

import numpy as np

from ..body.body import Floats

if TYPE_CHECKING:
    import mujoco


def pose_bodies(model: "mujoco.MjModel", qpos: Floats) -> Floats:
    """Poses (F, B, 7) of all bodies but the world at positions (F, nq).

    A pose is a body's origin [m] and quaternion in the world frame.
    """
    import mujoco

    data, poses = mujoco.MjData(model), []
    for data.qpos[:] in qpos:
        mujoco.mj_kinematics(model, data)
        poses.append(np.hstack([data.xpos[1:], data.xquat[1:]]))
    return np.array(poses)
