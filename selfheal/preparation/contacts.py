"""Contacts that no pose ends: takes a compiled model, gives pairs of its bodies."""

from typing import TYPE_CHECKING

import numpy as np

from ..recording.data import Floats
from ..telemetry.contacts import find_touching_bodies

if TYPE_CHECKING:
    import mujoco

# random poses; a pair that is apart in 3 % of all poses is so in one of these with a
# probability of 95 %, 1 - 0.97^100
POSES = 100


def find_touching_pairs(model: "mujoco.MjModel") -> list[tuple[int, int]]:
    """Ids of bodies that touch in the reference pose and in random poses of the joints.

    A pair whose distance depends on where a free body is, a foot and the floor say, is
    none.
    """
    rng = np.random.default_rng(0)
    poses = (
        draw_pose(model, rng) if pose else model.qpos0 for pose in range(POSES + 1)
    )
    bases = [_find_free_base(model, body) for body in range(model.nbody)]
    pairs = find_touching_bodies(model, poses)
    return sorted(pair for pair in pairs if bases[pair[0]] == bases[pair[1]])


def draw_pose(model: "mujoco.MjModel", rng: np.random.Generator) -> Floats:
    """A random pose (nq) within the joints' ranges [m, rad; quaternions].

    Free joints and slides without a range stay; joints that follow others do so.
    """
    import mujoco

    kinds, qpos = mujoco.mjtJoint, model.qpos0.copy()
    for j in range(model.njnt):
        at, kind = model.jnt_qposadr[j], model.jnt_type[j]
        limited = model.jnt_limited[j]
        if kind == kinds.mjJNT_BALL:
            axis = rng.normal(size=3)
            angle = rng.uniform(0, model.jnt_range[j, 1] if limited else np.pi)
            mujoco.mju_axisAngle2Quat(
                qpos[at : at + 4], axis / np.hypot.reduce(axis), angle
            )
        elif kind != kinds.mjJNT_FREE and limited:
            qpos[at] = rng.uniform(*model.jnt_range[j])
        elif kind == kinds.mjJNT_HINGE:
            qpos[at] = rng.uniform(-np.pi, np.pi)
    for e in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT):
        one, other = model.eq_obj1id[e], model.eq_obj2id[e]
        if other >= 0 and model.eq_active0[e]:
            own, led = model.jnt_qposadr[one], model.jnt_qposadr[other]
            moved = np.polyval(model.eq_data[e, 4::-1], qpos[led] - model.qpos0[led])
            qpos[own] = model.qpos0[own] + moved
    return qpos


def _find_free_base(model: "mujoco.MjModel", body: int) -> int:
    """The body with a free joint that carries a body, or is it; 0: it stands."""
    import mujoco

    while body:
        first = model.body_jntadr[body]
        if first >= 0 and model.jnt_type[first] == mujoco.mjtJoint.mjJNT_FREE:
            break
        body = int(model.body_parentid[body])
    return body
