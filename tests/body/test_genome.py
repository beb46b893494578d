"""Genomes become the bodies that the papers describe; distances mean what they say."""

from dataclasses import fields, replace

import numpy as np
import pytest

from selfheal.body import body as bodies_of
from selfheal.body import genome as genomes_of
from selfheal.body.body import (
    Bodies,
    compute_part_points,
    compute_rest_frames,
    scale_parts,
)
from selfheal.body.genome import (
    HINGE_NAMES,
    LENGTH_RANGE,
    UP,
    Genomes,
    build_bodies,
    center_on_sides,
    decode_matrix,
    decode_unit_genes,
    draw_genomes,
    encode_tree,
)
from tests.support.stick_robot import anatomy

PARTS = 8
# papers.md 1.3
TRUE_GENES = [0.125, 0.1875, 0.2083, 0.2188, 0.275, 0.3958, 0.4821, 0.5469]


def _genomes(count: int, *, parts: int = PARTS, sides: bool = False) -> Genomes:
    rng = np.random.default_rng(parts)
    return draw_genomes(anatomy(parts), count, rng, sides)


def _bodies(count: int, **options) -> Bodies:
    return build_bodies(anatomy(PARTS), _genomes(count, **options))


def _read_headings(bodies: Bodies) -> np.ndarray:
    """(N, P + 1) directions of level parts [rad]."""
    frame = compute_rest_frames(bodies)[1]
    return np.arctan2(frame[..., 1, 0], frame[..., 0, 0])


