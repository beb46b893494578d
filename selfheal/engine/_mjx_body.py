"""Bodies as arrays for MJX: rigid parts, contact spheres and their planned motion.

The host turns a batch of `Bodies` into equally shaped arrays, whatever the trees; the
device poses them along the ramp. Arrays of a motion end in its T poses, so that the
arithmetic runs over long rows.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..body.body import Anatomy, Bodies, Floats, Ints

if TYPE_CHECKING:
    from jax import Array

_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)]) * 2.0 - 1


class Parts(NamedTuple):
    """N bodies as arrays; C spheres that may touch the floor, P moving parts.

    Attributes:
        parent: (N, P) as in `Bodies`.
        anchor: (N, P, 3) as in `Bodies` [m].
        heading: (N, P) as in `Bodies` [rad].
        axis: (N, P, 3) as in `Bodies`.
        mass: (N, P) of a part with its housing [kg].
        center: (N, P) center of that mass along the part [m].
        inertia: (N, P, 3) about it, in the part's frame, where it is diagonal [kg m^2].
        spheres: (N, C, 3) centers in the frame of the part `owners` names [m].
        radius: (N, C) [m]; a box's corner has none.
    """

    parent: "Array"
    anchor: "Array"
    heading: "Array"
    axis: "Array"
    mass: "Array"
    center: "Array"
    inertia: "Array"
    spheres: "Array"
    radius: "Array"


Frames = tuple["Array", "Array", "Array"]  # see `_compute_frames`


class PlannedMotion(NamedTuple):
    """One body's planned motion at T poses, seen from its torso.

    Attributes:
        spheres: (T, C, 3) from the body's center of mass [m].
        center: (T, 3) center of mass from the torso's center [m].
        inertia: (T, 3, 3) about the center of mass [kg m^2].
        spin: (T, 3) angular momentum of the parts' motion relative to the torso, on
            the way to the next pose, about the center of mass [kg m^2/s].
        mass: () [kg].
    """

    spheres: "Array"
    center: "Array"
    inertia: "Array"
    spin: "Array"
    mass: "Array"


def list_sphere_owners(anatomy: Anatomy) -> tuple[int, ...]:
    """(C) the part of each contact sphere: 8 torso corners, joints, tips, housings."""
    moving = range(1, anatomy.size + 1)
    housed = [i for i in moving if anatomy.block_mass[i - 1] > 0]
    return (*[0] * 8, *moving, *moving, *np.repeat(housed, 8).tolist())


def list_row_shapes(size: int, spheres: int) -> list[tuple[int, ...]]:
    """Shapes of the fields of `Parts` of one body of `size` parts; parents first."""
    part, place, sphere = (size,), (size, 3), (spheres,)
    return [part, place, part, place, part, part, place, (spheres, 3), sphere]


def pack_parts(bodies: Bodies) -> tuple[Ints | Floats, ...]:
    """Turn bodies into arrays for the device, in the order of `Parts`."""
    a, scale = bodies.anatomy, bodies.thickness
    radius = a.radius * scale
    block = a.block_mass * scale
    mass = bodies.mass + block
    center = bodies.mass * bodies.length / 2 + block * a.block_center * scale
    center = center / mass
    inertia = _compute_capsule_inertia(bodies.mass, bodies.length, radius)
    inertia += _compute_shifted_inertia(bodies.mass, bodies.length / 2 - center)
    inertia += _compute_box_inertia(block, a.block_half * scale[..., None])
    inertia += _compute_shifted_inertia(block, a.block_center * scale - center)
    none = np.zeros((len(bodies), 8))
    housed = np.flatnonzero(a.block_mass > 0)
    hung = bodies.parent, bodies.anchor, bodies.heading, bodies.axis
    sizes = np.hstack([none, radius, radius, *[none] * len(housed)])
    return *hung, mass, center, inertia, _place_spheres(bodies, housed), sizes


def _place_spheres(bodies: Bodies, housed: Ints) -> Floats:
    """(N, C, 3) contact spheres' centers in their own part's frame [m]."""
    a, n = bodies.anatomy, len(bodies)
    tips = np.zeros((n, a.size, 3))
    tips[..., 0] = bodies.length
    middle = np.stack([a.block_center, 0 * a.block_center, 0 * a.block_center], axis=1)
    blocks = middle[housed, None] + a.block_half[housed, None] * _CORNERS
    blocks = blocks * bodies.thickness[:, housed, None, None]
    torso = np.broadcast_to(a.torso_half * _CORNERS, (n, 8, 3))
    return np.hstack(
        [torso, np.zeros_like(tips), tips, blocks.reshape(n, 8 * len(housed), 3)]
    )


def _compute_capsule_inertia(mass: Floats, length: Floats, radius: Floats) -> Floats:
    """(N, P, 3) of capsules along x about their centers [kg m^2]."""
    round_ends = 4 * radius / (4 * radius + 3 * length)  # share of the volume
    ends, rod = mass * round_ends, mass * (1 - round_ends)
    along = rod * radius**2 / 2 + ends * radius**2 * 2 / 5
    across = rod * (3 * radius**2 + length**2) / 12
    across += ends * (radius**2 * 2 / 5 + length**2 / 4 + length * radius * 3 / 8)
    return np.stack([along, across, across], axis=2)


def _compute_box_inertia(mass: Floats, half: Floats) -> Floats:
    """(..., 3) of boxes about their centers [kg m^2]."""
    square = half**2
    return mass[..., None] / 3 * (square.sum(axis=-1, keepdims=True) - square)


def _compute_shifted_inertia(mass: Floats, offset: Floats) -> Floats:
    """(..., 3) inertia of masses moved along x [kg m^2]."""
    across = mass * offset**2
    return np.stack([0 * across, across, across], axis=-1)


def compute_torso_constants(anatomy: Anatomy) -> Floats:
    """(4) the torso's mass [kg] and its diagonal inertia [kg m^2]."""
    mass = np.array(anatomy.torso_mass)
    return np.append(mass, _compute_box_inertia(mass, anatomy.torso_half))


