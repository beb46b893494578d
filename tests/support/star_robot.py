"""The four-legged robot of papers.md 1.1, its actions, and bodies of its parts."""

import numpy as np

from selfheal.body.body import Bodies
from selfheal.body.genome import build_bodies, draw_genomes
from selfheal.robot.actions import list_actions_2006, load_published_body

STAR = load_published_body()
ANATOMY = STAR.anatomy
ACTIONS = list_actions_2006()


def make_stars(count: int) -> Bodies:
    """`count` times the four-legged robot."""
    return STAR[np.zeros(count, int)]


def draw_trees(count: int) -> Bodies:
    """Robots of the same parts with random attachment trees."""
    genomes = draw_genomes(ANATOMY, count, np.random.default_rng(0), False)
    return build_bodies(ANATOMY, genomes)