def _turned(vectors, angle):
    """Vectors (..., 2) turned by angles (...)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


def test_unit_genes_are_parents_and_placements_in_their_ranges():
    genes = np.random.default_rng(1).random((200, PARTS))
    genes[0], genes[1] = 0.0, 1.0
    genomes = decode_unit_genes(anatomy(PARTS), genes)
    said = (genomes.parent + genomes.placement) / (np.arange(PARTS) + 0.9999)
    np.testing.assert_allclose(said, genes, atol=1e-12)  # papers.md 1.3
    assert (genomes.parent >= 0).all()
    assert (genomes.parent < np.arange(1, PARTS + 1)).all()
    assert ((genomes.placement >= 0) & (genomes.placement < 1)).all()
    np.testing.assert_array_equal(genomes.parent[:2], [[0] * PARTS, range(PARTS)])


def test_the_true_genome_of_2006_is_the_labelled_tree():
    genomes = decode_unit_genes(anatomy(PARTS), np.array(TRUE_GENES))
    np.testing.assert_array_equal(genomes.parent, [[0, 0, 0, 0, 1, 2, 3, 4]])
    # its four decimals are worth 0.0001 x 8
    np.testing.assert_allclose(
        genomes.placement, center_on_sides(genomes).placement, atol=0.001
    )
    np.testing.assert_array_equal(genomes.side, [[0, 1, 2, 3, 1, 1, 1, 1]])


def test_sides_are_the_quarters_of_the_perimeter():
    placement = np.array([[0, 0.2499, 0.25, 0.4999, 0.5, 0.7499, 0.75, 0.9999]])
    genomes = replace(_genomes(1), placement=placement)
    np.testing.assert_array_equal(genomes.side, [[0, 0, 1, 1, 2, 2, 3, 3]])
    np.testing.assert_array_equal(center_on_sides(genomes).side, genomes.side)
    np.testing.assert_array_equal(center_on_sides(genomes).placement % 0.25, 0.125)


@pytest.mark.parametrize("fill", [0.0, 1.0, None])
def test_matrices_decode_into_their_ranges(fill):
    matrix = np.random.default_rng(0).random((300, PARTS, 4))
    matrix = matrix if fill is None else np.full_like(matrix, fill)
    genomes = decode_matrix(anatomy(PARTS), matrix)
    assert (genomes.parent < np.arange(1, PARTS + 1)).all()
    assert (genomes.parent >= 0).all()
    assert set(np.unique(genomes.hinge)) <= set(range(len(HINGE_NAMES)))
    low, high = LENGTH_RANGE
    assert ((genomes.length >= low) & (genomes.length <= high)).all()
    np.testing.assert_array_equal(center_on_sides(genomes).placement, genomes.placement)
    if fill is None:
        assert set(np.unique(genomes.side)) == set(range(4))
        assert set(np.unique(genomes.hinge)) == set(range(len(HINGE_NAMES)))


def test_every_link_is_as_long_as_its_part_and_as_heavy_in_proportion():
    genomes = _genomes(50)
    bodies = build_bodies(anatomy(PARTS), genomes)
    longer = build_bodies(anatomy(PARTS), replace(genomes, length=2 * genomes.length))
    np.testing.assert_allclose(longer.mass, 2 * bodies.mass)
    reach = np.linalg.norm(
        compute_part_points(bodies, 1) - compute_part_points(bodies, 0), axis=2
    )
    np.testing.assert_allclose(reach, bodies.length)
    middle = (compute_part_points(bodies, 0) + compute_part_points(bodies, 1)) / 2
    np.testing.assert_allclose(compute_part_points(bodies, 0.5), middle, atol=1e-12)


def test_directions_add_up_along_the_tree():
    genomes = _genomes(50)
    heading = _read_headings(build_bodies(anatomy(PARTS), genomes))
    for row, parents in enumerate(genomes.parent):
        for i, parent in enumerate(parents):
            turn = 0.75 * np.pi - 2 * np.pi * genomes.placement[row, i]
            off = heading[row, i + 1] - heading[row, parent] - turn
            assert np.cos(off) == pytest.approx(1)


def test_the_middle_of_a_side_means_straight_out_of_it():
    toy = anatomy(4)
    genomes = encode_tree(toy, np.zeros(4, int), np.array([0.125, 0.375, 0.625, 0.875]))
    bodies = build_bodies(toy, genomes)
    out = np.array([[0, 1, 0], [1, 0, 0], [0, -1, 0], [-1, 0, 0]])
    half = np.array([toy.rim[1], toy.rim[0], toy.rim[1], toy.rim[0]])
    tips = (half + toy.length)[:, None] * out
    np.testing.assert_allclose(compute_part_points(bodies, 0)[0], half[:, None] * out)
    np.testing.assert_allclose(compute_part_points(bodies, 1)[0], tips, atol=1e-12)


def test_parts_hang_on_the_perimeter_of_their_parents():
    toy, genomes = anatomy(PARTS), _genomes(100)
    bodies = build_bodies(toy, genomes)
    for row, parents in enumerate(genomes.parent):
        for i, parent in enumerate(parents):
            x, y, z = bodies.anchor[row, i]
            half = toy.rim[:2]
            if parent:
                half = np.array([toy.length[parent - 1] / 2, toy.radius[parent - 1]])
                x -= half[0]
            share = np.abs([x, y]) / half
            assert share.max() == pytest.approx(1)
            assert z == (0 if parent else toy.rim[2])


def test_hinges_of_paper_a_lift_the_part_across_the_line_of_centers():
    toy, genomes = anatomy(PARTS), _genomes(100)
    bodies = build_bodies(toy, genomes)
    assert (genomes.hinge == UP).all()
    length = np.hstack([np.zeros((100, 1)), bodies.length])
    middle = np.take_along_axis(length, genomes.parent, axis=1) / 2
    start = bodies.anchor[..., :2] - np.stack([middle, 0 * middle], axis=2)
    along = np.stack([bodies.length / 2, 0 * bodies.length], axis=2)
    line = start + _turned(along, bodies.heading)
    line /= np.linalg.norm(line, axis=2, keepdims=True)
    axis = _turned(bodies.axis[..., :2], bodies.heading)
    np.testing.assert_allclose((axis * line).sum(axis=2), 0, atol=1e-12)
    rise = axis[..., 0] * line[..., 1] - axis[..., 1] * line[..., 0]
    np.testing.assert_allclose(rise, 1)
    np.testing.assert_array_equal(bodies.axis[..., 2], 0)


@pytest.mark.parametrize("name", HINGE_NAMES)
def test_hinges_of_paper_c_turn_as_they_are_called(name):
    genomes = _genomes(1)
    hinge = np.full_like(genomes.hinge, HINGE_NAMES.index(name))
    bodies = build_bodies(anatomy(PARTS), replace(genomes, hinge=hinge))
    motion = np.cross(bodies.axis[0, 0], [1.0, 0, 0])  # of the tip, in the part's frame
    expected = {"left": [0, 1, 0], "right": [0, -1, 0], "down": [0, 0, -1]}
    expected |= {"roll_left": [0, 0, 0], "roll_right": [0, 0, 0]}
    if name == "up":
        assert motion[2] > 0
    else:
        np.testing.assert_array_equal(motion, expected[name])


def test_rest_frames_are_those_of_a_walk_down_the_tree():
    bodies = _bodies(30)
    origin, heading = compute_rest_frames(bodies)[0], _read_headings(bodies)
    assert not origin[:, 0].any() and not heading[:, 0].any()
    rows = np.arange(30)
    for i in range(PARTS):
        parent = bodies.parent[:, i]
        offset = _turned(bodies.anchor[:, i, :2], heading[rows, parent])
        step = origin[:, i + 1] - origin[rows, parent]
        np.testing.assert_allclose(step[:, :2], offset, atol=1e-12)
        np.testing.assert_allclose(step[:, 2], bodies.anchor[:, i, 2])


def test_a_part_that_points_home_has_its_center_in_the_torso():
    toy = anatomy(2)
    # the second part leaves the end of the first one and is folded back
    tree = encode_tree(toy, np.array([0, 1]), np.array([0.125, 0.375]))
    bodies = build_bodies(toy, tree)
    assert bodies_of.count_centers_in_torso(bodies).tolist() == [0]
    folded = replace(bodies, heading=bodies.heading + np.array([0, np.pi]))
    folded = replace(folded, length=folded.length * np.array([1, 2.0]))
    assert bodies_of.count_centers_in_torso(folded).tolist() == [1]


@pytest.mark.parametrize(
    "distance",
    [
        bodies_of.measure_center_distance,
        bodies_of.measure_tip_distance,
        bodies_of.measure_length_error,
    ],
)
def test_a_distance_is_zero_at_home_and_the_same_both_ways(distance):
    one, other = _bodies(20), _bodies(40)[20:]
    other = replace(other, length=other.length * 1.1)
    np.testing.assert_array_equal(distance(one, one), np.zeros(20))
    assert (distance(one, other) > 0).all()
    np.testing.assert_allclose(distance(one, other), distance(other, one))


def test_distances_of_one_longer_leaf():
    """0.06 m on one of 8 parts: centers 0.03 m apart there, tips 0.06 m."""
    truth = _bodies(20)
    change = np.zeros(PARTS)
    change[-1] = 0.06  # the last part carries nothing
    longer = replace(truth, length=truth.length + change)
    np.testing.assert_allclose(
        bodies_of.measure_center_distance(longer, truth), 3 / PARTS
    )
    np.testing.assert_allclose(bodies_of.measure_tip_distance(longer, truth), 6 / PARTS)
    np.testing.assert_allclose(bodies_of.measure_length_error(longer, truth), 6 / PARTS)
    np.testing.assert_array_equal(bodies_of.compute_edge_f1(longer, truth), 1)


def test_edge_f1_is_that_of_the_sets_of_edges():
    one, other = _bodies(30), _bodies(60)[30:]
    for row, f1 in enumerate(bodies_of.compute_edge_f1(one, other)):
        first = set(zip(one.parent[row], range(PARTS), strict=True))
        second = set(zip(other.parent[row], range(PARTS), strict=True))
        assert f1 == pytest.approx(2 * len(first & second) / (2 * PARTS))


def test_scaled_parts_take_their_children_along():
    bodies = _bodies(30)
    scale = np.random.default_rng(0).uniform(0.1, 2, (30, PARTS))
    scale[0] = 1.0  # changes nothing
    scaled = scale_parts(bodies, scale)
    for name in ("length", "thickness", "mass"):
        before, after = getattr(bodies, name), getattr(scaled, name)
        np.testing.assert_allclose(after, before * scale)
    for row, parents in enumerate(bodies.parent):
        for i, parent in enumerate(parents):
            factor = scale[row, parent - 1] if parent else 1
            expected = bodies.anchor[row, i] * factor
            np.testing.assert_allclose(scaled.anchor[row, i], expected)
    np.testing.assert_array_equal(scaled.heading, bodies.heading)
    for f in fields(Bodies)[1:]:
        after, before = (getattr(b, f.name)[0] for b in (scaled, bodies))
        np.testing.assert_array_equal(after, before)


@pytest.mark.parametrize(
    "make, join",
    [
        (_genomes, genomes_of.concatenate_genomes),
        (_bodies, bodies_of.concatenate_bodies),
    ],
)
def test_a_batch_in_two_pieces_is_the_batch(make, join):
    batch = make(7)
    again = join(batch[:3], batch[np.arange(3, 7)])
    assert len(again) == 7 and len(batch[np.arange(7) % 2 == 0]) == 4
    for f in fields(batch):
        if f.name != "anatomy":
            np.testing.assert_array_equal(
                getattr(again, f.name), getattr(batch, f.name)
            )
