"""Changes of a robot as formulas: what is and a change in, what is then out.

Plants, which simulate damage, and the effects of a diagnosis, which fit it, state a
change by these. Each is exactly the identity where nothing changes.
"""

from collections.abc import Iterable

import numpy as np

from .body import Floats

# share of its mass and inertia that a lost part keeps, as MuJoCo needs some; chosen
LOST_SHARE = 1e-3
AIR_DENSITY = 1.2  # [kg/m^3] at sea level and 20 C


def list_subtree(parents: Iterable[int], root: int) -> list[int]:
    """A node of a tree and all its descendants, in order.

    Args:
        parents: the parent of each node, which comes before it.
    """
    found = {root}
    for node, parent in enumerate(parents):
        if int(parent) in found:
            found.add(node)
    return sorted(found)


def compute_direction(azimuth: float) -> Floats:
    """(2) horizontal unit vector of an azimuth [rad], from +x toward +y [1]."""
    return np.array([np.cos(azimuth), np.sin(azimuth)])


def tilt_gravity(gravity: Floats, tilt: float, downhill: Floats) -> Floats:
    """Gravity in the frame of a ground that slopes.

        g' = |g| (sin(tilt) downhill - cos(tilt) up),  up = -g / |g|

    Args:
        gravity: (3) on level ground [m/s^2].
        tilt: of the ground [rad].
        downhill: (3) unit vector across `gravity` [1].

    Returns:
        (3) gravity [m/s^2].
    """
    size = np.linalg.norm(gravity)
    up = -np.asarray(gravity) / size
    return size * (np.sin(tilt) * downhill - np.cos(tilt) * up)


def limit_rate(goals: Floats, most: Floats, start: Floats) -> Floats:
    """Follow goals with steps of limited size.

        s(k) = s(k-1) + clip(goal(k) - s(k-1), -most, most)

    Args:
        goals: (T, ...) one a step.
        most: (...) largest change in a step, in units of the goals.
        start: (...) before the first step.

    Returns:
        (T, ...) what is reached in each step.
    """
    least, state = -most, start
    out = np.empty((len(goals), *np.broadcast_shapes(goals.shape[1:], most.shape)))
    for k, goal in enumerate(goals):
        # np.clip takes ten times as long
        state = state + np.minimum(np.maximum(goal - state, least), most)
        out[k] = state
    return out


def follow_with_play(motor: Floats, play: Floats, start: Floats) -> Floats:
    """Follow a motor with play: what it drags stays until half the play is used up.

        q(k) = clip(q(k-1), motor(k) - play / 2, motor(k) + play / 2)

    Args:
        motor: (T, ...) angles of the motor, one a step [rad].
        play: (...) total width [rad].
        start: (...) angles of what it drags before the first step [rad].

    Returns:
        (T, ...) angles of what it drags [rad].
    """
    half, state = play / 2, start
    out = np.empty_like(motor)
    for k, angle in enumerate(motor):
        state = np.clip(state, angle - half, angle + half)
        out[k] = state
    return out
