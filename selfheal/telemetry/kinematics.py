"""What positions alone say: takes states, gives readings of sensors and poses."""

from typing import TYPE_CHECKING

import numpy as np

from ..recording.data import Floats
from .states import ColumnMap, States

if TYPE_CHECKING:
    import mujoco

MAX_ROWS = 600  # that are evaluated; chosen: some tens of milliseconds


def predict(
    model: "mujoco.MjModel", states: States, column_map: ColumnMap, rows: np.ndarray
) -> tuple[Floats, Floats, Floats]:
    """Sensor data (n, nsensordata), orientations (nbody, n, 4), places (nbody, n, 3).

    Args:
        model: of the robot, without what stands in the way of its motion.
        states: of the recording.
        column_map: of its columns.
        rows: (n) of the series.
    """
    import mujoco

    data, count = mujoco.MjData(model), len(rows)
    out = np.zeros((count, model.nsensordata))
    turns, places = (np.zeros((model.nbody, count, d)) for d in (4, 3))
    for i, state in enumerate(zip(*states.compute(column_map, rows), strict=True)):
        data.qpos[:], data.qvel[:], data.qacc[:] = state
        mujoco.mj_inverse(model, data)
        out[i], turns[:, i], places[:, i] = data.sensordata, data.xquat, data.xpos
    return out, turns, places
