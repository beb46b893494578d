"""Bodies, robots and races as the kernels take them: named tuples of arrays."""

from typing import NamedTuple

import numpy as np

from ..body.body import Anatomy, Bodies, Floats, Ints, compute_mounts
from .channels import list_channels


class BodyArrays(NamedTuple):
    """N bodies, see `body.Bodies`; of one body, arrays without their first axis.

    Attributes:
        parent: (N, P).
        anchor: (N, P, 3) [m].
        mount: (N, P, 3, 3) rotation at the joint, see `body.compute_mounts`.
        axis: (N, P, 3).
        length: (N, P) [m].
        thickness: (N, P) factor on a part's radius and housing [1].
        mass: (N, P) [kg].
    """

    parent: Ints
    anchor: Floats
    mount: Floats
    axis: Floats
    length: Floats
    thickness: Floats
    mass: Floats

    def take_rows(self, rows: slice) -> "BodyArrays":
        """These bodies."""
        return BodyArrays._make(column[rows] for column in self)


class RobotArrays(NamedTuple):
    """What all bodies of a robot share, see `body.Anatomy` and `channels.Channels`.

    Attributes:
        torso_half: (3) [m].
        torso_mass: [kg].
        radius: (P) [m].
        block_half: (P, 3) [m].
        block_center: (P) [m].
        block_mass: (P) [kg].
        code: (C), and
        part: (C), and
        channel_axis: (C) of the sensors' channels.
        substeps: of the joint ramp; 0 of a robot that is bolted down, which is posed.
    """

    torso_half: Floats
    torso_mass: float
    radius: Floats
    block_half: Floats
    block_center: Floats
    block_mass: Floats
    code: Ints
    part: Ints
    channel_axis: Ints
    substeps: int


class Race(NamedTuple):
    """In which order bodies (N) try actions (n), and when each is given up.

    Attributes:
        order: (N, n) indices of the actions, first to last to be tried.
        bound: (N, n) a body is given up once its loss after the first, second, ...
            action in its order is not below.
        other_rest: (N) loss of a pose that the body rests in, too, though it comes to
            another; what it misses there is added. Infinite: it does not count.
    """

    order: Ints
    bound: Floats
    other_rest: Floats

    def take_rows(self, rows: slice | Ints) -> "Race":
        """The race of these bodies."""
        return Race._make(column[rows] for column in self)


def plan_race(
    bodies: int, order: Ints, bound: Floats | float, other_rest: Floats | float = np.inf
) -> Race:
    """The race of so many bodies, of arrays that are broadcast to their shapes.

    Args:
        order: (n) or (N, n), see `Race`.
        bound: a number, (N, 1) or (N, n).
        other_rest: a number or (N).
    """
    shape = bodies, order.shape[-1]
    return Race(
        np.ascontiguousarray(np.broadcast_to(order, shape)),
        np.ascontiguousarray(np.broadcast_to(bound, shape), float),
        np.ascontiguousarray(np.broadcast_to(other_rest, bodies), float),
    )


def pack_bodies(b: Bodies) -> BodyArrays:
    """A batch as the kernels take it."""
    mount = compute_mounts(b)
    return BodyArrays(b.parent, b.anchor, mount, b.axis, b.length, b.thickness, b.mass)


def pack_robot(a: Anatomy, substeps: int) -> RobotArrays:
    """A robot as the kernels take it; `substeps` count where it is not bolted down."""
    c, steps = list_channels(a), 0 if a.fixed else substeps
    blocks = a.block_half, a.block_center, a.block_mass
    torso = a.torso_half, a.torso_mass
    return RobotArrays(*torso, a.radius, *blocks, c.code, c.part, c.axis, steps)
