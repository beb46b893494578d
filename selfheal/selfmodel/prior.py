"""Prior: before anything is felt, a body whose like parts are built alike is likelier.

The code length of a body (Rissanen 1978): each kind of part, by what hangs on it and
where, is stated once, however many parts are of it.
"""

from dataclasses import replace
from functools import cache
from math import prod

import numpy as np

from ..body.body import Anatomy, Floats, Ints
from ..body.genome import (
    HINGE_NAMES,
    LENGTH_RANGE,
    Genomes,
    concatenate_genomes,
    encode_tree,
)
from .space import BodySpace, is_valid
from .symmetry import classify_parts

_SIDES = 4


def count_kinds(anatomy: Anatomy, genomes: Genomes) -> Floats:
    """Number of different kinds of parts of each body, by what hangs on them.

    Two parts are of one kind if they are alike and parts that are alike hang on them at
    the same sides by the same hinges. The starfish has two: a lower leg, and an upper
    leg with a lower one at its front. So has a chain of equal links, however long.

    Args:
        anatomy: the robot's parts.
        genomes: N bodies.

    Returns:
        (N) numbers.
    """
    kind = classify_parts(anatomy)
    shape = kind.max() + 1, _SIDES, len(HINGE_NAMES)
    own, salts = _draw_salts(shape[0]), _draw_salts(prod(shape)).reshape(shape)
    hanging = np.zeros((len(genomes), anatomy.size + 1), np.int64)
    rows = np.arange(len(genomes))[:, None]
    with np.errstate(over="ignore"):  # a kind's name is the sum of salts
        np.add.at(
            hanging, (rows, genomes.parent), salts[kind, genomes.side, genomes.hinge]
        )
        names = np.sort(hanging[:, 1:] + own[kind], axis=1)
    return 1.0 + (np.diff(names, axis=1) != 0).sum(axis=1)


@cache
def _draw_salts(count: int) -> Ints:
    """Numbers (count) whose sums tell what was summed."""
    return np.random.default_rng(count).integers(-(2**62), 2**62, count)


def compute_prior_cost(
    anatomy: Anatomy, genomes: Genomes, *, hinges: bool = False
) -> Floats:
    """(N) what the prior adds to each body's loss: its code length [nats].

    Each kind of part costs the logarithm of the number of places that a part may have:
    any side of any part or the torso.

    Args:
        anatomy: the robot's parts.
        genomes: N bodies.
        hinges: whether a part may have any hinge there, too.
    """
    places = anatomy.size * _SIDES * (len(HINGE_NAMES) if hinges else 1)
    return np.log(places) * count_kinds(anatomy, genomes)


def draw_alike_genomes(
    anatomy: Anatomy, space: BodySpace, count: int, rng: np.random.Generator
) -> Genomes:
    """Draw bodies whose like parts hang alike, at most `count` of them.

    The parts of a kind hang on the torso, at even distances round it, or in a row on
    each other, or evenly on the parts of another kind.

    Args:
        anatomy: the robot's parts.
        space: that the bodies lie in.
        count: number of draws; those that make no valid body are left out.
        rng: draws them.
    """
    kind = classify_parts(anatomy)
    groups = [np.flatnonzero(kind == k) for k in range(kind.max() + 1)]
    groups.sort(key=lambda group: int(group[0]))
    drawn = [_draw_alike(anatomy, space, groups, rng) for _ in range(count)]
    genomes = concatenate_genomes(*drawn)
    return genomes[is_valid(space, genomes)]


def _draw_alike(
    anatomy: Anatomy, space: BodySpace, groups: list[Ints], rng: np.random.Generator
) -> Genomes:
    """One body (1) of groups of like parts; it may be no valid one."""
    parent, place = np.zeros((2, anatomy.size))
    hinge, length = np.zeros(anatomy.size, int), np.zeros(anatomy.size)
    order = range(len(groups)) if anatomy.ordered else rng.permutation(len(groups))
    hosts: list[Ints] = []
    for group in (groups[k] for k in order):
        if not anatomy.ordered:
            group = rng.permutation(group)
        parent[group], place[group] = _place_group(group, hosts, rng)
        hinge[group] = rng.integers(len(HINGE_NAMES))
        length[group] = rng.uniform(*LENGTH_RANGE)
        hosts.append(group)
    body = encode_tree(anatomy, parent.astype(int), place % 1.0)
    return replace(
        body,
        hinge=hinge[None] if space.hinges else body.hinge,
        length=length[None] if space.lengths else body.length,
    )


def _place_group(
    group: Ints, hosts: list[Ints], rng: np.random.Generator
) -> tuple[Ints, Floats]:
    """Parents and placements [rounds] of the parts of a group (m), drawn alike.

    Args:
        group: indices of its parts.
        hosts: groups that have their places.
        rng: draws the places.
    """
    count, side = len(group), int(rng.integers(_SIDES))
    fits = [host for host in hosts if count % len(host) == 0]
    choice = int(rng.integers(len(fits) + 1 + (count > 1)))
    middle = (side + 0.5) / _SIDES
    if choice < len(fits):
        host = fits[choice]
        turn = np.repeat(np.arange(count // len(host)), len(host))
        return np.resize(host, count) + 1, middle + turn / _SIDES
    if choice > len(fits):  # a row
        first = rng.choice(np.concatenate([[0], *(h + 1 for h in hosts)]))
        return np.append(first, group[:-1] + 1), np.full(count, middle)
    used = int(rng.choice([n for n in (1, 2, _SIDES) if count % n == 0]))
    row, each = np.divmod(np.arange(count), count // used)
    at = (each + 0.5) / (count // used)
    return np.zeros(count, int), (side + row * (_SIDES // used) + at) / _SIDES
