"""A robot that differs from its model."""

import numpy as np
import pytest

from selfheal.recovery.fit_physics import fit_physics
from selfheal.robot.simulated_legs import SimulatedLegs
from tests.support.short_recover import QUADRUPED, ignore_progress


@pytest.fixture(scope="session")
def mismatched(walker):
    """A robot that is off its model, how it walked whole, and how it may be off."""
    robot = SimulatedLegs(QUADRUPED, 0, gap=0.05)
    before = robot.run_trials(walker[None]).sensors[0]
    rng = np.random.default_rng(0)
    rungs = ((20, 6), (30, 6), (40, 5), (60, 5))
    found = fit_physics(QUADRUPED, walker, before, rng, ignore_progress, rungs)
    return robot, before, found
