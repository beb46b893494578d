"""Quasi-static settling of one posed body on a floor, compiled with numba.

A body at rest on a frictionless floor sits in a local minimum of its center of mass's
height H(n) = max_k(r_k - n . (p_k - c)), the support function of its hull of spheres
(points p_k, radii r_k) over the direction n of "up" in the torso's frame. While its
contacts do not carry the center of mass it tips about the nearest point of their hull
to the next contact, an exact rotation each. Joints move in sub-steps, each settled from
the last one's rest.
"""

from typing import NamedTuple

import numba
import numpy as np

from ..body.body import Floats, Ints
from ._hull import JIT, find_nearest_on_hull
from ._sense import Pose, allocate_pose, compute_swing, pose_body, sense, take_body
from .arrays import BodyArrays, Race, RobotArrays
from .channels import MAX_CLEARANCE, Loss
from .losses import compute_loss

_CONTACT_TOLERANCE = 1e-5  # [m] points within this of the floor are contacts; chosen
_MOST_TIPS = 60  # at most this many tips a sub-step; chosen (2 on average)


class Contacts(NamedTuple):
    """What a body of K contact points touches, and how it tips; arrays to fill.

    Attributes:
        radii: (K) [m].
        heights: (K) of the center of mass above each point, were it on the floor [m].
        touching: (K) the points that touch, first.
        flat: (K, 2) where these lie on the floor, seen from the center of mass [m].
        simplex: (2) rows of `flat` that carry the point nearest to it.
        e1: (3) axis of the floor, and
        e2: (3) across it.
        base: (3), and
        v: (3) of the rotation n(t) = base + (n - base) cos t + v sin t.
        turns: (3, K) cosine and sine of the angle at which each point touches, and its
            place in the order of touching, 2 and more where it does not.
    """

    radii: Floats
    heights: Floats
    touching: Ints
    flat: Floats
    simplex: Ints
    e1: Floats
    e2: Floats
    base: Floats
    v: Floats
    turns: Floats


@numba.njit(**JIT)
def _allocate_contacts(k: int) -> Contacts:
    """Room for k contact points."""
    radii, heights, touching = np.empty(k), np.empty(k), np.empty(k, np.int64)
    flat, simplex, turns = np.empty((k, 2)), np.empty(2, np.int64), np.empty((3, k))
    e1, e2, base, v = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    return Contacts(radii, heights, touching, flat, simplex, e1, e2, base, v, turns)


@numba.njit(inline="always", **JIT)
def _find_contacts(pose: Pose, contacts: Contacts, m: int) -> tuple[float, int]:
    """Fill in what of m points touches the floor; returns H(n) and how many do."""
    points, com, n = pose.points, pose.com, pose.up
    radii, heights = contacts.radii, contacts.heights
    touching, flat = contacts.touching, contacts.flat
    e1, e2 = contacts.e1, contacts.e2
    lift = n[0] * com[0] + n[1] * com[1] + n[2] * com[2]
    n0, n1, n2 = n[0], n[1], n[2]
    x, y, z = points[0], points[1], points[2]
    for k in range(m):
        heights[k] = (radii[k] + lift) - (n0 * x[k] + n1 * y[k] + n2 * z[k])
    height = -1e30
    for k in range(m):
        # numba's max would keep what is not a number
        height = heights[k] if heights[k] > height else height
    if abs(n[2]) < 0.7:
        e1[0], e1[1], e1[2] = n[1], -n[0], 0.0
    else:
        e1[0], e1[1], e1[2] = 0.0, n[2], -n[1]
    s = 1.0 / np.sqrt(e1[0] ** 2 + e1[1] ** 2 + e1[2] ** 2)
    for r in range(3):
        e1[r] *= s
    e2[0] = n[1] * e1[2] - n[2] * e1[1]
    e2[1] = n[2] * e1[0] - n[0] * e1[2]
    e2[2] = n[0] * e1[1] - n[1] * e1[0]
    c = 0
    for k in range(m):
        if heights[k] > height - _CONTACT_TOLERANCE:
            touching[c] = k
            flat[c, 0] = flat[c, 1] = 0.0
            for r in range(3):
                d = points[r, k] - com[r]
                flat[c, 0] += d * e1[r]
                flat[c, 1] += d * e2[r]
            c += 1
    return height, c


