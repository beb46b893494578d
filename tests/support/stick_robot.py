"""A small robot of sticks for tests, and its hidden truth behind exact sensors."""

from dataclasses import dataclass

import numpy as np

from selfheal.body.body import Anatomy, Bodies
from selfheal.body.genome import Genomes, build_bodies, encode_tree
from selfheal.engine.statics import Statics
from selfheal.recording import Episode, Recording, Signal
from selfheal.robot.actions import list_actions_2006

PARTS = 4
# two legs of two parts, none at the same place of its side
PARENT = np.array([0, 0, 1, 2])
PLACEMENT = np.array([0.125, 0.625, 0.375, 0.375])


def anatomy(parts: int = PARTS) -> Anatomy:
    """A square torso and sticks: short ones, then long ones with a box each."""
    block = (np.arange(parts) >= parts // 2)[:, None]
    return Anatomy(
        name="toy",
        parts=tuple(f"part_{i}" for i in range(parts)),
        joints=tuple(f"joint_{i}" for i in range(parts)),
        torso_half=np.array([0.04, 0.04, 0.03]),
        torso_mass=0.5,
        rim=np.array([0.06, 0.06, 0.0]),
        length=np.where(np.arange(parts) < parts // 2, 0.09, 0.12),
        radius=np.full(parts, 0.008),
        mass=np.full(parts, 0.1),
        block_half=block * np.array([0.02, 0.015, 0.02]),
        block_center=0.02 * block[:, 0],
        block_mass=0.02 * block[:, 0],
        feet=(parts,),
    )


def truth_genome() -> Genomes:
    """The genome (1) of the toy's hidden body."""
    return encode_tree(anatomy(), PARENT, PLACEMENT)


@dataclass
class Toy:
    """A robot whose readings are those of the statics engine, and exact.

    Attributes:
        acts: how often it was asked to act.
    """

    name: str = "toy"
    acts: int = 0

    @property
    def anatomy(self) -> Anatomy:
        return anatomy()

    @property
    def actions(self) -> np.ndarray:
        return list_actions_2006(PARTS)

    @property
    def truth(self) -> Bodies:
        return build_bodies(anatomy(), truth_genome())

    def act(self, action: int) -> Recording:
        self.acts += 1
        target = self.actions[action]
        rest = Statics().simulate(self.truth, target[None])
        x, y = np.sin(rest.tilt[0, 1]), -np.sin(rest.tilt[0, 0])
        up = np.array([[x, y, np.sqrt(1 - x * x - y * y)]])
        signals = {
            "vertical": Signal(up, "sensor", "vertical", "1"),
            "clearance": Signal(rest.clearance + 0.01, "sensor", "clearance", "m"),
        }
        servos = tuple(f"{joint}_servo" for joint in self.anatomy.joints)
        episode = Episode(np.zeros(1), target[None], servos, signals)
        return Recording({"only": episode}, "toy")
