"""What runs cost as they grow, and what thousands of workers leave of a study.

    python -m benchmarks.performance.study_scale

Measures short runs by parts, actions and sensors, and what the one process of a study's
client and scheduler spends on a run; imagines studies of up to 10,000 workers with
that; gives docs/results/study-scale.md.
"""

import heapq
import os
import tempfile
import time
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.performance.study_empty import STUDY
from benchmarks.writer import Section, make_parser, publish_results
from selfheal.body.body import Anatomy, Bodies
from selfheal.body.genome import build_bodies, draw_genomes
from selfheal.engine.statics import Statics
from selfheal.robot.actions import list_actions_2006, load_published_body
from selfheal.robot.simulated import SimulatedRobot
from selfheal.selfmodel.loop import identify_body
from selfheal.selfmodel.run import Settings
from selfheal.selfmodel.schema import SENSOR_SETS
from selfheal.selfmodel.symmetry import SymmetryGroup
from selfheal.study.execute import execute_tasks
from selfheal.study.plan import Task, find_study
from selfheal.study.store import create_study, open_journal
from selfheal.study.workers import Workplace, connect_workers

_PARTS, _ACTIONS, _SEEDS = (4, 6, 8, 10, 12), (2, 4, 8, 16), 3
_CYCLES, _BUDGET = 4, 8_000  # actions and simulations of a short run
_POSES = 20_000  # that a simulation is measured by
_EMPTY = 2_000  # empty runs that a study's one process is measured by
_WORKERS, _SECONDS = (100, 1_000, 10_000), (1, 10, 60)
_AHEAD, _EACH = 2, 20  # tasks that a worker has (Dask's default), runs of each in all
Row = dict[str, float]


def make_anatomy(parts: int) -> Anatomy:
    """The starfish's anatomy with another even number of parts, upper ones first."""
    known, half = load_published_body().anatomy, parts // 2
    rows = [k % 4 for k in range(half)] + [4 + k % 4 for k in range(half)]
    columns = ("length", "radius", "mass", "block_half", "block_center", "block_mass")
    return replace(
        known,
        parts=tuple(f"part_{k}" for k in range(parts)),
        joints=tuple(f"joint_{k}" for k in range(parts)),
        feet=tuple(range(half + 1, parts + 1)),
        **{name: getattr(known, name)[rows] for name in columns},
    )


def measure_by_parts() -> list[Row]:
    """CPU of short runs of hidden random trees, by the number of parts."""
    rows = []
    for parts in _PARTS:
        anatomy, rng = make_anatomy(parts), np.random.default_rng([parts, 0])
        bodies = build_bodies(anatomy, draw_genomes(anatomy, _POSES, rng, False))
        actions = list_actions_2006(parts)
        targets = actions[rng.integers(len(actions), size=_POSES)]
        start = time.process_time()
        Statics().simulate(bodies, targets)
        pose = (time.process_time() - start) / _POSES
        twins = SymmetryGroup.from_actions(anatomy, actions, hinges_known=True)
        runs = [_time_run(bodies[[k]], seed=k, cycles=_CYCLES) for k in range(_SEEDS)]
        rows.append(
            {
                "parts": parts,
                "actions": len(actions),
                "pose": pose,
                "twins": len(twins.turns) * len(twins.trade),
                **_average_rows(runs),
            }
        )
    return rows


def measure_by_actions() -> list[Row]:
    """CPU of runs by the number of actions, with as many simulations for each."""
    body = load_published_body()
    return [
        {
            "cycles": n,
            **_average_rows([_time_run(body, seed=k, cycles=n) for k in range(_SEEDS)]),
        }
        for n in _ACTIONS
    ]


def measure_by_sensors() -> list[dict[str, Any]]:
    """CPU of runs of study `schema`, our way, by the set of sensors."""
    play, rows = find_study("schema").run_task, []
    for names in SENSOR_SETS:
        asked = {"robot": "starfish", "what": "ours", "sensors": "+".join(names)}
        start = time.process_time()
        outcome = play({**asked, "seed": 0})
        spent = time.process_time() - start
        rows.append({"sensors": "+".join(names), "seconds": spent,
                     "search": outcome["evaluations"]})  # fmt: skip
    return rows


def _time_run(body: Bodies, *, seed: int, cycles: int) -> Row:
    """CPU of a short run [s], and its simulations."""
    robot: Any = SimulatedRobot("starfish", body, seed)
    budget = _BUDGET * cycles // _CYCLES
    asked = Settings("starfish", engine="statics", cycles=cycles, budget=budget)
    start = time.process_time()
    *_, run = identify_body(robot, replace(asked, seed=seed))
    spent = time.process_time() - start
    counts = run.counts
    return {"seconds": spent, "search": counts["statics"], "choice": counts["choice"]}


def _average_rows(rows: list[Row]) -> Row:
    return {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}