@numba.njit(inline="always", **JIT)
def _plan_rotation(pose: Pose, contacts: Contacts, size: int) -> None:
    """Fill in the rotation that tips the body such that the center of mass gets lower.

    About one contact point (size 1) or the edge between two (size 2).
    """
    points, com, n = pose.points, pose.com, pose.up
    e1, e2 = contacts.e1, contacts.e2
    touching, flat, simplex = contacts.touching, contacts.flat, contacts.simplex
    base, v = contacts.base, contacts.v
    i0 = touching[simplex[0]]
    if size == 1:
        px, py = flat[simplex[0], 0], flat[simplex[0], 1]
        s = 1.0 / np.sqrt(px * px + py * py)
        for r in range(3):
            base[r] = 0.0
            v[r] = (px * e1[r] + py * e2[r]) * s
        return
    i1 = touching[simplex[1]]
    dd, dn = 0.0, 0.0
    for r in range(3):
        base[r] = points[r, i1] - points[r, i0]
        dd += base[r] ** 2
    s = 1.0 / np.sqrt(dd)
    for r in range(3):
        base[r] *= s
        dn += base[r] * n[r]
    v[0] = base[1] * n[2] - base[2] * n[1]
    v[1] = base[2] * n[0] - base[0] * n[2]
    v[2] = base[0] * n[1] - base[1] * n[0]
    rise = 0.0
    for r in range(3):
        rise += v[r] * (points[r, i0] - com[r])
        base[r] *= dn
    if rise < 0.0:
        for r in range(3):
            v[r] = -v[r]


@numba.njit(inline="always", **JIT)
def _find_next_contact(pose: Pose, contacts: Contacts, m: int, height: float) -> int:
    """The first other point to touch: gap(t) = g - a cos t - b sin t falls to zero.

    Fills in `turns`. Without branches, the loop takes several points at a time.
    Returns the point, -1 where there is none.
    """
    points, n, radii, heights = pose.points, pose.up, contacts.radii, contacts.heights
    base, v, turns = contacts.base, contacts.v, contacts.turns
    i0 = contacts.touching[contacts.simplex[0]]
    x, y, z = points[0], points[1], points[2]
    cosine, sine, order = turns[0], turns[1], turns[2]
    wx, wy, wz = n[0] - base[0], n[1] - base[1], n[2] - base[2]
    vx, vy, vz = v[0], v[1], v[2]
    bx, by, bz = base[0], base[1], base[2]
    x0, y0, z0, r0 = x[i0], y[i0], z[i0], radii[i0]
    for j in range(m):
        dx, dy, dz = x0 - x[j], y0 - y[j], z0 - z[j]
        a = wx * dx + wy * dy + wz * dz
        b = vx * dx + vy * dy + vz * dz
        g = r0 - radii[j] - bx * dx - by * dy - bz * dz
        norm2 = a * a + b * b
        # t = atan2(b, a) - acos(g / norm) is the root where the gap closes
        root = np.sqrt(max(norm2 - g * g, 0.0))
        cj, sj = (a * g + b * root) / norm2, (b * g - a * root) / norm2
        cosine[j], sine[j] = cj, sj
        grows = 1.0 - cj if sj >= 0.0 else 3.0 + cj  # with t in [0, 2 pi)
        order[j] = 9.0 if norm2 <= g * g or norm2 < 1e-18 else grows
    first, least = -1, 2.0
    for j in range(m):
        if order[j] < least:
            if order[j] < 1e-12 and heights[j] > height - _CONTACT_TOLERANCE:
                continue  # already touching, and rolling along
            first, least = j, order[j]
    return first


@numba.njit(**JIT)
def _settle_pose(pose: Pose, contacts: Contacts, m: int) -> float:
    """Tip a posed body of m contact points until its contacts carry it.

    Returns the height of the torso's center above the floor [m].
    """
    com, n, turns = pose.com, pose.up, contacts.turns
    base, v = contacts.base, contacts.v
    height = 0.0
    for _ in range(_MOST_TIPS):
        height, count = _find_contacts(pose, contacts, m)
        if count == 0:  # not a number
            return np.nan
        size = find_nearest_on_hull(contacts.flat, count, contacts.simplex)
        if size == 3:
            break
        _plan_rotation(pose, contacts, size)
        first = _find_next_contact(pose, contacts, m, height)
        if first < 0:
            break
        ct, st, s = turns[0, first], turns[1, first], 0.0
        for r in range(3):
            n[r] = base[r] + (n[r] - base[r]) * ct + v[r] * st
            s += n[r] ** 2
        s = 1.0 / np.sqrt(s)
        for r in range(3):
            n[r] *= s
    return height - (n[0] * com[0] + n[1] * com[1] + n[2] * com[2])


@numba.njit(**JIT)
def _fill_contact_spheres(
    body: BodyArrays, robot: RobotArrays, pose: Pose, radii: Floats
) -> int:
    """Fill in the torso's corners and all contact spheres' radii; returns how many."""
    points, torso_half, radius = pose.points, robot.torso_half, robot.radius
    for corner in range(8):
        points[0, corner] = torso_half[0] * (1 if corner & 1 else -1)
        points[1, corner] = torso_half[1] * (1 if corner & 2 else -1)
        points[2, corner] = torso_half[2] * (1 if corner & 4 else -1)
        radii[corner] = 0.0
    k = 8
    for i in range(radius.shape[0]):
        radii[k] = radii[k + 1] = radius[i] * body.thickness[i]
        k += 2
        if robot.block_mass[i] > 0.0:
            radii[k : k + 8] = 0.0
            k += 8
    return k


