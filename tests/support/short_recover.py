"""A quadruped, what it may lose, and searches of controllers that take a second."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from selfheal.body.legged import LeggedRobot, load_legged_robot
from selfheal.damage.kinds import Damage
from selfheal.engine.reflex import build_intact_plants, simulate_controllers
from selfheal.evolution.genetic import Breeding, draw_values
from selfheal.recovery import explain, recover
from selfheal.recovery.estimate import Trial
from selfheal.robot.simulated_legs import SimulatedLegs

LOST = Damage("limb_loss", "body:left_front_upper")
LOWER = Damage("limb_loss", "body:left_front_lower")
JAM = Damage("joint_jam", "joint:right_back_hip")
DEAF = Damage("sensor_dead", "sensor:left_back_lower_touch")

QUADRUPED = load_legged_robot("quadruped")
FLAT = np.full((200, 8), 0.05)  # scale of residuals that no time or sensor changes
BUILT = np.ones((1, 10))  # factors of a model that is right


def shorten(patch: Callable[[object, str, object], None]) -> None:
    """Make searches short, by `setattr` or one that undoes."""
    small = Breeding(population=12, kept=4, pairs=2)
    patch(recover, "AS_DESCRIBED", small)
    patch(recover, "OURS", replace(small, mutation=0.03))
    patch(recover, "HARDWARE_GENERATIONS", 2)
    patch(explain, "list_single_damages", lambda robot: [LOST, LOWER, JAM, DEAF])


def draw_weights(
    count: int, robot: LeggedRobot = QUADRUPED, seed: int = 0
) -> np.ndarray:
    """Random weights (count, synapses) of controllers."""
    return draw_values(count, robot.synapses, np.random.default_rng(seed))


def find_walker() -> np.ndarray:
    """Weights with which the whole quadruped goes farthest of a few."""
    weights = draw_weights(60)
    walks = simulate_controllers(build_intact_plants(QUADRUPED, 60), weights)
    return weights[np.argmax(walks.displacement)]


def ignore_progress(share: float) -> None:
    """Progress that nobody sees."""


def walk_before(weights: np.ndarray) -> np.ndarray:
    """Sensor series (T, S) of the whole robot."""
    return SimulatedLegs(QUADRUPED, 0).run_trials(weights[None]).sensors[0]


def walk_damaged(
    damage: tuple[Damage, ...], weights: np.ndarray, gap: float = 0.0
) -> Trial:
    """A trial of the damaged robot, which differs from its model by a gap."""
    drives = SimulatedLegs(QUADRUPED, 0, gap).struck(damage).run_trials(weights[None])
    return Trial(weights, float(drives.displacement[0]), drives.sensors[0])
