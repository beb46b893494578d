"""Bodies: what is known of a robot's parts, and batches of ways to attach them.

Frames: torso x forward, y left, z up. A part's frame has its origin at its joint
and x along the part; at zero joint angles it is as level as its parent's, but for the
part's bend. Part 0 is the torso, parts 1..P are the moving ones; arrays over parts have
P columns.
"""

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
GRAVITY = 9.81  # [m/s^2]
BELLY_SENSOR = 0.01  # [m] contract: it sits this far inside the torso's belly
Rows = int | slice | list[int] | Ints | NDArray[np.bool_]


@dataclass(frozen=True)
class RowBatch:
    """Rows: every field that is an array has one for each."""

    def __len__(self) -> int:
        return len(next(iter(self._get_columns().values())))

    def __getitem__(self, rows: Rows) -> Self:
        """These rows, as a batch."""
        columns = self._get_columns().items()
        return replace(self, **{name: column[rows] for name, column in columns})

    def _get_columns(self) -> dict[str, np.ndarray]:
        """The arrays by name."""
        values = ((f.name, getattr(self, f.name)) for f in fields(self))
        return {name: value for name, value in values if isinstance(value, np.ndarray)}


@dataclass(frozen=True)
class Anatomy:
    """What a robot knows of its parts before it asks how they are attached.

    Attributes:
        parts: (P) names of parts 1..P.
        joints: (P) names of the joints that move them.
        torso_half: (3) half sizes of the torso box [m].
        torso_mass: [kg].
        rim: (3) half width in x, in y of the rectangle on whose perimeter parts
            attach to the torso, and its height above the torso's center [m].
        length: (P) [m].
        radius: (P) of the capsule [m].
        mass: (P) of the capsule [kg].
        block_half: (P, 3) half sizes of the housing at the part's joint [m]; 0 = none.
        block_center: (P) where the housing's center is along the part [m].
        block_mass: (P) [kg].
        feet: the parts (1..P) whose tips feel the floor.
        hinges: (P) known kinds of hinges, as `genome.HINGE_NAMES`; empty: all lift.
        bends: (P) by how much parts leave their parents downward [rad]; empty: by 0.
        ordered: whether a part's parent is the torso or a part listed before it.
        sensors: of the robot at rest, as `engine.channels` names them.
    """

    name: str
    parts: tuple[str, ...]
    joints: tuple[str, ...]
    torso_half: Floats
    torso_mass: float
    rim: Floats
    length: Floats
    radius: Floats
    mass: Floats
    block_half: Floats
    block_center: Floats
    block_mass: Floats
    feet: tuple[int, ...]
    hinges: tuple[int, ...] = ()
    bends: tuple[float, ...] = ()
    fixed: bool = False
    ordered: bool = True
    sensors: tuple[str, ...] = ("tilt", "clearance")

    @property
    def size(self) -> int:
        """The number of moving parts P."""
        return len(self.parts)


@dataclass(frozen=True)
class Bodies(RowBatch):
    """A batch of N bodies made of one anatomy's parts.

    Attributes:
        parent: (N, P) parent of part 1..P; 0 is the torso, else a part: one before it
            where the anatomy is ordered.
        anchor: (N, P, 3) the joint in the parent's frame [m].
        heading: (N, P) turn about z from the parent's frame to the part's [rad].
        axis: (N, P, 3) unit hinge axis in the part's frame.
        length: (N, P) [m].
        thickness: (N, P) factor on the radius and on the housing's size and mass [1].
        mass: (N, P) of the capsule [kg].
    """

    anatomy: Anatomy
    parent: Ints
    anchor: Floats
    heading: Floats
    axis: Floats
    length: Floats
    thickness: Floats
    mass: Floats


def concatenate_bodies(*batches: Bodies) -> Bodies:
    """All bodies of several batches of one anatomy, in order."""
    names = [f.name for f in fields(Bodies)[1:]]
    columns = (np.concatenate([getattr(b, n) for b in batches]) for n in names)
    return Bodies(batches[0].anatomy, *columns)


def scale_parts(bodies: Bodies, scale: Floats) -> Bodies:
    """Shrink or grow parts as in paper A after damage.

    Args:
        scale: (N, P) factor on length, diameter, mass and housing of each part
            [1], 0.1 to 2 in the paper. A joint on a scaled part moves with it.
    """
    scale = np.broadcast_to(np.asarray(scale, float), bodies.length.shape)
    on_torso = np.ones((len(bodies), 1))
    of_parent = np.take_along_axis(np.hstack([on_torso, scale]), bodies.parent, axis=1)
    return replace(
        bodies,
        anchor=bodies.anchor * of_parent[..., None],
        length=bodies.length * scale,
        thickness=bodies.thickness * scale,
        mass=bodies.mass * scale,
    )


