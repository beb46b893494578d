"""A posed body and what its sensors say, compiled with numba; see `channels`.

After a change here, clear numba's caches, as after one in `_hull`.
"""

from typing import NamedTuple

import numba
import numpy as np

from ..body.body import GRAVITY, Floats
from ._hull import JIT
from .arrays import BodyArrays, RobotArrays
from .channels import MAX_CLEARANCE, TOUCH_HEIGHT


class Pose(NamedTuple):
    """A posed body, seen from its torso; arrays to fill.

    Attributes:
        points: (3, 8 + 10 P) contact points [m], the torso's corners first.
        com: (3) center of mass [m].
        frames: (P + 1, 3, 3) rotations of torso and parts.
        spots: (P + 1, 3) their origins [m].
        up: (3) world vertical.
    """

    points: Floats
    com: Floats
    frames: Floats
    spots: Floats
    up: Floats


@numba.njit(**JIT)
def allocate_pose(p: int) -> Pose:
    """Room for the pose of a body of p parts."""
    frames, spots = np.empty((p + 1, 3, 3)), np.empty((p + 1, 3))
    return Pose(np.empty((3, 8 + 10 * p)), np.empty(3), frames, spots, np.empty(3))


@numba.njit(**JIT)
def take_body(b: BodyArrays, row: int) -> BodyArrays:
    """One body of a batch."""
    return BodyArrays(
        b.parent[row],
        b.anchor[row],
        b.mount[row],
        b.axis[row],
        b.length[row],
        b.thickness[row],
        b.mass[row],
    )


@numba.njit(inline="always", **JIT)
def _write_rotation(axis: Floats, c: float, s: float, out: Floats) -> None:
    """Rotation matrix about a unit axis, of an angle's cosine and sine (Rodrigues)."""
    x, y, z = axis[0], axis[1], axis[2]
    d = 1.0 - c
    out[0, 0] = c + x * x * d
    out[0, 1] = x * y * d - z * s
    out[0, 2] = x * z * d + y * s
    out[1, 0] = y * x * d + z * s
    out[1, 1] = c + y * y * d
    out[1, 2] = y * z * d - x * s
    out[2, 0] = z * x * d - y * s
    out[2, 1] = z * y * d + x * s
    out[2, 2] = c + z * z * d


@numba.njit(**JIT)
def compute_swing(q: Floats, steps: int) -> Floats:
    """(steps, P, 2) cosine and sine of joint angles from 0 to q (P) in sub-steps."""
    swing = np.empty((steps, q.shape[0], 2))
    for step in range(1, steps + 1):
        for i in range(q.shape[0]):
            angle = q[i] * step / steps
            swing[step - 1, i, 0], swing[step - 1, i, 1] = np.cos(angle), np.sin(angle)
    return swing


@numba.njit(inline="always", **JIT)
def _place_parts(body: BodyArrays, swing: Floats, pose: Pose) -> None:
    """Fill in rotations and origins of torso and parts, in the torso's frame."""
    parent, anchor, mount, axis = body.parent, body.anchor, body.mount, body.axis
    frames, spots = pose.frames, pose.spots
    p = parent.shape[0]
    for i in range(3):
        spots[0, i] = 0.0
        for j in range(3):
            frames[0, i, j] = 1.0 if i == j else 0.0
    turn, left, known_frame = np.empty((3, 3)), p, np.zeros(p + 1, np.bool_)
    known_frame[0] = True
    for again in range(p * p):  # one round where parents come before their children
        i = again % p
        if left == 0:
            break
        if known_frame[i + 1] or not known_frame[parent[i]]:
            continue
        known_frame[i + 1] = True
        left -= 1
        up = frames[parent[i]]
        at = mount[i]
        _write_rotation(axis[i], swing[i, 0], swing[i, 1], turn)
        own = frames[i + 1]
        for r in range(3):
            ax = up[r, 0] * at[0, 0] + up[r, 1] * at[1, 0] + up[r, 2] * at[2, 0]
            ay = up[r, 0] * at[0, 1] + up[r, 1] * at[1, 1] + up[r, 2] * at[2, 1]
            az = up[r, 0] * at[0, 2] + up[r, 1] * at[1, 2] + up[r, 2] * at[2, 2]
            for c in range(3):
                own[r, c] = ax * turn[0, c] + ay * turn[1, c] + az * turn[2, c]
            spots[i + 1, r] = (
                spots[parent[i], r]
                + up[r, 0] * anchor[i, 0]
                + up[r, 1] * anchor[i, 1]
                + up[r, 2] * anchor[i, 2]
            )