@numba.njit(**JIT)
def _settle_body(
    body: BodyArrays,
    robot: RobotArrays,
    swing: Floats,
    pose: Pose,
    contacts: Contacts,
) -> float:
    """Settle one body while its joints move from 0 to their targets in sub-steps.

    Args:
        swing: (steps, P, 2) cosine and sine of its joint angles after each sub-step.

    Returns:
        Height of the torso's center above the floor [m].
    """
    n, height = pose.up, robot.torso_half[2]
    n[0], n[1], n[2] = 0.0, 0.0, 1.0
    for step in range(swing.shape[0]):
        m = pose_body(body, robot, swing[step], pose)
        if robot.substeps > 0:  # else it is bolted down, and stands as it is put
            height = _settle_pose(pose, contacts, m)
    return height


@numba.njit(**JIT)
def settle_batch(
    bodies: BodyArrays, robot: RobotArrays, q: Floats, out: Floats
) -> None:
    """Settle N posed bodies; row i of every array is one simulation.

    Args:
        q: (N, P) joint angles after the ramp [rad].
        out: (N, 4 + P) to fill: up in the torso's frame (3), height of the torso's
            center (1) [m], height of each part's lowest tip point (P) [m].
    """
    p = q.shape[1]
    pose, contacts = allocate_pose(p), _allocate_contacts(8 + 10 * p)
    spots, frames, n = pose.spots, pose.frames, pose.up
    for row in range(q.shape[0]):
        body = take_body(bodies, row)
        _fill_contact_spheres(body, robot, pose, contacts.radii)
        swing = compute_swing(q[row], max(robot.substeps, 1))
        height = _settle_body(body, robot, swing, pose, contacts)
        out[row, :3] = n
        out[row, 3] = height
        for i in range(p):
            tip = height - robot.radius[i] * body.thickness[i]
            for r in range(3):
                tip += n[r] * (spots[i + 1, r] + body.length[i] * frames[i + 1, r, 0])
            out[row, 4 + i] = tip


@numba.njit(**JIT)
def _turn_as_measured(measured: Floats, robot: RobotArrays, n: Floats) -> bool:
    """Turn up, n, to where the torso's tilts say it is; returns whether they do.

    A belly that is near the floor is above it; without a clearance up keeps its half.
    """
    code, axis = robot.code, robot.channel_axis
    found = 0
    for c in range(code.shape[0]):
        if code[c] == 0 and not np.isnan(measured[c]):
            along = np.sin(np.radians(measured[c]))
            if axis[c]:
                n[0] = along
            else:
                n[1] = -along
            found += 1
        elif code[c] == 1 and not np.isnan(measured[c]):
            n[2] = 1.0 if measured[c] < 500.0 * MAX_CLEARANCE else -1.0
    flat = n[0] ** 2 + n[1] ** 2
    if flat > 1.0:
        n[0], n[1], flat = n[0] / np.sqrt(flat), n[1] / np.sqrt(flat), 1.0
    n[2] = np.sqrt(1.0 - flat) if n[2] > 0.0 else -np.sqrt(1.0 - flat)
    return found == 2


@numba.njit(**JIT)
def race_batch(
    bodies: BodyArrays,
    robot: RobotArrays,
    tried: tuple[Floats, Floats],
    loss: Loss,
    race: Race,
    each: Floats,
) -> None:
    """Settle each body under one action after the other until its loss is too high.

    Args:
        tried: (n, P) joint targets of the actions [rad], and (n, C) channels measured;
            NaN = unknown.
        each: (N, n) to fill: the loss under each action, NaN where not simulated,
            infinite where the simulation failed.
    """
    targets, measured = tried
    count, p = targets.shape
    pose, contacts = allocate_pose(p), _allocate_contacts(8 + 10 * p)
    n, seen, steps = pose.up, np.empty(measured.shape[1]), max(robot.substeps, 1)
    swing = np.empty((count, steps, p, 2))
    for k in range(count):
        swing[k] = compute_swing(targets[k], steps)
    each[:] = np.nan
    for row in range(each.shape[0]):
        body, rest = take_body(bodies, row), race.other_rest[row]
        m = _fill_contact_spheres(body, robot, pose, contacts.radii)
        total = 0.0
        for k in range(count):
            action = race.order[row, k]
            height = _settle_body(body, robot, swing[action], pose, contacts)
            sense(body, robot, pose, height, seen)
            gap = compute_loss(seen, measured[action], loss)
            if not np.isfinite(height + n[0] + n[1] + n[2]):
                gap = np.inf
            elif gap > rest and _turn_as_measured(measured[action], robot, n):
                height = _settle_pose(pose, contacts, m)
                sense(body, robot, pose, height, seen)
                gap = min(gap, rest + compute_loss(seen, measured[action], loss))
            each[row, action] = gap
            total += gap
            if not total < race.bound[row, k]:
                break
