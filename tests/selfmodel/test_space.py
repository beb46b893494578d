"""Spaces of bodies: neighbors, changes, crosses, keys."""

import numpy as np
import pytest

from selfheal.body.genome import HINGE_NAMES, concatenate_genomes
from selfheal.selfmodel.space import (
    SPACES,
    cross_genomes,
    draw_nudges,
    draw_space_genomes,
    find_space,
    is_same,
    is_valid,
    keep_others,
    list_changes,
    list_neighbors,
    make_genome_key,
    perturb_genome,
)
from tests.support.stick_robot import PARTS, anatomy
from tests.support.stick_search import draw_sticks


@pytest.mark.parametrize("name", SPACES)
def test_neighbors_are_other_bodies_of_the_space(name):
    space, rng = find_space(name), np.random.default_rng(0)
    for row in range(5):
        genome = draw_space_genomes(anatomy(), space, 5, rng)[[row]]
        fine = keep_others(space, draw_nudges(space, genome, rng), genome)
        for around in (list_neighbors(space, genome), fine):
            assert is_valid(space, around).all()
            assert not is_same(around, genome).any()
            assert ((around.placement >= 0) & (around.placement < 1)).all()
            if not space.hinges:
                assert (around.hinge == genome.hinge).all()
            if not space.lengths:
                assert (around.length == genome.length).all()
            if space.sides:
                np.testing.assert_allclose(around.placement % 0.25, 0.125)
        coarse = list_neighbors(space, genome)
        assert (coarse.length == genome.length).all()
        assert (coarse.parent != genome.parent).any(axis=1).any()


def test_one_change_brings_a_part_to_any_place_with_any_hinge():
    """Two changes through a body that fits worse are not climbed."""
    space, rng = find_space("full"), np.random.default_rng(0)
    genome = draw_space_genomes(anatomy(), space, 1, rng)
    around = concatenate_genomes(genome, list_neighbors(space, genome))
    for part in range(genome.parent.shape[1]):
        spots = np.column_stack(
            [around.parent[:, part], around.side[:, part], around.hinge[:, part]]
        )
        rest = np.delete(np.arange(genome.parent.shape[1]), part)
        still = np.ones(len(around), bool)
        for gene in ("parent", "placement", "hinge"):
            values = getattr(around, gene)[:, rest]
            still &= (values == getattr(genome, gene)[:, rest]).all(axis=1)
        assert len(np.unique(spots[still], axis=0)) == 4 * (part + 1) * len(HINGE_NAMES)


def test_the_same_row_is_the_same_change_of_every_body():
    space, rng = find_space("full"), np.random.default_rng(0)
    pair = [
        list_changes(space, draw_space_genomes(anatomy(), space, 1, rng))
        for _ in range(2)
    ]
    assert len(pair[0]) == len(pair[1])
    row = 0
    for part in range(PARTS):
        spots = 4 * (part + 1) * len(HINGE_NAMES)
        for gene in ("parent", "placement", "hinge"):
            one, other = (getattr(g, gene)[row : row + spots, part] for g in pair)
            np.testing.assert_array_equal(one, other)
        row += spots


def test_a_neighbor_of_a_neighbor_can_be_the_body_itself():
    rng = np.random.default_rng(0)
    genome = draw_space_genomes(anatomy(), find_space("sides"), 1, rng)
    around = list_neighbors(find_space("sides"), genome)
    assert any(
        is_same(list_neighbors(find_space("sides"), around[[k]]), genome).any()
        for k in range(5)
    )


@pytest.mark.parametrize("name", SPACES)
def test_perturbed_and_crossed_genomes_stay_in_the_space(name):
    space, rng = find_space(name), np.random.default_rng(1)
    parents = draw_space_genomes(anatomy(), space, 40, rng)
    for row in range(0, 40, 2):
        kick = perturb_genome(space, parents[[row]], rng)
        child = cross_genomes(parents[[row]], parents[[row + 1]], rng)
        for genome in (kick, child):
            assert len(genome) == 1 and is_valid(space, genome).all()
            if space.sides:
                np.testing.assert_allclose(genome.placement % 0.25, 0.125)
        either = (child.parent == parents.parent[row]) | (
            child.parent == parents.parent[row + 1]
        )
        assert either.all()


def test_equal_bodies_have_equal_keys():
    genomes = concatenate_genomes(draw_sticks(20), draw_sticks(20))
    keys = [make_genome_key(genomes, row) for row in range(40)]
    assert keys[:20] == keys[20:] and len(set(keys)) == 20
