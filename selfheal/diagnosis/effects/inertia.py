"""Mass and shape of a body of a compiled model: takes a change, edits the fields."""

from typing import TYPE_CHECKING

import numpy as np

from ...recording.data import Floats

if TYPE_CHECKING:
    from mujoco import MjModel


def spatial_inertia(model: "MjModel", body: int) -> Floats:
    """Inertia (3, 3) [kg m^2] of a body about its center of mass, in its frame."""
    turn = rotation_matrix(model.body_iquat[body])
    return turn @ np.diag(model.body_inertia[body]) @ turn.T


def rotation_matrix(quaternion: Floats) -> Floats:
    """The rotation matrix (3, 3) of a quaternion (4)."""
    import mujoco

    flat = np.empty(9)
    mujoco.mju_quat2Mat(flat, quaternion)
    return flat.reshape(3, 3)


def set_spatial_inertia(
    model: "MjModel", body: int, mass: float, com: Floats, inertia: Floats
) -> None:
    """Give a body a mass, a center of mass and an inertia.

    Args:
        mass: of the body [kg].
        com: (3) center of mass in the body's frame [m].
        inertia: (3, 3) about the center of mass, in the body's frame [kg m^2].
    """
    import mujoco

    old = model.body_iquat[body].copy()
    turn = rotation_matrix(old)
    moments, further = _principal_axes(turn.T @ inertia @ turn)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, further.ravel())
    mujoco.mju_mulQuat(model.body_iquat[body], old, quaternion)
    model.body_mass[body] = mass
    model.body_ipos[body] = com
    model.body_inertia[body] = np.maximum(moments, 1e-12)
    model.body_sameframe[body] = 0


def _principal_axes(inertia: Floats) -> tuple[Floats, Floats]:
    """Principal moments (3) of an inertia, and their axes (3, 3) in its frame.

    By the rotations of Jacobi (1846), none beyond 45 degrees: axes that are principal
    already stay, also where two moments are equal and any axes would do.
    """
    turned, axes = inertia, np.eye(3)
    for p, q in 8 * ((0, 1), (0, 2), (1, 2)):
        apart, product = turned[p, p] - turned[q, q], turned[p, q]
        if abs(product) <= 1e-13 * np.trace(inertia):  # rounding
            continue
        angle = 0.5 * np.arctan2(2 * np.copysign(product, product * apart), abs(apart))
        turn = np.eye(3)
        turn[p, p] = turn[q, q] = np.cos(angle)
        turn[q, p], turn[p, q] = np.sin(angle), -np.sin(angle)
        turned, axes = turn.T @ turned @ turn, axes @ turn
    return np.diag(turned), axes


def point_inertia(mass: float, at: Floats) -> Floats:
    """Inertia (3, 3) [kg m^2] of a point mass [kg] at (3) [m], about the origin."""
    return mass * (at @ at * np.eye(3) - np.outer(at, at))


def add_mass(model: "MjModel", body: int, mass: float, at: Floats) -> None:
    """Fix a point mass to a body, by Steiner's theorem.

    Args:
        mass: of the point [kg].
        at: (3) in the body's frame [m].
    """
    m, c = float(model.body_mass[body]), model.body_ipos[body].copy()
    total = m + mass
    com = (m * c + mass * at) / total
    inertia = (
        spatial_inertia(model, body)
        + point_inertia(m, c - com)
        + point_inertia(mass, at - com)
    )
    set_spatial_inertia(model, body, total, com, inertia)


def stretch_body(model: "MjModel", body: int, axis: Floats, ratio: float) -> None:
    """Scale a body along an axis: its mass, geoms, sites, and its children's places.

    The mass stays; its second moments scale with the square of the ratio.

    Args:
        axis: (3) unit vector in the body's frame.
    """
    grow = np.eye(3) + (ratio - 1) * np.outer(axis, axis)
    inertia = spatial_inertia(model, body)
    moments = grow @ (np.trace(inertia) / 2 * np.eye(3) - inertia) @ grow
    com = grow @ model.body_ipos[body]
    inertia = np.trace(moments) * np.eye(3) - moments
    set_spatial_inertia(model, body, float(model.body_mass[body]), com, inertia)
    for child in np.flatnonzero(model.body_parentid == body):
        if child != body:
            model.body_pos[child] = grow @ model.body_pos[child]
    for geom in np.flatnonzero(model.geom_bodyid == body):
        model.geom_pos[geom] = grow @ model.geom_pos[geom]
        along_own = np.abs(rotation_matrix(model.geom_quat[geom]).T @ axis)
        if along_own.max() > 0.99:
            _stretch_geom(model, int(geom), int(along_own.argmax()), ratio)
    for site in np.flatnonzero(model.site_bodyid == body):
        model.site_pos[site] = grow @ model.site_pos[site]


def _stretch_geom(model: "MjModel", geom: int, axis: int, ratio: float) -> None:
    """Scale a geom along one of its own axes, where its type has a size along it.

    Args:
        axis: index of the axis in the geom's frame.
    """
    import mujoco

    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        model.geom_size[geom, axis] *= ratio
    elif axis == 2 and kind in (
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        mujoco.mjtGeom.mjGEOM_CYLINDER,
    ):
        model.geom_size[geom, 1] *= ratio
    model.geom_rbound[geom] *= max(ratio, 1.0)
