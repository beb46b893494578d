"""Genomes: batched encodings of bodies, and how a genome becomes a body.

One batch holds every gene of all three encodings; a space (see `selfmodel`) says
which of them may vary. Paper A: parent and placement. Paper C: parent, side, hinge
and length.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.random import Generator

from .body import Anatomy, Bodies, Floats, Ints, Rows

# Paper A maps a gene v of part i to t = v (i - 1 + 0.9999); papers.md 1.3.
_PAPER_SPAN = 0.9999
# Paper C's six hinge kinds as axes in the part's frame: turn left, right (about z),
# up, down (about y), roll either way about the part's own axis. papers.md 2, C.
HINGE_AXES = np.array(
    [[0, 0, 1], [0, 0, -1], [0, -1, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0]], float
)
HINGE_NAMES = ("left", "right", "up", "down", "roll_left", "roll_right")
UP = HINGE_NAMES.index("up")
LENGTH_RANGE = (0.01, 0.20)  # [m], paper C


@dataclass(frozen=True)
class Genomes:
    """A batch of N genomes for P parts.

    Attributes:
        parent: (N, P) 0..i-1 for part i, or any part where the anatomy is not ordered.
        placement: (N, P) in [0, 1), clockwise round the parent's perimeter from its
            back left corner: quarters left, front, right, back (paper A).
        hinge: (N, P) 0..5, index into HINGE_NAMES. UP means paper A's hinge.
        length: (N, P) [m].
    """

    parent: Ints
    placement: Floats
    hinge: Ints
    length: Floats

    def __len__(self) -> int:
        return len(self.parent)

    def __getitem__(self, rows: Rows) -> "Genomes":
        """The genomes of these rows, as a batch."""
        # by name: a search does this tens of thousands of times
        return Genomes(
            self.parent[rows], self.placement[rows], self.hinge[rows], self.length[rows]
        )

    @property
    def side(self) -> Ints:
        """(N, P) the perimeter's quarter: 0 left, 1 front, 2 right, 3 back."""
        return np.minimum(self.placement * 4, 3).astype(np.int64)


def concatenate_genomes(*batches: Genomes) -> Genomes:
    """All genomes of several batches, in order."""
    names = [f.name for f in fields(Genomes)]
    return Genomes(*(np.concatenate([getattr(b, n) for b in batches]) for n in names))


def encode_tree(anatomy: Anatomy, parent: Ints, placement: Floats) -> Genomes:
    """Encode trees as paper A does: known lengths and hinges.

    Args:
        parent: (N, P) or (P) what each part is attached to; 0 is the torso.
        placement: (N, P) or (P) where on its parent's perimeter [rounds].
    """
    parent = np.atleast_2d(np.asarray(parent, np.int64))
    length = np.broadcast_to(anatomy.length, parent.shape).copy()
    placement = np.broadcast_to(np.asarray(placement, float), parent.shape).copy()
    kinds = anatomy.hinges or (UP,) * anatomy.size
    hinge = np.broadcast_to(np.array(kinds), parent.shape).copy()
    return Genomes(parent, placement, hinge, length)


def decode_unit_genes(anatomy: Anatomy, genes: Floats) -> Genomes:
    """Genomes from paper A's eight genes in [0, 1] (papers.md 1.3).

    Args:
        genes: (N, P) in [0, 1]; parent = floor(t), placement = t - parent with
            t = gene * (i - 1 + 0.9999) for part i = 1..P.
    """
    t = np.atleast_2d(genes) * (np.arange(anatomy.size) + _PAPER_SPAN)
    parent = np.floor(t).astype(np.int64)
    return encode_tree(anatomy, parent, t - parent)


def decode_matrix(anatomy: Anatomy, matrix: Floats) -> Genomes:
    """Genomes from paper C's 8 x 4 matrices.

    Args:
        matrix: (N, P, 4) in [0, 1]: parent scaled to 0..i-1, side to 0..3, hinge kind
            to 0..5, length to LENGTH_RANGE.
    """
    below_one = np.clip(matrix, 0.0, np.nextafter(1.0, 0.0))
    parent = np.floor(below_one[..., 0] * np.arange(1, anatomy.size + 1))
    side = np.floor(below_one[..., 1] * 4)
    hinge = np.floor(below_one[..., 2] * 6)
    low, high = LENGTH_RANGE
    length = low + matrix[..., 3] * (high - low)
    return Genomes(
        parent.astype(np.int64), (side + 0.5) / 4, hinge.astype(np.int64), length
    )


