"""Spaces of bodies and the small changes that lead from one body to its neighbors."""

from dataclasses import dataclass, fields, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.random import Generator

from ..body.body import Anatomy, Ints
from ..body.genome import (
    HINGE_NAMES,
    LENGTH_RANGE,
    Genomes,
    center_on_sides,
    concatenate_genomes,
    draw_genomes,
    relabel_parts,
)
from ..errors import UnknownNameError
from ..schema import is_tree

_NUDGES = 6  # random shifts of each continuous gene in one neighborhood; chosen
_NUDGE_DECADES = (-3.0, -0.7)  # their size: 10^uniform, in rounds or lengths; chosen


@dataclass(frozen=True)
class BodySpace:
    """Which genes of a body are unknown.

    Attributes:
        sides: attachments are at the middle of a side, else anywhere.
        hinges: the hinge kind is unknown (paper C), else hinges lift (paper A).
        lengths: part lengths are unknown.
        ordered: a part hangs on one before it.
    """

    name: str
    sides: bool
    hinges: bool
    lengths: bool
    ordered: bool = True


SPACES = {
    s.name: s
    for s in (
        BodySpace("free", sides=False, hinges=False, lengths=False),
        BodySpace("sides", sides=True, hinges=False, lengths=False),
        BodySpace("full", sides=True, hinges=True, lengths=True),
    )
}


def find_space(name: str) -> BodySpace:
    """The space of a name, of `SPACES`.

    Raises:
        UnknownNameError: no such space.
    """
    if name not in SPACES:
        raise UnknownNameError("space", name, SPACES)
    return SPACES[name]


def draw_space_genomes(
    anatomy: Anatomy, space: BodySpace, count: int, rng: Generator
) -> Genomes:
    """Draw genomes of a space, uniform in every unknown gene."""
    genomes = draw_genomes(anatomy, count, rng, space.sides)
    shape = genomes.parent.shape
    if space.hinges:
        genomes = replace(genomes, hinge=rng.integers(0, len(HINGE_NAMES), shape))
    if space.lengths:
        genomes = replace(genomes, length=rng.uniform(*LENGTH_RANGE, shape))
    return genomes


def _copy_genome(genome: Genomes, count: int) -> Genomes:
    """`count` copies of a batch of one."""
    return genome[np.zeros(count, np.int64)]


@lru_cache
def _list_spots(p: int, ordered: bool) -> Ints:
    """(S, 3) each of p parts, possible parent and side."""
    places = ((i, k) for i in range(p) for k in range(i + 1 if ordered else p + 1))
    return np.array([(i, k, s) for i, k in places if k != i + 1 for s in range(4)])


def _reattach_parts(space: BodySpace, genome: Genomes) -> Genomes:
    """Every part at the middle of every side of every possible parent."""
    kinds = np.arange(len(HINGE_NAMES) if space.hinges else 0)
    spots = _list_spots(genome.parent.shape[1], space.ordered)
    part, parent, side = np.repeat(spots, max(1, len(kinds)), axis=0).T
    out, row = _copy_genome(genome, len(part)), np.arange(len(part))
    out.parent[row, part], out.placement[row, part] = parent, (side + 0.5) / 4
    if len(kinds):
        out.hinge[row, part] = np.tile(kinds, len(spots))
    return out


def _permute_attachments(genome: Genomes, orders: Ints) -> Genomes:
    """Attachments handed from part to part: part i takes that of orders[., i]."""
    genes = genome.parent, genome.placement, genome.hinge
    parent, placement, hinge = (gene[0][orders] for gene in genes)
    length = np.repeat(genome.length, len(orders), axis=0)
    return Genomes(parent, placement, hinge, length)


def _relabel_parts(genome: Genomes, orders: Ints) -> Genomes:
    """Parts trade places, children and all: part i becomes part orders[., i]."""
    same = _copy_genome(genome, len(orders))
    return replace(relabel_parts(same, orders), length=same.length)