def measure_service(folder: Path) -> float:
    """CPU [s] that client, scheduler and writer, one process, spend on an empty run."""
    tasks = [Task(f"run {k}", {"seed": k}) for k in range(_EMPTY)]
    file = folder / "study.h5"
    create_study(file, "empty", {}, tasks)
    with (
        connect_workers(Workplace(workers=1), folder) as client,
        open_journal(file) as journal,
    ):
        client.wait_for_workers(1)
        start = time.process_time()
        for records, _ in execute_tasks(client, STUDY, tasks):
            journal.add(records)
        return (time.process_time() - start) / _EMPTY


def simulate_utilization(workers: int, seconds: float, service: float) -> float:
    """Share of their time for which workers work when one server hands out the runs.

    Every worker starts with nothing, has two runs at hand where it can, and gets the
    next one when the server comes to its last answer. Runs take 0.5 to 1.5 times as
    long as stated.

    Args:
        seconds: [s] of a run, on average.
        service: [s] that the server spends on a run.
    """
    rng, left = np.random.default_rng(0), workers * _EACH
    free = worked = now = 0.0  # when the server is free; work done; the time
    at_hand, idle = np.zeros(workers, int), np.ones(workers, bool)
    events = list[tuple[float, int, bool]]()  # when, worker, whether it has ended a run
    for worker in [w for _ in range(_AHEAD) for w in range(workers)]:
        free, left = free + service, left - 1
        events.append((free, worker, False))
    while events:
        now, worker, ended = heapq.heappop(events)
        if ended and left:
            free, left = max(now, free) + service, left - 1
            heapq.heappush(events, (free, worker, False))
        idle[worker] |= ended
        at_hand[worker] += not ended
        if idle[worker] and at_hand[worker]:
            at_hand[worker] -= 1
            idle[worker] = False
            spent = seconds * rng.uniform(0.5, 1.5)
            worked += spent
            heapq.heappush(events, (now + spent, worker, True))
    return worked / (now * workers)


def _make_sections(found: dict[str, Any]) -> list[Section]:
    service = found["service"]
    rows = [
        (
            f"{workers:,}",
            f"{seconds}",
            f"{workers / seconds:,.0f}",
            f"{100 * share:.0f} %",
        )
        for workers, seconds, share in found["busy"]
    ]
    return [
        Section(
            "Parts",
            f"Hidden random trees, {_CYCLES} actions, {_BUDGET:,} simulations, "
            f"{_SEEDS} runs each; CPU on one core. A pose: a simulation of `statics`. "
            "Twins: bodies whose readings one body's under every action tell.",
            ("parts", "actions offered", "twins", "a pose [us]", "a run [s]",
             "of it the search's poses [s]", "poses for choosing"),
            [(r["parts"], r["actions"], f"{r['twins']:,}", f"{1e6 * r['pose']:.0f}",
              f"{r['seconds']:.2f}", f"{r['pose'] * r['search']:.2f}",
              f"{r['choice']:,.0f}") for r in found["parts"]],
        ),
        Section(
            "Actions",
            f"The starfish, {_BUDGET // _CYCLES:,} simulations an action.",
            ("actions", "a run [s]", "an action [s]", "poses for choosing"),
            [(r["cycles"], f"{r['seconds']:.2f}", f"{r['seconds'] / r['cycles']:.2f}",
              f"{r['choice']:,.0f}") for r in found["actions"]],
        ),
        Section(
            "Sensors",
            "`study schema`, our way, hidden robot, one run each.",
            ("sensors", "a run [s]", "simulations"),
            [(r["sensors"], f"{r['seconds']:.2f}", f"{r['search']:,}")
             for r in found["sensors"]],
        ),
        Section(
            "Thousands of workers, imagined",
            f"Client, scheduler and writer are one process, which spends "
            f"{1000 * service:.2f} ms of CPU on an empty run of one worker (measured, "
            f"{_EMPTY:,} runs): {1 / service:,.0f} runs a second at most. With that, "
            f"{_EACH} runs a worker, the next one at hand where the process keeps up: "
            "the share of their time, start and end included, for which workers work. "
            "Not imagined: what thousands of connections cost, and a network.",
            ("workers", "seconds a run", "runs a second asked for", "workers work"),
            rows,
        ),
    ]  # fmt: skip


def main() -> None:
    """Measure what runs cost, simulate many workers, and publish."""
    options = make_parser(__doc__ or "").parse_args()
    os.environ["NPROC"] = "1"  # as in a worker
    _time_run(load_published_body(), seed=0, cycles=2)  # compiles
    found: dict[str, Any] = {
        "parts": measure_by_parts(),
        "actions": measure_by_actions(),
        "sensors": measure_by_sensors(),
    }
    with tempfile.TemporaryDirectory(prefix="study-") as room:
        found["service"] = measure_service(Path(room))
    found["busy"] = [
        (workers, seconds, simulate_utilization(workers, seconds, found["service"]))
        for workers, seconds in product(_WORKERS, _SECONDS)
    ]
    title = "Studies: what they cost as they grow"
    publish_results(options.root, "study-scale", title, _make_sections(found), found)


if __name__ == "__main__":
    main()