@numba.njit(inline="always", **JIT)
def pose_body(body: BodyArrays, robot: RobotArrays, swing: Floats, pose: Pose) -> int:
    """Fill in a pose, all but up; returns how many contact points there are.

    Args:
        swing: (P, 2) cosine and sine of the joint angles.
    """
    length, thickness, mass = body.length, body.thickness, body.mass
    block_half, block_center = robot.block_half, robot.block_center
    block_mass = robot.block_mass
    points, com, frames, spots = pose.points, pose.com, pose.frames, pose.spots
    _place_parts(body, swing, pose)
    p = length.shape[0]
    for i in range(3):
        com[i] = 0.0
    total = robot.torso_mass
    k = 8  # the torso's corners never move in its own frame
    for i in range(p):
        own = frames[i + 1]
        block = block_mass[i] * thickness[i]
        weight = mass[i] + block
        lever = 0.5 * length[i] * mass[i] + block * block_center[i] * thickness[i]
        total += weight
        for r in range(3):
            com[r] += weight * spots[i + 1, r] + lever * own[r, 0]
            points[r, k] = spots[i + 1, r]
            points[r, k + 1] = spots[i + 1, r] + length[i] * own[r, 0]
        k += 2
        if block_mass[i] > 0.0:
            for corner in range(8):
                x = block_half[i, 0] * (1 if corner & 1 else -1) + block_center[i]
                y = block_half[i, 1] * (1 if corner & 2 else -1)
                z = block_half[i, 2] * (1 if corner & 4 else -1)
                for r in range(3):
                    points[r, k] = spots[i + 1, r] + thickness[i] * (
                        own[r, 0] * x + own[r, 1] * y + own[r, 2] * z
                    )
                k += 1
    for r in range(3):
        com[r] /= total
    return k


@numba.njit(**JIT)
def _measure_torque(
    body: BodyArrays, robot: RobotArrays, part: int, pose: Pose
) -> float:
    """Torque that gravity has a joint of a bolted robot hold [N m]."""
    parent, length = body.parent, body.length
    thickness, mass = body.thickness, body.mass
    block_center, block_mass = robot.block_center, robot.block_mass
    frames, spots = pose.frames, pose.spots
    tx, ty = 0.0, 0.0
    for i in range(parent.shape[0]):
        at = i + 1
        while at not in (0, part):
            at = parent[at - 1]
        if at == part:
            block = block_mass[i] * thickness[i]
            weight = mass[i] + block
            lever = 0.5 * length[i] * mass[i] + block * block_center[i] * thickness[i]
            dx = weight * (spots[i + 1, 0] - spots[part, 0])
            dy = weight * (spots[i + 1, 1] - spots[part, 1])
            tx += dy + lever * frames[i + 1, 1, 0]
            ty -= dx + lever * frames[i + 1, 0, 0]
    held = 0.0
    for r in range(2):
        along = 0.0
        for c in range(3):
            along += frames[part, r, c] * body.axis[part - 1, c]
        held += along * (tx if r == 0 else ty)
    return GRAVITY * held


@numba.njit(**JIT)
def sense(
    body: BodyArrays, robot: RobotArrays, pose: Pose, height: float, out: Floats
) -> None:
    """Fill in what the sensors of a posed body say.

    Args:
        height: of the torso's center above the floor [m].
        out: (C) to fill.
    """
    frames, spots, n = pose.frames, pose.spots, pose.up
    code, part, axis = robot.code, robot.part, robot.channel_axis
    for c in range(code.shape[0]):
        k = part[c]
        if code[c] == 0:
            x = n[0] if axis[c] else -n[1]
            out[c] = np.degrees(np.arcsin(min(1.0, max(-1.0, x))))
        elif code[c] == 1:
            clear = (
                height / n[2] - robot.torso_half[2] if n[2] > 1e-3 else MAX_CLEARANCE
            )
            out[c] = 1000.0 * max(0.0, min(clear, MAX_CLEARANCE))
        elif code[c] == 2:
            tip = height - robot.radius[k - 1] * body.thickness[k - 1]
            for r in range(3):
                tip += n[r] * (spots[k, r] + body.length[k - 1] * frames[k, r, 0])
            out[c] = 1.0 if tip < TOUCH_HEIGHT else 0.0
        elif code[c] == 3:
            x = 0.0
            for r in range(3):
                x += n[r] * frames[k, r, axis[c]]
            out[c] = np.degrees(x)
        elif code[c] == 4:
            r = axis[c]
            out[c] = 1000.0 * (spots[k, r] + body.length[k - 1] * frames[k, r, 0])
        else:
            out[c] = _measure_torque(body, robot, k, pose)


@numba.njit(**JIT)
def sense_batch(
    bodies: BodyArrays,
    robot: RobotArrays,
    q: Floats,
    up: Floats,
    height: Floats,
    out: Floats,
) -> None:
    """What the sensors of N bodies say in poses that an engine found.

    Args:
        q: (N, P) joint angles reached [rad].
        up: (N, 3) in the torso's frame.
        height: (N) of the torso's center above the floor [m].
        out: (N, C) to fill.
    """
    pose = allocate_pose(q.shape[1])
    for row in range(q.shape[0]):
        body = take_body(bodies, row)
        pose_body(body, robot, compute_swing(q[row], 1)[0], pose)
        pose.up[:] = up[row]
        sense(body, robot, pose, height[row], out[row])