def relabel_parts(genomes: Genomes, order: Ints) -> Genomes:
    """Bodies in which part i became part order[i], with all its genes.

    Args:
        order: (N, P) permutations of 0..P-1.
    """
    label = np.hstack([np.zeros((len(order), 1), np.int64), order + 1])
    back = np.argsort(order, axis=1)
    parent = np.take_along_axis(label, genomes.parent, axis=1)
    genes = parent, genomes.placement, genomes.hinge, genomes.length
    return Genomes(*(np.take_along_axis(gene, back, axis=1) for gene in genes))


def center_on_sides(genomes: Genomes) -> Genomes:
    """Move every attachment of the trees to the middle of its side."""
    return replace(genomes, placement=(genomes.side + 0.5) / 4)


def _find_perimeter_points(half: Floats, placement: Floats) -> tuple[Floats, Floats]:
    """Point on a rectangle's perimeter, (..., 2), for half sizes (..., 2)."""
    quarter = np.minimum(np.floor(placement * 4), 3)
    along = 2 * (placement * 4 - quarter) - 1
    x = np.choose(quarter.astype(int), [along, np.ones_like(along), -along, -1.0])
    y = np.choose(quarter.astype(int), [1.0, -along, -np.ones_like(along), along])
    return x * half[..., 0], y * half[..., 1]


def build_bodies(anatomy: Anatomy, genomes: Genomes) -> Bodies:
    """The bodies that genomes stand for (papers.md 1.3 and 2, C).

    A part leaves its parent at the perimeter point `placement`. Its direction is

        parent's direction - (2 pi placement - 3 pi / 4)

    so that the middle of a side means straight out of it. A hinge of kind `up` is
    paper A's: horizontal, normal to the line from the parent's center to the part's,
    positive lifts the outer end. Of a part with a bend it is along the part's y axis.
    Mass is in proportion to length.
    """
    n, p = genomes.parent.shape
    radius = np.hstack([np.zeros((n, 1)), np.broadcast_to(anatomy.radius, (n, p))])
    reach = np.hstack([np.zeros((n, 1)), genomes.length])
    half = np.stack(
        [
            np.take_along_axis(reach / 2, genomes.parent, axis=1),
            np.take_along_axis(radius, genomes.parent, axis=1),
        ],
        axis=2,
    )
    on_torso = (genomes.parent == 0)[..., None]
    half = np.where(on_torso, anatomy.rim[:2], half)
    x, y = _find_perimeter_points(half, genomes.placement)
    center = np.where(on_torso[..., 0], 0.0, half[..., 0])
    height = np.where(on_torso[..., 0], anatomy.rim[2], 0.0)
    heading = 0.75 * np.pi - 2 * np.pi * genomes.placement
    out_x = x + genomes.length / 2 * np.cos(heading)
    out_y = y + genomes.length / 2 * np.sin(heading)
    slant = np.arctan2(out_y, out_x) - heading
    slant = np.where(np.array(anatomy.bends or 0.0) == 0.0, slant, 0.0)
    lift = np.stack([np.sin(slant), -np.cos(slant), np.zeros((n, p))], axis=2)
    axis = np.where((genomes.hinge == UP)[..., None], lift, HINGE_AXES[genomes.hinge])
    return Bodies(
        anatomy=anatomy,
        parent=genomes.parent,
        anchor=np.stack([x + center, y, height], axis=2),
        heading=heading,
        axis=axis,
        length=genomes.length,
        thickness=np.ones((n, p)),
        mass=anatomy.mass * genomes.length / anatomy.length,
    )


def draw_genomes(anatomy: Anatomy, count: int, rng: Generator, sides: bool) -> Genomes:
    """Draw random attachment trees; gene i is uniform, so the parent is among 0..i-1.

    Where the anatomy is not ordered, parts then trade places at random.
    """
    genomes = decode_unit_genes(anatomy, rng.random((count, anatomy.size)))
    if not anatomy.ordered:
        every = np.arange(anatomy.size)
        order = rng.permuted(np.tile(every, (count, 1)), axis=1)
        moved = relabel_parts(genomes, order)
        genomes = replace(moved, hinge=genomes.hinge, length=genomes.length)
    return center_on_sides(genomes) if sides else genomes
