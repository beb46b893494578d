"""Prior: before any reading, a body whose like parts are built alike is likelier.

The code length of a body (Rissanen 1978): what hangs on the parts of a kind, and where,
is stated once, however many parts are of it.
"""

from dataclasses import replace
from functools import cache
from math import prod

import numpy as np
from numpy.random import Generator

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

_SIDES, _FRONT = 4, 1
_ONE_ROW = 0.25  # of the bodies drawn end in a row of several kinds; chosen


def count_rules(anatomy: Anatomy, genomes: Genomes) -> tuple[Ints, Ints]:
    """Number of rules that state how each body is built, and of those not straight.

    One rule a kind of part says what hangs on it. Two parts are of one kind if they are
    alike, and parts that are alike hang on them at the same sides by the same hinges.
    One rule says where on the torso the parts of a kind are. It does where they are as
    many on all sides, on two opposite ones, or on one; else each part has its own. The
    starfish has three: a lower leg bears nothing, an upper leg a lower one at its
    front, the torso an upper one at each side. So has a chain of equal links.

    Returns:
        (N) numbers, and (N) of the kinds that bear a part not at their front.
    """
    names = _name_parts(anatomy, genomes)
    rows = np.arange(len(genomes))[:, None]
    bent = np.zeros((len(genomes), anatomy.size + 1), bool)
    np.logical_or.at(bent, (rows, genomes.parent), genomes.side != _FRONT)
    kinds = _count_distinct(names, np.ones_like(names, bool))
    rules = kinds + _count_torso_rules(names, genomes)
    return rules, _count_distinct(names, bent[:, 1:])


def _count_distinct(names: Ints, counted: np.ndarray) -> Ints:
    """(N) different ones of names (N, P) that are counted (N, P)."""
    none = np.iinfo(np.int64).min
    every = np.pad(
        np.where(counted, names, none), ((0, 0), (1, 0)), constant_values=none
    )
    return (np.diff(np.sort(every, axis=1), axis=1) != 0).sum(axis=1)


def _name_parts(anatomy: Anatomy, genomes: Genomes) -> Ints:
    """(N, P) a number for each part, the same for parts of one kind; see above."""
    kind = classify_parts(anatomy)
    shape = kind.max() + 1, _SIDES, len(HINGE_NAMES)
    own, salts = _draw_salts(shape[0]), _draw_salts(prod(shape)).reshape(shape)
    hanging = np.zeros((len(genomes), anatomy.size + 1), np.int64)
    rows = np.arange(len(genomes))[:, None]
    with np.errstate(over="ignore"):  # a kind's name is the sum of salts
        np.add.at(
            hanging, (rows, genomes.parent), salts[kind, genomes.side, genomes.hinge]
        )
        return hanging[:, 1:] + own[kind]


def _count_torso_rules(names: Ints, genomes: Genomes) -> Ints:
    """(N) rules that say where on torsos the parts of a kind, by name (N, P), are."""
    on_torso = genomes.parent == 0
    alike = (names[:, :, None] == names[:, None]) & on_torso[:, None]
    side = (genomes.side[:, :, None] == np.arange(_SIDES)).astype(float)
    count = alike @ side  # (N, P, 4) of each part's kind
    used = count > 0
    opposite = (used[..., :2] == used[..., 2:]).all(axis=-1) | (used.sum(axis=-1) == 1)
    even = opposite & (count.max(axis=-1) == np.where(used, count, np.inf).min(axis=-1))
    rules = np.where(even, 1 / np.maximum(count.sum(axis=-1), 1), 1.0) * on_torso
    return np.round(rules.sum(axis=1)).astype(int)


@cache
def _draw_salts(count: int) -> Ints:
    """Numbers (count) whose sums tell what was summed."""
    return np.random.default_rng(count).integers(-(2**62), 2**62, count)


def compute_prior_cost(anatomy: Anatomy, space: BodySpace, genomes: Genomes) -> Floats:
    """(N) what the prior adds to each body's loss: its code length [nats].

    Each rule costs the logarithm of the number of places that a part may have: on any
    part, straight on as often as at its other three sides.

    Args:
        space: that they lie in; where it has hinges, a place has any of them, too.
    """
    places = 2 * anatomy.size * (len(HINGE_NAMES) if space.hinges else 1)
    rules, bent = count_rules(anatomy, genomes)
    return np.log(places) * rules + np.log(_SIDES - 1) * bent


