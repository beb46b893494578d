"""Searches for the body of the stick robot."""

from dataclasses import replace

import numpy as np

from selfheal.body.genome import Genomes, build_bodies, draw_genomes
from selfheal.engine.arrays import plan_race
from selfheal.engine.statics import Statics
from selfheal.selfmodel.evaluate import Evaluator, Evidence, Loss
from selfheal.selfmodel.search import RivalSearch
from selfheal.selfmodel.space import find_space
from selfheal.selfmodel.symmetry import SymmetryGroup
from tests.support.stick_robot import Toy, anatomy, truth_genome

TOY = Toy()
FREE = find_space("free")


class WavesEngine:
    """Statics without its race; it may fail on all bodies shaped like the truth."""

    name = "slow"

    def __init__(self, batch: int, *, fails: bool = False) -> None:
        self.batch, self.fails = batch, fails

    def simulate(self, bodies, targets):
        rest = Statics().simulate(bodies, targets)
        failed = self.fails & has_true_shape(bodies)
        for values in (rest.tilt, rest.clearance, rest.touch, rest.channels):
            values[failed] = np.nan
        return replace(rest, failed=failed)


def has_true_shape(bodies) -> np.ndarray:
    """(N) whether two parts hang on the torso and the others on one of them each."""
    return (np.sort(bodies.parent, axis=1) == [0, 0, 1, 2]).all(axis=1) & (
        bodies.parent[:, :2] == 0
    ).all(axis=1)


def make_evaluator(engine=None, loss: Loss | None = None) -> Evaluator:
    """An evaluator of stick robots."""
    return Evaluator(TOY.anatomy, engine or Statics(), actions=TOY.actions, loss=loss)


def measure_evidence(*tried: int) -> Evidence:
    """Readings of the stick robot under some actions."""
    felt = make_evaluator().compute_table(truth_genome())[0]
    return Evidence(tried, felt[list(tried)])


def draw_sticks(count: int) -> Genomes:
    """Random genomes of the stick robot."""
    return draw_genomes(anatomy(), count, np.random.default_rng(2), False)


def make_search(evaluator: Evaluator) -> RivalSearch:
    """A search for bodies of the stick robot."""
    twins = SymmetryGroup.from_actions(TOY.anatomy, TOY.actions, hinges_known=True)
    return RivalSearch(FREE, evaluator, twins)


def race_sticks(
    evaluator: Evaluator, genomes: Genomes, evidence: Evidence, order, bound=np.inf
) -> tuple[np.ndarray, np.ndarray]:
    """Losses (N) of bodies, and (N, n) under each action, of a race."""
    race = plan_race(len(genomes), np.asarray(order), bound)
    return evaluator.compute_losses(build_bodies(anatomy(), genomes), evidence, race)
