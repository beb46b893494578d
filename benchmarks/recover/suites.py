"""Figures of `recover` on fresh seeds: both robots, all ten scenarios, three methods.

    python benchmarks/recover.py SUITE... [--seeds N]
    python benchmarks/recover.py page

Every suite appends its records to benchmarks/results/recover-SUITE.jsonl and leaves out
what is there already; `page` makes docs/results/recover.md of them. Seeds are 5000 and
up; development used seeds below 5000.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.recover.page import write
from benchmarks.recover.reference import plain_way
from benchmarks.writer import Plays, cores, main
from selfheal.body.legged import LEGGED, legged
from selfheal.engine.reflex import drive, whole
from selfheal.gait.genetic import (
    GENERATIONS,
    KEPT,
    POPULATION,
    begin,
    draw,
    evolve,
)
from selfheal.recovery.recover import named, recover
from selfheal.recovery.recover_run import RecoverSettings
from selfheal.robot.scenarios import SCENARIOS, TABLE, scenario
from selfheal.robot.simulated_legs import SimulatedLegs

FIRST = 5000
BEYOND = range(len(TABLE) + 1, len(SCENARIOS) + 1)


def ours(seeds: int) -> Plays:
    """The twenty cells of the overview, our method."""
    return _cells("ours", seeds)


def described(seeds: int) -> Plays:
    """The twenty cells, as described."""
    return _cells("as-described", seeds)


def hardware(seeds: int) -> Plays:
    """The control, on the quadruped as in the overview: a lower leg or a leg lost."""
    return _cells("hardware-only", seeds, ("quadruped",), (1, 2))


def beyond(seeds: int) -> Plays:
    """Graded damage and changed worlds, our method on the quadruped."""
    return _cells("ours", seeds, ("quadruped",), BEYOND)


def gap(seeds: int) -> Plays:
    """A robot that is 5 % off its model, our method on the quadruped."""
    return _cells("ours", seeds, ("quadruped",), (1, 2, 3, 9), gap=0.05)


def _cells(
    method: str,
    seeds: int,
    robots: tuple[str, ...] = LEGGED[::-1],
    numbers: Any = TABLE,
    **more: Any,
) -> Plays:
    """A run for each seed, robot and scenario."""
    for seed in range(FIRST, FIRST + seeds):
        for robot in robots:
            for number in numbers:
                yield (
                    f"{robot} {number} {seed}",
                    lambda r=robot, n=number, s=seed: _run(method, r, n, s, more),
                )


def _run(
    method: str, robot: str, number: int, seed: int, more: dict[str, Any]
) -> dict[str, Any]:
    body = legged(robot)
    damage = scenario(number, body, seed)
    settings = RecoverSettings(robot, number, damage, method, seed, **more)
    walker = SimulatedLegs(body, seed, settings.gap)
    *_, run = recover(walker, settings)
    kept: dict[str, Any] = {"robot": robot, "scenario": number, "seed": seed,
                            "method": method, "named": named(run)}  # fmt: skip
    result = run.result
    kept |= {k: result[k] for k in ("damage", "hypotheses", "actions", "distance")}
    kept["walked"] = [trial["walked"] for trial in result["trials"]]
    if method == "hardware-only":
        kept["best"] = np.round(run.phases["hardware"]["best"], 3).tolist()
    return kept


def speed(seeds: int) -> Plays:
    """Evaluations a second against plain MuJoCo, in turns on the same machine."""
    for seed in range(FIRST, FIRST + seeds):
        for robot in LEGGED[::-1]:
            key = f"{robot} {seed} {cores()}"
            yield key, lambda r=robot, s=seed: _speed(r, s)


def _speed(name: str, seed: int) -> dict[str, Any]:
    """CPU and wall seconds of an evaluation, each way."""
    robot, rng = legged(name), np.random.default_rng(seed)
    genomes = draw(100, robot.synapses, rng)
    spent: dict[str, Any] = {"robot": name, "cores": cores()}

    def timed(what: str, count: int, play: Callable[[], Any]) -> None:
        wall, cpu = time.perf_counter(), time.process_time()
        play()
        spent[what] = {"wall": (time.perf_counter() - wall) / count,
                       "cpu": (time.process_time() - cpu) / count}  # fmt: skip

    timed("plain", 20, lambda: [plain_way(robot, g) for g in genomes[:20]])
    timed("batch", 100, lambda: drive(whole(robot, 100), genomes))

    def search() -> None:
        def score(asked: np.ndarray) -> np.ndarray:
            return drive(whole(robot, len(asked)), asked).way

        pool = begin(robot.synapses, score, rng)
        *_, pool = evolve(pool, score, rng, GENERATIONS - 1)
        spent["asked"] = pool.asked

    new = POPULATION - KEPT
    timed("search", POPULATION + (GENERATIONS - 1) * new, search)
    return spent


SUITES = {"speed": (speed, 3), "ours": (ours, 3), "described": (described, 3),
          "hardware": (hardware, 3), "beyond": (beyond, 3),
          "gap": (gap, 3)}  # fmt: skip


if __name__ == "__main__":
    main("recover", __doc__ or "", SUITES, write, counted="seeds")
