"""The four-legged robot of papers.md 1.1, its actions, and bodies of its parts."""

import itertools

import numpy as np

from selfheal.body.body import Anatomy, Bodies
from selfheal.body.genome import build_bodies, draw_genomes, encode_tree

STAR_PARENTS = np.array([0, 0, 0, 0, 1, 2, 3, 4])


def _star_anatomy() -> Anatomy:
    """The four-legged robot of papers.md 1.1: upper legs, lower legs with housings."""
    names = [f"{k}_{s}" for k in ("upper", "lower") for s in "lfrb"]
    return Anatomy(
        name="star",
        parts=tuple(names),
        joints=tuple(names),
        torso_half=np.array([0.041, 0.041, 0.0425]),
        torso_mass=0.5,
        rim=np.array([0.07, 0.07, 0.0]),
        length=np.array([0.095] * 4 + [0.125] * 4),
        radius=np.full(8, 0.007),
        mass=np.array([0.143] * 4 + [0.118] * 4),
        block_half=np.array([[0.0, 0, 0]] * 4 + [[0.0185, 0.015, 0.02]] * 4),
        block_center=np.array([0.0] * 4 + [0.0185] * 4),
        block_mass=np.array([0.0] * 4 + [0.023] * 4),
        feet=(5, 6, 7, 8),
    )


def make_stars(count: int) -> Bodies:
    """`count` times the four-legged robot."""
    placement = np.array([0.125, 0.375, 0.625, 0.875] + [0.375] * 4)
    star = build_bodies(ANATOMY, encode_tree(ANATOMY, STAR_PARENTS, placement))
    return star[np.zeros(count, int)]


def list_star_actions() -> np.ndarray:
    """(36, 8) one or two joints at -30 degrees, all others at 30 (papers.md 1.2)."""
    joints = range(8)
    lowered = [*((i,) for i in joints), *itertools.combinations(joints, 2)]
    targets = np.full((len(lowered), 8), np.radians(30))
    for row, chosen in enumerate(lowered):
        targets[row, list(chosen)] *= -1
    return targets


def draw_trees(count: int) -> Bodies:
    """Robots of the same parts with random attachment trees."""
    genomes = draw_genomes(ANATOMY, count, np.random.default_rng(0), False)
    return build_bodies(ANATOMY, genomes)


ANATOMY = _star_anatomy()
