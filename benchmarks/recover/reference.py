"""The outside reference of recovery: plain MuJoCo and a network, step by step."""

import mujoco
import numpy as np

from selfheal.body.body import Floats
from selfheal.body.legged import HIDDEN, LeggedRobot


def walk_plain(robot: LeggedRobot, weights: Floats, steps: int = 1000) -> float:
    """Forward displacement [m] of a whole robot under a controller, by plain MuJoCo.

    Args:
        weights: (synapses) [1] of the network, inner layer first.
    """
    model = robot.model
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    feet, inputs = robot.feet, len(robot.sensors) + robot.has_bias
    inner = weights[: inputs * HIDDEN].reshape(inputs, HIDDEN)
    outer = weights[inputs * HIDDEN :].reshape(HIDDEN, -1)
    sensed = np.ones(inputs)
    begin = 0.0
    for step in range(steps):
        readings = data.sensordata
        sensed[:feet] = np.where(readings[:feet] > 0, 1.0, -1.0)
        sensed[feet : 2 * feet] = np.clip(readings[feet:] / robot.reach, -1, 1)
        hidden = np.where(sensed @ inner > 0, 1.0, -1.0)
        data.ctrl[:] = robot.reach * np.clip(hidden @ outer, -1, 1)
        mujoco.mj_step(model, data)
        if step == 0:
            begin = data.qpos[0]
    return float(data.qpos[0] - begin)
