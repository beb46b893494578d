"""Quasi-static settling of one posed body on a floor, compiled with numba.

A body at rest on a frictionless floor sits in a local minimum of its center of mass's
height H(n) = max_k(r_k - n . (p_k - c)), the support function of its hull of spheres
(points p_k, radii r_k) over the direction n of "up" in the torso's frame. While its
contacts do not carry the center of mass it tips about the nearest point of their hull
to the next contact, an exact rotation each. Joints move in sub-steps, each settled from
the last one's rest.
"""

import numba
import numpy as np

from ._hull import JIT, find_nearest_on_hull
from ._sense import compute_swing, pose_body, sense
from .channels import MAX_CLEARANCE
from .losses import compute_loss

_CONTACT_TOLERANCE = 1e-5  # [m] points within this of the floor are contacts; chosen
_MOST_TIPS = 60  # at most this many tips a sub-step; chosen (2 on average)


@numba.njit(**JIT)
def _find_contacts(points, radii, com, m, n, heights, e1, e2, touching, flat):
    """Fill in what touches a floor whose normal is n; returns H(n) and how many.

    Heights of the center of mass above each point, axes e1 and e2 of the floor, the
    touching points and where they lie on these axes, seen from the center of mass.
    """
    lift = n[0] * com[0] + n[1] * com[1] + n[2] * com[2]
    n0, n1, n2 = n[0], n[1], n[2]
    x, y, z = points[0], points[1], points[2]
    for k in range(m):
        heights[k] = (radii[k] + lift) - (n0 * x[k] + n1 * y[k] + n2 * z[k])
    height = -1e30
    for k in range(m):
        if heights[k] > height:
            height = heights[k]
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


@numba.njit(**JIT)
def _plan_rotation(points, com, n, e1, e2, touching, flat, simplex, size, base, v):
    """Fill in the rotation n(t) = base + (n - base) cos t + v sin t that tips the body.

    About one contact point (size 1) or the edge between two (size 2), such that the
    center of mass gets lower.
    """
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


@numba.njit(**JIT)
def _find_next_contact(points, radii, m, n, i0, base, v, heights, height, turns):
    """The first other point to touch: gap(t) = g - a cos t - b sin t falls to zero.

    Fills in `turns`: cosine and sine of the angle at which each point touches, and its
    place in the order of touching, 2 and more where it does not. Without branches, the
    loop takes several points at a time. Returns the point, -1 where there is none.
    """
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
def _tip_over(points, radii, com, m, n, heights, touching, flat, simplex, turns):
    """Tip in place until the contacts carry the center of mass. Returns H(n)."""
    base, v, e1, e2 = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    height = 0.0
    for _ in range(_MOST_TIPS):
        height, count = _find_contacts(
            points, radii, com, m, n, heights, e1, e2, touching, flat
        )
        if count == 0:  # not a number
            return np.nan
        size = find_nearest_on_hull(flat, count, simplex)
        if size == 3:
            return height
        _plan_rotation(points, com, n, e1, e2, touching, flat, simplex, size, base, v)
        i0 = touching[simplex[0]]
        first = _find_next_contact(
            points, radii, m, n, i0, base, v, heights, height, turns
        )
        if first < 0:
            return height
        ct, st, s = turns[0, first], turns[1, first], 0.0
        for r in range(3):
            n[r] = base[r] + (n[r] - base[r]) * ct + v[r] * st
            s += n[r] ** 2
        s = 1.0 / np.sqrt(s)
        for r in range(3):
            n[r] *= s
    return height


@numba.njit(**JIT)
def _fill_contact_spheres(known, radius, thickness, points, radii):
    """Fill in the torso's corners and all contact spheres' radii; returns how many."""
    torso_half, block_mass = known[0], known[4]
    for corner in range(8):
        points[0, corner] = torso_half[0] * (1 if corner & 1 else -1)
        points[1, corner] = torso_half[1] * (1 if corner & 2 else -1)
        points[2, corner] = torso_half[2] * (1 if corner & 4 else -1)
        radii[corner] = 0.0
    k = 8
    for i in range(radius.shape[0]):
        radii[k] = radii[k + 1] = radius[i] * thickness[i]
        k += 2
        if block_mass[i] > 0.0:
            radii[k : k + 8] = 0.0
            k += 8
    return k


