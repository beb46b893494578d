"""Suites of `recover` on fresh seeds: two robots, all scenarios, three methods."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.recover.alarms import list_alarm_runs
from benchmarks.recover.reference import walk_plain
from benchmarks.recover.unlisted import CHANGES, change_robot, withhold_neurons
from benchmarks.suites import KeyedRuns
from benchmarks.writer import count_cores
from selfheal.body.legged import LEGGED, load_legged_robot
from selfheal.engine.reflex import build_intact_plants, simulate_controllers
from selfheal.evolution.genetic import (
    GENERATIONS,
    Breeding,
    draw_values,
    evolve_population,
    start_population,
)
from selfheal.recovery.recover import recover_robot
from selfheal.recovery.recover_run import (
    RecoverRun,
    RecoverSettings,
    is_damage_named,
)
from selfheal.robot.scenarios import SCENARIOS, TABLE, draw_scenario
from selfheal.robot.simulated_legs import SimulatedLegs

FIRST = 5000
BEYOND = range(len(TABLE) + 1, len(SCENARIOS) + 1)


def list_our_runs(seeds: int) -> KeyedRuns:
    """Runs of our method in all cells of robot and scenario but the tenth's."""
    return _list_runs("ours", seeds, numbers=TABLE[:-1])


def list_tenth_runs(seeds: int) -> KeyedRuns:
    """Runs of our method where a hidden neuron fails."""
    return _list_runs("ours", seeds, numbers=TABLE[-1:])


def list_unlisted_runs(seeds: int) -> KeyedRuns:
    """Runs of our method after changes that are in no list of damages."""
    for seed in range(FIRST, FIRST + seeds):
        for robot in LEGGED[::-1]:
            for what in CHANGES:
                key = f"{robot} {what} {seed}"
                yield key, partial(_recover_changed_robot, robot, what, seed)


def list_described_runs(seeds: int) -> KeyedRuns:
    """Runs of the method as described in 2004, in all twenty cells."""
    return _list_runs("as-described", seeds)


def list_control_runs(seeds: int) -> KeyedRuns:
    """Runs of the control on the quadruped: a lower leg or a leg is lost."""
    return _list_runs("hardware-only", seeds, ("quadruped",), (1, 2))


def list_further_runs(seeds: int) -> KeyedRuns:
    """Runs of our method on the quadruped: graded damage and changed worlds."""
    return _list_runs("ours", seeds, ("quadruped",), BEYOND)


def list_gap_runs(seeds: int) -> KeyedRuns:
    """Runs of our method on a quadruped that is 5 % off its model."""
    return _list_runs("ours", seeds, ("quadruped",), (1, 2, 3, 9), gap=0.05)


def _list_runs(
    method: str,
    seeds: int,
    robots: tuple[str, ...] = LEGGED[::-1],
    numbers: Any = TABLE,
    **more: Any,
) -> KeyedRuns:
    """A run for each seed, robot and scenario."""
    for seed in range(FIRST, FIRST + seeds):
        for robot in robots:
            for number in numbers:
                key = f"{robot} {number} {seed}"
                yield key, partial(_recover_robot, method, robot, number, seed, more)


def _recover_robot(
    method: str, robot: str, number: int, seed: int, more: dict[str, Any]
) -> dict[str, Any]:
    body = load_legged_robot(robot)
    damage = draw_scenario(number, body, seed)
    settings = RecoverSettings(robot, number, damage, method, seed, **more)
    walker = SimulatedLegs(body, seed, settings.gap)
    *_, run = recover_robot(walker, settings)
    kept = _summarize_run(run)
    if method == "hardware-only":
        kept["best"] = np.round(run.phases["hardware"]["best"], 3).tolist()
    return kept


def _recover_changed_robot(robot: str, what: str, seed: int) -> dict[str, Any]:
    walker, place = change_robot(what, load_legged_robot(robot), seed)
    settings = RecoverSettings(robot, 9, (), seed=seed)  # of no scenario: no damage
    with withhold_neurons():
        *_, run = recover_robot(walker, settings)
    return {**_summarize_run(run), "named": None, "what": what, "place": place}


def _summarize_run(run: RecoverRun) -> dict[str, Any]:
    """What a record keeps of a run by any method."""
    settings, result = run.settings, run.result
    kept = {k: getattr(settings, k) for k in ("robot", "scenario", "seed", "method")}
    kept["named"] = is_damage_named(run)
    told = ("damage", "verdict", "hypotheses", "actions", "distance")
    kept |= {k: result[k] for k in told}
    kept["walked"] = [trial["walked"] for trial in result["trials"]]
    return kept


def list_speed_runs(seeds: int) -> KeyedRuns:
    """Runs that time evaluations against plain MuJoCo, in turns on one machine."""
    for seed in range(FIRST, FIRST + seeds):
        for robot in LEGGED[::-1]:
            key = f"{robot} {seed} {count_cores()}"
            yield key, partial(_time_evaluations, robot, seed)


def _time_evaluations(name: str, seed: int) -> dict[str, Any]:
    """CPU and wall seconds of an evaluation, each way."""
    robot, rng = load_legged_robot(name), np.random.default_rng(seed)
    genomes = draw_values(100, robot.synapses, rng)
    spent: dict[str, Any] = {"robot": name, "cores": count_cores()}

    def timed(what: str, count: int, play: Callable[[], Any]) -> None:
        wall, cpu = time.perf_counter(), time.process_time()
        play()
        spent[what] = {"wall": (time.perf_counter() - wall) / count,
                       "cpu": (time.process_time() - cpu) / count}  # fmt: skip

    timed("plain", 20, lambda: [walk_plain(robot, g) for g in genomes[:20]])
    timed(
        "batch",
        100,
        lambda: simulate_controllers(build_intact_plants(robot, 100), genomes),
    )

    breeding = Breeding()

    def search() -> None:
        def score(asked: np.ndarray) -> np.ndarray:
            return simulate_controllers(
                build_intact_plants(robot, len(asked)), asked
            ).displacement

        pool = start_population(np.empty((0, robot.synapses)), score, rng, breeding)
        *_, pool = evolve_population(pool, score, rng, breeding, GENERATIONS - 1)
        spent["asked"] = pool.evaluations

    new = breeding.population - breeding.kept
    timed("search", breeding.population + (GENERATIONS - 1) * new, search)
    return spent


SUITES = {
    "speed": (list_speed_runs, 3),
    "ours": (list_our_runs, 3),
    "tenth": (list_tenth_runs, 10),
    "unlisted": (list_unlisted_runs, 3),
    "alarms": (list_alarm_runs, 100),
    "described": (list_described_runs, 3),
    "hardware": (list_control_runs, 3),
    "beyond": (list_further_runs, 3),
    "gap": (list_gap_runs, 3),
}
