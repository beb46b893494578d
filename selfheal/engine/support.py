"""What carries a body whose joints move: a body and commands in; touch, tilt out."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..body.body import Bodies, Floats
from ..body.mjcf import Physics, build_spec

# [m] within which a limb counts as touching; chosen: a degree that a servo is off, at
# the end of a limb of 0.3 m
CLEARANCE = 0.005
_STEP = 0.005  # [s] of the simulation; chosen: servos as stiff as this stay stable


def measure_support(body: Bodies, commands: Floats, period: float) -> tuple[int, float]:
    """Simulate a body that lies on the floor at first, all joints at zero.

    Args:
        body: a batch of one, not bolted down.
        commands: (T, P) of its joints [rad], each reached evenly within a period: a
            servo does not jump.
        period: [s].

    Returns:
        At how many commands a limb touched the floor, or nearly. The largest angle
        between the torso's vertical and the world's [rad].
    """
    import mujoco

    spec = build_spec(body, 0, replace(Physics(), timestep=_STEP))
    for geom in spec.geoms:
        if geom.parent.name not in ("world", "torso"):
            geom.margin = geom.gap = CLEARANCE  # a contact without a force
    model = spec.compile()
    data, torso = mujoco.MjData(model), model.body("torso").id
    touched, cosine = 0, 1.0
    steps = round(period / _STEP)
    for before, command in pairwise(commands):
        for share in np.arange(1, steps + 1) / steps:
            data.ctrl[:] = before + share * (command - before)
            mujoco.mj_step(model, data)
        limbs = model.geom_bodyid[data.contact.geom]
        touched += bool((limbs > torso).any())
        cosine = min(cosine, float(data.xmat[torso, 8]))
    return touched, float(np.arccos(np.clip(cosine, -1, 1)))
