"""Suites of `recover` on fresh seeds: two robots, all scenarios, three methods."""

import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from benchmarks.recover.alarms import list_alarm_runs
from benchmarks.recover.reference import walk_plain
from benchmarks.recover.unlisted import CHANGES, change_robot, withhold_neurons
from benchmarks.suites import KeyedRuns, Record, Suites
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


def list_runs(
    seeds: int,
    *,
    method: str = "ours",
    robots: Sequence[str] = LEGGED[::-1],
    numbers: Iterable[int] = TABLE,
    gap: float = 0.0,
) -> KeyedRuns:
    """A run for each seed, robot and scenario.

    Args:
        gap: share by which the robot is off its model.
    """
    for seed in range(FIRST, FIRST + seeds):
        for robot in robots:
            for number in numbers:
                play = partial(_recover_robot, method, robot, number, seed, gap)
                yield f"{robot} {number} {seed}", play


def list_unlisted_runs(seeds: int) -> KeyedRuns:
    """Runs of our method after changes that are in no list of damages."""
    for seed in range(FIRST, FIRST + seeds):
        for robot in LEGGED[::-1]:
            for what in CHANGES:
                key = f"{robot} {what} {seed}"
                yield key, partial(_recover_changed_robot, robot, what, seed)


def _recover_robot(
    method: str, robot: str, number: int, seed: int, gap: float
) -> Record:
    body = load_legged_robot(robot)
    damage = draw_scenario(number, body, seed)
    settings = RecoverSettings(robot, number, damage, method, seed, gap=gap)
    walker = SimulatedLegs(body, seed, settings.gap)
    *_, run = recover_robot(walker, settings)
    kept = _summarize_run(run)
    if method == "hardware-only":
        kept["best"] = np.round(run.phases["hardware"]["best"], 3).tolist()
    return kept


def _recover_changed_robot(robot: str, what: str, seed: int) -> Record:
    walker, place = change_robot(what, load_legged_robot(robot), seed)
    settings = RecoverSettings(robot, 9, (), seed=seed)  # of no scenario: no damage
    with withhold_neurons():
        *_, run = recover_robot(walker, settings)
    return {**_summarize_run(run), "named": None, "what": what, "place": place}


def _summarize_run(run: RecoverRun) -> Record:
    """What a record keeps of a run by any method."""
    settings, result = run.settings, run.result
    kept = {k: getattr(settings, k) for k in ("robot", "scenario", "seed", "method")}
    kept["named"] = is_damage_named(run)
    names = ("damage", "verdict", "hypotheses", "actions", "distance")
    kept |= {k: result[k] for k in names}
    kept["walked"] = [trial["walked"] for trial in result["trials"]]
    return kept


def list_speed_runs(seeds: int) -> KeyedRuns:
    """Runs that time evaluations against plain MuJoCo, in turns on one machine."""
    for seed in range(FIRST, FIRST + seeds):
        for robot in LEGGED[::-1]:
            key = f"{robot} {seed} {count_cores()}"
            yield key, partial(_time_evaluations, robot, seed)


def _time_evaluations(name: str, seed: int) -> Record:
    """CPU and wall seconds of an evaluation, each way."""
    robot, rng = load_legged_robot(name), np.random.default_rng(seed)
    genomes = draw_values(100, robot.synapses, rng)
    spent: Record = {"robot": name, "cores": count_cores()}

    def timed(what: str, count: int, play: Callable[[], Any]) -> None:
        wall, cpu = time.perf_counter(), time.process_time()
        play()
        spent[what] = {
            "wall": (time.perf_counter() - wall) / count,
            "cpu": (time.process_time() - cpu) / count,
        }

    timed("plain", 20, lambda: [walk_plain(robot, g) for g in genomes[:20]])
    timed(
        "batch",
        100,
        lambda: simulate_controllers(build_intact_plants(robot, 100), genomes),
    )

    breeding = Breeding()

    def search() -> None:
        def score(weights: np.ndarray) -> np.ndarray:
            return simulate_controllers(
                build_intact_plants(robot, len(weights)), weights
            ).displacement

        pool = start_population(np.empty((0, robot.synapses)), score, rng, breeding)
        *_, pool = evolve_population(pool, score, rng, breeding, GENERATIONS - 1)
        spent["evaluations"] = pool.evaluations

    new = breeding.population - breeding.kept
    timed("search", breeding.population + (GENERATIONS - 1) * new, search)
    return spent


_QUADRUPED = ("quadruped",)
SUITES: Suites = {
    "speed": (list_speed_runs, 3),
    "ours": (partial(list_runs, numbers=TABLE[:-1]), 3),
    "tenth": (partial(list_runs, numbers=TABLE[-1:]), 10),
    "unlisted": (list_unlisted_runs, 3),
    "alarms": (list_alarm_runs, 100),
    "described": (partial(list_runs, method="as-described"), 3),
    "hardware": (
        partial(list_runs, method="hardware-only", robots=_QUADRUPED, numbers=(1, 2)),
        3,
    ),
    "beyond": (partial(list_runs, robots=_QUADRUPED, numbers=BEYOND), 3),
    "gap": (
        partial(list_runs, robots=_QUADRUPED, numbers=(1, 2, 3, 9), gap=0.05),
        3,
    ),
}
