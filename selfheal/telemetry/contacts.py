"""Contacts in given poses: takes a compiled model and positions, gives what touches."""

from collections.abc import Collection, Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..recording.data import Floats

if TYPE_CHECKING:
    import mujoco


def collide(
    model: "mujoco.MjModel", poses: Iterable[Floats]
) -> "Iterator[mujoco.MjData]":
    """What touches in each pose (nq); it is valid until the next one is computed."""
    import mujoco

    data = mujoco.MjData(model)
    for pose in poses:
        data.qpos[:] = pose
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        yield data


def find_touching_bodies(
    model: "mujoco.MjModel", poses: Iterable[Floats], skip: Collection[int] = ()
) -> set[tuple[int, int]]:
    """Ids of the bodies that touch each other in all of some poses, in pairs.

    Args:
        poses: (nq) each [m, rad; quaternions].
        skip: types of geoms that do not count.
    """
    always: set[tuple[int, int]] | None = None
    for data in collide(model, poses):
        geoms = data.contact.geom[data.contact.dist <= 0]
        geoms = geoms[(geoms >= 0).all(axis=1)]  # else of a deformable
        geoms = geoms[~np.isin(model.geom_type[geoms], [*skip]).any(axis=1)]
        pairs = {(int(a), int(b)) for a, b in np.sort(model.geom_bodyid[geoms], axis=1)}
        always = pairs if always is None else always & pairs
        if not always:
            break
    return always or set()