@numba.njit(**JIT)
def _allocate_scratch(p):
    """Room for the contact radii, and the `work` of `settle`, of a body of p parts."""
    size = 8 + 10 * p
    points, com, radii = np.empty((3, size)), np.empty(3), np.empty(size)
    frames, spots = np.empty((p + 1, 3, 3)), np.empty((p + 1, 3))
    heights, touching = np.empty(size), np.empty(size, np.int64)
    flat, simplex = np.empty((size, 2)), np.empty(2, np.int64)
    n, turns = np.empty(3), np.empty((3, size))
    work = (points, com, frames, spots, heights, touching, flat, simplex, n, turns)
    return radii, work


@numba.njit(**JIT)
def _settle_pose(radii, m, work):
    """Tip a posed body of m contact points over; the torso's height above the floor."""
    points, com, _, _, heights, touching, flat, simplex, n, turns = work
    height = _tip_over(
        points, radii, com, m, n, heights, touching, flat, simplex, turns
    )
    return height - (n[0] * com[0] + n[1] * com[1] + n[2] * com[2])


@numba.njit(**JIT)
def settle_body(body, known, swing, falls, radii, work):
    """Settle one body while its joints move from 0 to their targets in sub-steps.

    Args:
        body: fields of one body, see `settle_batch`.
        swing: (steps, P, 2) cosine and sine of its joint angles after each sub-step.
        falls: whether it settles; else it is bolted down, and only posed.
        radii: (8 + 10 P) radius of each contact point, the torso's corners first [m].
        work: arrays of `_allocate_scratch`; the vertical is left in it.

    Returns:
        Height of the torso's center above the floor [m].
    """
    points, com, frames, spots, n = work[0], work[1], work[2], work[3], work[8]
    n[0], n[1], n[2] = 0.0, 0.0, 1.0
    height = 0.0
    if not falls:  # it stands as it is put
        pose_body(body, known, swing[-1], points, com, frames, spots)
        return known[0][2]
    for step in range(swing.shape[0]):
        m = pose_body(body, known, swing[step], points, com, frames, spots)
        height = _settle_pose(radii, m, work)
    return height


@numba.njit(**JIT)
def settle_batch(
    parent, anchor, mount, axis, length, thickness, mass, known, radius, q, steps, out
):
    """Settle N posed bodies; row i of every array is one simulation.

    Args:
        parent: (N, P) of each part, 0 for the torso.
        anchor: (N, P, 3) the joint in the parent's frame [m].
        mount: (N, P, 3, 3) rotation at the joint, see `body.compute_mounts`.
        axis: (N, P, 3) unit hinge axis in the part's frame.
        length: (N, P) [m].
        thickness: (N, P) factor on a part's radius and housing [1].
        mass: (N, P) of the capsule [kg].
        radius: (P) [m].
        q: (N, P) joint angles after the ramp [rad].
        out: (N, 4 + P) to fill: up in the torso's frame (3), height of the torso's
            center (1) [m], height of each part's lowest tip point (P) [m].
    """
    p = q.shape[1]
    radii, work = _allocate_scratch(p)
    points, frames, spots, n = work[0], work[2], work[3], work[8]
    for row in range(q.shape[0]):
        body = (
            parent[row], anchor[row], mount[row], axis[row], length[row],
            thickness[row], mass[row],
        )  # fmt: skip
        _fill_contact_spheres(known, radius, thickness[row], points, radii)
        swing = compute_swing(q[row], max(steps, 1))
        height = settle_body(body, known, swing, steps > 0, radii, work)
        for r in range(3):
            out[row, r] = n[r]
        out[row, 3] = height
        for i in range(p):
            tip = height - radius[i] * thickness[row, i]
            for r in range(3):
                tip += n[r] * (spots[i + 1, r] + length[row, i] * frames[i + 1, r, 0])
            out[row, 4 + i] = tip