def plan_motion(
    body: Parts,
    torso: "Array",
    owner: tuple[int, ...],
    angles: "Array",
    timestep: float,
) -> PlannedMotion:
    """Pose one body along its planned joint angles.

    Args:
        torso: (4) `compute_torso_constants`.
        angles: (P, T + 1) joint angles, one timestep apart [rad].
        timestep: [s].
    """
    import jax.numpy as jnp

    turn, origin, omega = _compute_frames(body, angles, timestep)  # (P + 1, ..., T + 1)
    own = np.asarray(owner)
    spheres = origin[own] + (turn[own] * body.spheres[:, None, :, None]).sum(axis=2)
    middle = origin[1:] + turn[1:, :, 0] * body.center[:, None, None]
    total = torso[0] + body.mass.sum()
    center = (body.mass[:, None, None] * middle).sum(axis=0) / total
    mass = jnp.concatenate([torso[:1], body.mass])[:, None]
    local = jnp.concatenate([torso[None, 1:], body.inertia])
    offset = jnp.concatenate([0 * middle[:1], middle]) - center
    inertia = jnp.einsum("iabt,ib,icbt->iact", turn, local, turn)
    spin = jnp.einsum("iact,ict->at", inertia, omega)[:, :-1]
    halfway = (offset[..., 1:] + offset[..., :-1]) / 2
    moved = mass[..., None] * (offset[..., 1:] - offset[..., :-1]) / timestep
    spin += jnp.cross(halfway, moved, axis=1).sum(axis=0)
    square = (mass * (offset**2).sum(axis=1)).sum(axis=0)
    outer = jnp.einsum("it,iat,ict->act", mass * jnp.ones_like(square), offset, offset)
    inertia = inertia.sum(axis=0) + square * jnp.eye(3)[..., None] - outer
    return PlannedMotion(
        spheres=jnp.moveaxis(spheres - center, -1, 0),
        center=center.T,
        inertia=jnp.moveaxis(inertia, -1, 0),
        spin=jnp.pad(spin, ((0, 0), (0, 1))).T,
        mass=total,
    )


def _compute_frames(body: Parts, angles: "Array", timestep: float) -> Frames:
    """Where the torso and the parts are, in the torso's frame, at T poses.

    Returns:
        turn: (P + 1, 3, 3, T) rotations.
        origin: (P + 1, 3, T) [m].
        omega: (P + 1, 3, T) angular velocity on the way to the next pose [rad/s].
    """
    import jax
    import jax.numpy as jnp

    p, t = angles.shape
    speed = jnp.diff(angles, append=angles[:, -1:]) / timestep

    def hang(frames: Frames, part: tuple["Array", ...]) -> tuple[Frames, None]:
        turn, origin, omega = frames
        i, parent, anchor, heading, axis, angle, rate = part
        above = turn[parent]
        own = _multiply_matrices(above, _compute_hinge_rotation(heading, axis, angle))
        place = origin[parent] + (above * anchor[:, None]).sum(axis=1)
        # the axis is fixed in the parent's frame as well as in the part's own
        swing = omega[parent] + (own * axis[:, None]).sum(axis=1) * rate
        at = i + 1
        frames = turn.at[at].set(own), origin.at[at].set(place), omega.at[at].set(swing)
        return frames, None

    still = jnp.zeros((p + 1, 3, t), angles.dtype)
    start = jnp.zeros((p + 1, 3, 3, t), angles.dtype).at[0].set(jnp.eye(3)[..., None])
    columns = (jnp.arange(p), body.parent, body.anchor, body.heading, body.axis)
    frames, _ = jax.lax.scan(hang, (start, still, still), (*columns, angles, speed))
    return frames


def _compute_hinge_rotation(heading: "Array", axis: "Array", angle: "Array") -> "Array":
    """(3, 3, T) rotation from a part's frame to its parent's."""
    import jax.numpy as jnp

    c, s = jnp.cos(angle), jnp.sin(angle)
    x, y, z = axis
    cross = jnp.array([[0 * x, -z, y], [z, 0 * x, -x], [-y, x, 0 * x]])
    outer = axis[:, None] * axis
    swing = c * jnp.eye(3)[..., None] + s * cross[..., None]
    swing += (1 - c) * outer[..., None]
    ch, sh = jnp.cos(heading), jnp.sin(heading)
    plan = jnp.array([[ch, -sh, 0], [sh, ch, 0], [0, 0, 1]])
    return _multiply_matrices(plan[..., None], swing)


def _multiply_matrices(a: "Array", b: "Array") -> "Array":
    """(3, 3, T) products of two rows of matrices."""
    return (a[:, :, None] * b[None]).sum(axis=1)
