"""Readings: what the robot's sensors say at rest, in batches."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..body.body import Bodies, Floats, RowBatch
from .arrays import BodyArrays, pack_robot
from .channels import MAX_CLEARANCE, TOUCH_HEIGHT


@dataclass(frozen=True)
class Readings(RowBatch):
    """Sensor values at rest; every array has the same leading shape B.

    Attributes:
        tilt: (*B, 2) left/right and forward/back tilt [rad]: with u = world vertical
            in the torso's frame, left/right = -asin(u_y), forward/back = asin(u_x).
        clearance: (*B) belly to floor along the torso's z [m].
        touch: (*B, F) 1 where a foot touches the floor, else 0.
        angles: (*B, P) joint angles reached [rad].
        channels: (*B, C) what the robot's sensors say, see `channels.Channels`.
        failed: (*B) True where the simulation diverged; the rest is NaN there.
    """

    tilt: Floats
    clearance: Floats
    touch: Floats
    angles: Floats
    channels: Floats
    failed: np.ndarray


def compute_readings(
    bodies: Bodies,
    packed: BodyArrays,
    up: Floats,
    height: Floats,
    tips: Floats,
    angles: Floats,
) -> Readings:
    """Readings of bodies at rest.

    Args:
        up: (N, 3) world vertical in the torso's frame.
        height: (N) of the torso's center above the floor [m].
        tips: (N, F) height of each foot's lowest point [m].
        angles: (N, P) [rad].
    """
    from ._sense import sense_batch

    up = np.clip(np.asarray(up, float), -1, 1)
    robot, belly = pack_robot(bodies.anatomy, 0), bodies.anatomy.torso_half[2]
    height, tips = np.asarray(height, float), np.asarray(tips, float)
    failed = ~(np.isfinite(up).all(1) & np.isfinite(height) & np.isfinite(tips).all(1))
    with np.errstate(divide="ignore", invalid="ignore"):
        clearance = height / up[:, 2] - belly
    # a robot on its side or back has no floor below its belly: out of range
    clearance = np.where(up[:, 2] > 1e-3, np.minimum(clearance, MAX_CLEARANCE), np.nan)
    clearance = np.where(np.isnan(clearance), MAX_CLEARANCE, np.maximum(clearance, 0))
    tilt = np.stack([-np.arcsin(up[:, 1]), np.arcsin(up[:, 0])], axis=1)
    touch = (tips < TOUCH_HEIGHT).astype(float)
    angles, channels = np.array(angles, float), np.empty((len(up), len(robot.code)))
    up, height = np.ascontiguousarray(up), np.ascontiguousarray(height)
    sense_batch(packed, robot, angles, up, height, channels)
    for values in (tilt, clearance, touch, angles, channels):
        values[failed] = np.nan
    return Readings(tilt, clearance, touch, angles, channels, failed)


class Engine(Protocol):
    """Anything that predicts readings of bodies under joint targets."""

    name: str

    def simulate(self, bodies: Bodies, targets: Floats) -> Readings:
        """Readings (N) of N bodies, each under its own joint targets (N, P) [rad]."""
        ...
