"""The actions and the published body of the starfish of 2006."""

from importlib.resources import as_file, files
from itertools import combinations

import numpy as np

from ..body.body import Anatomy, Bodies, Floats

SWING = np.radians(30.0)  # papers.md 1.2


def list_actions_2006(joints: int = 8) -> Floats:
    """(A, joints) [rad]: one or two joints at -30 degrees, the others at +30.

    For 8 joints these are the 36 actions of papers.md 1.2, singles first.
    """
    chosen = [(i,) for i in range(joints)] + list(combinations(range(joints), 2))
    targets = np.full((len(chosen), joints), SWING)
    for row, down in zip(targets, chosen, strict=True):
        row[list(down)] = -SWING
    return targets


def describe_action(anatomy: Anatomy, target: Floats) -> str:
    """An action (P) [rad] in words: the joints that go down, the others up."""
    down = [j for j, angle in zip(anatomy.joints, target, strict=True) if angle < 0]
    return (", ".join(down) or "no joint") + " down"


def load_published_body() -> Bodies:
    """The starfish put together from its printed dimensions, with its anatomy."""
    from ..body.mjcf import load

    with as_file(files("selfheal.models") / "starfish" / "published.xml") as path:
        return load(path)