def compute_mounts(bodies: Bodies) -> Floats:
    """(N, P, 3, 3) rotation of each part's frame in its parent's, at zero angles.

    First about y by the part's bend, then about z by its heading.
    """
    bend = np.array(bodies.anatomy.bends or (0.0,) * bodies.anatomy.size)
    c, s = np.cos(bodies.heading), np.sin(bodies.heading)
    down, level, none = np.sin(bend) + 0 * c, np.cos(bend) + 0 * c, 0 * c
    rows = [[c * level, -s, c * down], [s * level, c, s * down], [-down, none, level]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def compute_rest_frames(bodies: Bodies) -> tuple[Floats, Floats]:
    """Where parts are at zero joint angles.

    Returns:
        origin: (N, P + 1, 3) of the torso and each part, in the torso's frame [m].
        frame: (N, P + 1, 3, 3) their rotations; columns are their axes.
    """
    n, p = bodies.parent.shape
    row, mount = np.arange(n), compute_mounts(bodies)
    origin, frame = np.zeros((n, p + 1, 3)), np.zeros((n, p + 1, 3, 3))
    frame[:, 0] = np.eye(3)
    # parts behind their children are right once as many passes went as they are deep
    passes = 1 if (bodies.parent <= np.arange(p)).all() else p
    for i in [*range(p)] * passes:
        parent = bodies.parent[:, i]
        up = frame[row, parent]
        offset = np.einsum("nij,nj->ni", up, bodies.anchor[:, i])
        origin[:, i + 1] = origin[row, parent] + offset
        frame[:, i + 1] = up @ mount[:, i]
    return origin, frame


def list_parents_first(parent: Ints) -> list[int]:
    """Parts 1..P of one tree (P), those nearer to the torso first."""
    found = [0]
    for part in found:
        found += [int(k) + 1 for k in np.flatnonzero(parent == part)]
    return found[1:]


def count_ancestors(parent: Ints) -> Ints:
    """(P) parts between each part of one tree (P) and the torso."""
    count = np.zeros(len(parent), np.int64)
    for part in list_parents_first(parent):
        if k := parent[part - 1]:
            count[part - 1] = count[k - 1] + 1
    return count


def compute_part_points(bodies: Bodies, along: float) -> Floats:
    """(N, P, 3) point on each part's axis, zero angles, torso frame [m].

    Args:
        along: 0 = the joint, 0.5 = the part's center, 1 = its tip.
    """
    origin, frame = compute_rest_frames(bodies)
    reach = along * bodies.length[..., None]
    return origin[:, 1:] + reach * frame[:, 1:, :, 0]


def count_centers_in_torso(bodies: Bodies) -> Ints:
    """(N) how many parts have their center inside the torso's box at zero angles.

    Paper A does not simulate such bodies (papers.md 1.1).
    """
    inside = np.abs(compute_part_points(bodies, 0.5)) < bodies.anatomy.torso_half
    return inside.all(axis=2).sum(axis=1)


def measure_center_distance(bodies: Bodies, truth: Bodies) -> Floats:
    """(N) body distance [cm]: mean over parts of |center_i - true center_i| * 100.

    Centers at zero joint angles. Paper A's "model error" fits this formula
    (papers.md 1.6): 20.8 cm for random genomes.
    """
    gap = compute_part_points(bodies, 0.5) - compute_part_points(truth, 0.5)
    return 100 * np.linalg.norm(gap, axis=2).mean(axis=1)


def measure_tip_distance(bodies: Bodies, truth: Bodies) -> Floats:
    """(N) mean over parts of |tip_i - true tip_i| * 100 [cm], zero joint angles."""
    gap = compute_part_points(bodies, 1.0) - compute_part_points(truth, 1.0)
    return 100 * np.linalg.norm(gap, axis=2).mean(axis=1)


def measure_length_error(bodies: Bodies, truth: Bodies) -> Floats:
    """(N) mean over parts of |length_i - true length_i| * 100 [cm] (paper C)."""
    return 100 * np.abs(bodies.length - truth.length).mean(axis=1)


def compute_edge_f1(bodies: Bodies, truth: Bodies) -> Floats:
    """(N) F1 of the labelled edges {(parent_i, i)}: 2 |E n T| / (|E| + |T|) [1].

    Every body has exactly P edges, so precision = recall = F1 = share of right parents.
    """
    return (bodies.parent == truth.parent).mean(axis=1)
