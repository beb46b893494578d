"""A posed body and what its sensors say, compiled with numba; see `channels`.

After a change here, clear numba's caches, as after one in `_hull`.
"""

import numba
import numpy as np

from ..body.body import GRAVITY
from ._hull import JIT
from .channels import MAX_CLEARANCE, TOUCH_HEIGHT


@numba.njit(inline="always", **JIT)
def _write_rotation(axis, c, s, out):
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
def compute_swing(q, steps):
    """(steps, P, 2) cosine and sine of joint angles from 0 to q (P) in sub-steps."""
    swing = np.empty((steps, q.shape[0], 2))
    for step in range(1, steps + 1):
        for i in range(q.shape[0]):
            angle = q[i] * step / steps
            swing[step - 1, i, 0], swing[step - 1, i, 1] = np.cos(angle), np.sin(angle)
    return swing


@numba.njit(**JIT)
def _place_parts(body, swing, frames, spots):
    """Fill in rotations and origins of torso and parts, in the torso's frame."""
    parent, anchor, mount, axis = body[0], body[1], body[2], body[3]
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


@numba.njit(**JIT)
def pose_body(body, known, swing, points, com, frames, spots):
    """Fill in points of contact and center of mass of a body, in the torso's frame.

    Args:
        body: fields of one body, see `_settle.settle_batch`.
        swing: (P, 2) cosine and sine of the joint angles.
        points: (3, 8 + 10 P) to fill, the torso's corners first [m].
        com: (3) to fill: center of mass [m].
        frames: (P + 1, 3, 3) to fill: rotations of torso and parts.
        spots: (P + 1, 3) to fill: their origins [m].

    Returns:
        How many points there are.
    """
    parent, anchor, mount, axis, length, thickness, mass = body
    torso_half, torso_mass, block_half, block_center, block_mass = known
    _place_parts(body, swing, frames, spots)
    p = parent.shape[0]
    for i in range(3):
        com[i] = 0.0
    total = torso_mass
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
def _measure_torque(body, known, part, frames, spots):
    """Torque that gravity has a joint of a bolted robot hold [N m]."""
    parent, anchor, mount, axis, length, thickness, mass = body
    block_center, block_mass = known[3], known[4]
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
            along += frames[part, r, c] * axis[part - 1, c]
        held += along * (tx if r == 0 else ty)
    return GRAVITY * held


@numba.njit(**JIT)
def sense(body, known, radius, channels, height, posed, out):
    """Fill in what the sensors of a posed body say.

    Args:
        body: fields of one body, see `_settle.settle_batch`.
        radius: (P) [m].
        channels: code, part and axis (C) each, of `channels.Channels`.
        height: of the torso's center above the floor [m].
        posed: frames (P + 1, 3, 3) and origins (P + 1, 3) [m] of the torso and its
            parts in the torso's frame, and up (3) there.
        out: (C) to fill.
    """
    frames, spots, n = posed
    code, part, axis = channels
    for c in range(code.shape[0]):
        k = part[c]
        if code[c] == 0:
            x = n[0] if axis[c] else -n[1]
            out[c] = np.degrees(np.arcsin(min(1.0, max(-1.0, x))))
        elif code[c] == 1:
            clear = height / n[2] - known[0][2] if n[2] > 1e-3 else MAX_CLEARANCE
            out[c] = 1000.0 * max(0.0, min(clear, MAX_CLEARANCE))
        elif code[c] == 2:
            tip = height - radius[k - 1] * body[5][k - 1]
            for r in range(3):
                tip += n[r] * (spots[k, r] + body[4][k - 1] * frames[k, r, 0])
            out[c] = 1.0 if tip < TOUCH_HEIGHT else 0.0
        elif code[c] == 3:
            x = 0.0
            for r in range(3):
                x += n[r] * frames[k, r, axis[c]]
            out[c] = np.degrees(x)
        elif code[c] == 4:
            r = axis[c]
            out[c] = 1000.0 * (spots[k, r] + body[4][k - 1] * frames[k, r, 0])
        else:
            out[c] = _measure_torque(body, known, k, frames, spots)


@numba.njit(**JIT)
def sense_batch(
    parent, anchor, mount, axis, length, thickness, mass, known, radius, q, up, height,
    channels, out,
):  # fmt: skip
    """What the sensors of N bodies say in poses that an engine found.

    Args:
        parent: (N, P) and the following ones as `_settle.settle_batch` takes them.
        anchor: (N, P, 3).
        mount: (N, P, 3, 3).
        axis: (N, P, 3).
        length: (N, P).
        thickness: (N, P).
        mass: (N, P).
        radius: (P).
        q: (N, P) joint angles reached [rad].
        up: (N, 3) in the torso's frame.
        height: (N) of the torso's center above the floor [m].
        channels: code, part and axis (C) each, of `channels.Channels`.
        out: (N, C) to fill.
    """
    p = q.shape[1]
    points, com = np.empty((3, 8 + 10 * p)), np.empty(3)
    frames, spots = np.empty((p + 1, 3, 3)), np.empty((p + 1, 3))
    for row in range(q.shape[0]):
        body = (
            parent[row], anchor[row], mount[row], axis[row], length[row],
            thickness[row], mass[row],
        )  # fmt: skip
        swing = compute_swing(q[row], 1)[0]
        pose_body(body, known, swing, points, com, frames, spots)
        posed = frames, spots, up[row]
        sense(body, known, radius, channels, height[row], posed, out[row])