@numba.njit(**JIT)
def _turn_as_felt(felt, channels, n):
    """Turn up, n, to where the torso's tilts say it is; returns whether they do.

    A belly that is near the floor is above it; without a clearance up keeps its half.
    """
    code, _, axis = channels
    found = 0
    for c in range(code.shape[0]):
        if code[c] == 0 and not np.isnan(felt[c]):
            along = np.sin(np.radians(felt[c]))
            if axis[c]:
                n[0] = along
            else:
                n[1] = -along
            found += 1
        elif code[c] == 1 and not np.isnan(felt[c]):
            n[2] = 1.0 if felt[c] < 500.0 * MAX_CLEARANCE else -1.0
    flat = n[0] ** 2 + n[1] ** 2
    if flat > 1.0:
        n[0], n[1], flat = n[0] / np.sqrt(flat), n[1] / np.sqrt(flat), 1.0
    n[2] = np.sqrt(1.0 - flat) if n[2] > 0.0 else -np.sqrt(1.0 - flat)
    return found == 2


@numba.njit(**JIT)
def race_batch(
    parent, anchor, mount, axis, length, thickness, mass, known, radius,
    targets, felt, weight, cap, other_rest, order, bound, steps, channels, each,
):  # fmt: skip
    """Settle each body under one action after the other until its loss is too high.

    Args:
        parent: (N, P) of each part, 0 for the torso.
        anchor: (N, P, 3) the joint in the parent's frame [m].
        mount: (N, P, 3, 3) rotation at the joint, see `body.compute_mounts`.
        axis: (N, P, 3) unit hinge axis in the part's frame.
        length: (N, P) [m].
        thickness: (N, P) factor on a part's radius and housing [1].
        mass: (N, P) of the capsule [kg].
        radius: (P) [m].
        targets: (n, P) joint targets of the actions [rad].
        felt: (n, C) channels measured; NaN = unknown.
        weight: (C) of the loss sum_c weight_c min(|gap_c|, cap_c).
        cap: (C) of the same.
        other_rest: (N) loss of a pose that the body rests in, too, though it comes to
            another; what it misses there is added.
        order: (N, n) of the actions, first to last to be tried.
        bound: (N, n) a body is given up once its loss reaches this before the first,
            second, ... action in its order.
        channels: code, part and axis (C) each, of `channels.Channels`.
        each: (N, n) to fill: the loss under each action, NaN where not simulated,
            infinite where the simulation failed.
    """
    radii, work = _allocate_scratch(targets.shape[1])
    points, n, seen = work[0], work[8], np.empty(felt.shape[1])
    posed, count = (work[2], work[3], n), targets.shape[0]
    swing = np.empty((count, max(steps, 1), targets.shape[1], 2))
    for k in range(count):
        swing[k] = compute_swing(targets[k], max(steps, 1))
    each[:] = np.nan
    for row in range(bound.shape[0]):
        body = (
            parent[row], anchor[row], mount[row], axis[row], length[row],
            thickness[row], mass[row],
        )  # fmt: skip
        m = _fill_contact_spheres(known, radius, thickness[row], points, radii)
        total = 0.0
        for k in range(count):
            if not total < bound[row, k]:
                break
            action = order[row, k]
            height = settle_body(body, known, swing[action], steps > 0, radii, work)
            sense(body, known, radius, channels, height, posed, seen)
            loss = compute_loss(seen, felt[action], weight, cap)
            if not np.isfinite(height + n[0] + n[1] + n[2]):
                loss = np.inf
            elif loss > other_rest[row] and _turn_as_felt(felt[action], channels, n):
                height = _settle_pose(radii, m, work)
                sense(body, known, radius, channels, height, posed, seen)
                put = compute_loss(seen, felt[action], weight, cap)
                loss = min(loss, other_rest[row] + put)
            each[row, action] = loss
            total += loss