@lru_cache
def _list_orders(p: int) -> tuple[Ints, Ints]:
    """All trades of two parts, and all cycles of three."""
    pairs = np.tile(np.arange(p), (p * (p - 1) // 2, 1))
    for row, (i, j) in zip(pairs, combinations(range(p), 2), strict=True):
        row[[i, j]] = row[[j, i]]
    triples = [c for a in combinations(range(p), 3) for c in (a, a[::-1])]
    cycles = np.tile(np.arange(p), (len(triples), 1))
    for row, (i, j, k) in zip(cycles, triples, strict=True):
        row[[i, j, k]] = row[[j, k, i]]
    return pairs, cycles


def _nudge_gene(genome: Genomes, gene: str, rng: Generator) -> Genomes:
    """One gene of one part shifted a little, several sizes for every part."""
    p = genome.parent.shape[1]
    part = np.repeat(np.arange(p), _NUDGES)
    size = rng.normal(size=len(part)) * 10 ** rng.uniform(*_NUDGE_DECADES, len(part))
    out = _copy_genome(genome, len(part))
    values, row = getattr(out, gene), np.arange(len(part))
    if gene == "placement":
        values[row, part] = (values[row, part] + size) % 1.0
    else:
        span = LENGTH_RANGE[1] - LENGTH_RANGE[0]
        values[row, part] = np.clip(values[row, part] + size * span, *LENGTH_RANGE)
    return out


def list_changes(space: BodySpace, genome: Genomes) -> Genomes:
    """All discrete changes of a body, the k-th the same change whatever the body.

    Some make no valid body, or no other one: see `others`. Where hinges are unknown a
    part changes its place and its hinge at once: in most places the hinge that was
    right in another one is as wrong as any.
    """
    pairs, cycles = _list_orders(genome.parent.shape[1])
    found = concatenate_genomes(
        _reattach_parts(space, genome),
        _permute_attachments(genome, pairs),
        _relabel_parts(genome, pairs),
        _permute_attachments(genome, cycles),
    )
    if space.hinges:
        return found
    return replace(found, hinge=np.broadcast_to(genome.hinge, found.hinge.shape).copy())


def list_neighbors(space: BodySpace, genome: Genomes) -> Genomes:
    """The other bodies one discrete change away from a body (1)."""
    return keep_others(space, list_changes(space, genome), genome)


def draw_nudges(space: BodySpace, genome: Genomes, rng: Generator) -> Genomes:
    """Bodies one small continuous change away from one (1), none of discrete genes."""
    batches = [genome[:0]]
    if not space.sides:
        batches.append(_nudge_gene(genome, "placement", rng))
    if space.lengths:
        batches.append(_nudge_gene(genome, "length", rng))
    return concatenate_genomes(*batches)


def keep_others(space: BodySpace, around: Genomes, genome: Genomes) -> Genomes:
    """The valid ones that differ from a genome (1)."""
    return around[find_others(space, around, genome)]


def find_others(space: BodySpace, around: Genomes, genome: Genomes) -> np.ndarray:
    """(N) whether genomes are valid and differ from one (1)."""
    return is_valid(space, around) & ~is_same(around, genome)


def is_valid(space: BodySpace, genomes: Genomes) -> np.ndarray:
    """(N) whether genomes are trees, every parent before its child where that holds."""
    if not space.ordered:
        return is_tree(genomes.parent)
    return np.all(genomes.parent <= np.arange(genomes.parent.shape[1]), axis=1)


def is_same(genomes: Genomes, other: Genomes) -> np.ndarray:
    """(N) whether a genome equals `other` (1) to a thousandth of a round and 0.1 mm."""
    turn = np.abs(genomes.placement - other.placement)
    return (
        (genomes.parent == other.parent)
        & (np.minimum(turn, 1 - turn) < 1e-3)
        & (genomes.hinge == other.hinge)
        & (np.abs(genomes.length - other.length) < 1e-4)
    ).all(axis=1)


def cross_genomes(first: Genomes, second: Genomes, rng: Generator) -> Genomes:
    """Uniform crossover: each part's genes from one of two genomes (1)."""
    pick = rng.random(first.parent.shape) < 0.5
    pairs = [[getattr(g, f.name) for g in (first, second)] for f in fields(Genomes)]
    return Genomes(*(np.where(pick, a, b) for a, b in pairs))


def perturb_genome(space: BodySpace, genome: Genomes, rng: Generator) -> Genomes:
    """A genome (1) after two to four random small changes in a row."""
    for _ in range(rng.integers(2, 5)):
        around = list_neighbors(space, genome)
        genome = around[rng.integers(len(around), size=1)]
    return center_on_sides(genome) if space.sides else genome


def make_genome_key(genomes: Genomes, row: int) -> bytes:
    """A hashable name of one genome, equal for bodies equal to a thousandth."""
    placement = np.round(genomes.placement[row] * 1000).astype(int) % 1000
    length = np.round(genomes.length[row] * 1e4).astype(int)
    genes = genomes.parent[row], placement, genomes.hinge[row], length
    return np.concatenate(genes).tobytes()