def draw_alike_genomes(
    anatomy: Anatomy, space: BodySpace, count: int, rng: Generator
) -> Genomes:
    """Draw bodies whose like parts hang alike, each once but for its labels.

    The parts of a kind hang on the torso, at even distances round it, or in a row on
    each other, or evenly on the parts of another kind. Or all parts that are left hang
    in one row, whatever their kind.

    Returns:
        The valid ones, the likeliest first.
    """
    kind = classify_parts(anatomy)
    groups = [np.flatnonzero(kind == k) for k in range(kind.max() + 1)]
    groups.sort(key=lambda group: int(group[0]))
    drawn = [_draw_alike(anatomy, space, groups, rng) for _ in range(count)]
    genomes = concatenate_genomes(*drawn)
    genomes = genomes[is_valid(space, genomes)]
    names = np.sort(np.where(genomes.parent == 0, 1 + genomes.side, 0), axis=1)
    names = np.hstack([np.sort(_name_parts(anatomy, genomes), axis=1), names])
    genomes = genomes[np.sort(np.unique(names, axis=0, return_index=True)[1])]
    return genomes[
        np.argsort(compute_prior_cost(anatomy, space, genomes), kind="stable")
    ]


def _draw_alike(
    anatomy: Anatomy, space: BodySpace, groups: list[Ints], rng: Generator
) -> Genomes:
    """One body (1) of groups of like parts; it may be no valid one."""
    parent, place = np.zeros((2, anatomy.size))
    hinge, length = np.zeros(anatomy.size, int), np.zeros(anatomy.size)
    order = range(len(groups)) if anatomy.ordered else rng.permutation(len(groups))
    left, hosts = [groups[k] for k in order], list[Ints]()
    while left:
        group = left.pop(0)
        if left and rng.random() < _ONE_ROW:
            group, left = np.sort(np.concatenate([group, *left])), []
            spots = _place_row
        else:
            spots = _place_group
        if not anatomy.ordered:
            group = rng.permutation(group)
        parent[group], place[group] = spots(group, hosts, rng)
        hinge[group] = rng.integers(len(HINGE_NAMES))
        length[group] = rng.uniform(*LENGTH_RANGE)
        hosts.append(group)
    body = encode_tree(anatomy, parent.astype(int), place % 1.0)
    return replace(
        body,
        hinge=hinge[None] if space.hinges else body.hinge,
        length=length[None] if space.lengths else body.length,
    )


def _place_group(group: Ints, hosts: list[Ints], rng: Generator) -> tuple[Ints, Floats]:
    """Parents and placements [rounds] of the parts of a group (m), drawn alike."""
    count, side = len(group), int(rng.integers(_SIDES))
    fits = [host for host in hosts if count % len(host) == 0]
    choice = int(rng.integers(len(fits) + 1 + (count > 1)))
    middle = (side + 0.5) / _SIDES
    if choice < len(fits):
        host = fits[choice]
        turn = np.repeat(np.arange(count // len(host)), len(host))
        return np.resize(host, count) + 1, middle + turn / _SIDES
    if choice > len(fits):
        return _place_row(group, hosts, rng)
    used = int(rng.choice([n for n in (1, 2, _SIDES) if count % n == 0]))
    row, each = np.divmod(np.arange(count), count // used)
    at = (each + 0.5) / (count // used)
    return np.zeros(count, int), (side + row * (_SIDES // used) + at) / _SIDES


def _place_row(group: Ints, hosts: list[Ints], rng: Generator) -> tuple[Ints, Floats]:
    """The same of a row of parts, each at the same side of the one before."""
    first = rng.choice(np.concatenate([[0], *(host + 1 for host in hosts)]))
    middle = (rng.integers(_SIDES) + 0.5) / _SIDES
    return np.append(first, group[:-1] + 1), np.full(len(group), middle)
