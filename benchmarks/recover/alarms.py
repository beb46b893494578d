"""How often a listed damage is taken for unlisted: a seed in, two tests of it out."""

from functools import partial
from typing import Any

import numpy as np

from benchmarks.suites import KeyedRuns, Record
from selfheal.body.legged import LEGGED, LeggedRobot, load_legged_robot
from selfheal.damage.kinds import Damage
from selfheal.engine.reflex import build_intact_plants, simulate_controllers
from selfheal.evolution.genetic import Breeding, draw_values
from selfheal.recovery.estimate import Trial
from selfheal.recovery.explain import estimate_damage, list_single_damages
from selfheal.recovery.predictive_check import is_refuted
from selfheal.robot.simulated_legs import SimulatedLegs

FIRST = 6000
# values of a damage that has one: between those of the list, and at their ends
_RANGES = {
    "weak_motor": (0.05, 0.95),
    "weak_sensor": (0.05, 0.95),
    "slope": (0.03, 0.25),
    "ground_friction": (0.1, 0.5),
    "wind": (2.0, 12.0),
}


def list_alarm_runs(seeds: int) -> KeyedRuns:
    """Tests of a listed damage of a random kind, place and value."""
    for seed in range(FIRST, FIRST + seeds):
        for robot in LEGGED[::-1]:
            yield f"{robot} {seed}", partial(_check_damage, robot, seed)


def _check_damage(name: str, seed: int) -> Record:
    """Fit one walk, test with another, fit both where that refutes the first fit."""
    robot, rng = load_legged_robot(name), np.random.default_rng([seed, 44])
    damage = _draw_damage(robot, rng)
    first, second = _find_walkers(robot, rng)
    whole = SimulatedLegs(robot, seed)
    before = whole.run_trials(first[None]).sensors[0]
    broken = whole.struck((damage,)).run_trials(np.array([first, second]))
    trials = [
        Trial(weights, float(broken.displacement[k]), broken.sensors[k])
        for k, weights in enumerate((first, second))
    ]
    trims = np.ones((1, 2 + len(robot.motors)))

    def estimate(moves: list[Trial], known: tuple) -> Any:
        return estimate_damage(robot, trims, moves, before, known, lambda share: None)

    belief = estimate(trials[:1], ())
    refuted = unlisted = is_refuted(robot, trims, belief, trials[1:], rng)
    if refuted:
        belief = estimate(trials, belief.hypotheses)
        unlisted = is_refuted(robot, trims, belief, trials, rng)
    said = belief.hypotheses[0]
    named = [(d.kind, d.target) for d in said] == [(damage.kind, damage.target)]
    return {
        "robot": name,
        "seed": seed,
        "damage": damage.document,
        "named": named,
        "refuted": refuted,
        "unlisted": unlisted,
        "believed": [d.document for d in said],
    }


def _draw_damage(robot: LeggedRobot, rng: np.random.Generator) -> Damage:
    """A damage of the list, each kind as often, its value anywhere in its range."""
    listed = list_single_damages(robot)
    kind = rng.choice(list(dict.fromkeys(d.kind for d in listed)))
    of_kind = [d for d in listed if d.kind == kind]
    target = of_kind[rng.integers(len(of_kind))].target
    value = float(rng.uniform(*_RANGES.get(kind, (0.0, 0.0))))
    azimuth = float(rng.uniform(0, 2 * np.pi)) if kind in ("slope", "wind") else 0.0
    return Damage(str(kind), target, value, azimuth)


def _find_walkers(robot: LeggedRobot, rng: np.random.Generator) -> np.ndarray:
    """(2, synapses) weights with which the whole robot goes farthest of a few."""
    weights = draw_values(Breeding().population, robot.synapses, rng)
    walks = simulate_controllers(build_intact_plants(robot, len(weights)), weights)
    return weights[np.argsort(-walks.displacement)[:2]]
