"""Suites of `gait`, `watch` and `heal` on fresh seeds, and on readings of 2006."""

from collections.abc import Callable
from functools import cache, partial
from itertools import islice
from typing import Any

import numpy as np

from benchmarks.suites import KeyedRuns, Record
from benchmarks.writer import INTACT
from selfheal.body.body import measure_length_error
from selfheal.damage.apply import apply_damages
from selfheal.engine.plant import build_rated_plant
from selfheal.engine.walk import compute_channels, list_channels, rotate_into_frame
from selfheal.gait.pattern import find_pattern
from selfheal.gait.rival_bodies import select_rival_bodies
from selfheal.gait.synthesis import (
    Gait,
    GaitTask,
    LikelyPlants,
    project_on_heading,
    synthesize_gaits,
    walk_gait,
)
from selfheal.recording import read
from selfheal.recovery.heal import heal_robot
from selfheal.recovery.monitor import learn_baseline, watch_walk
from selfheal.recovery.phases import (
    LEARNING_TIME,
    WATCHING_TIME,
    make_robot_states,
    read_damage,
)
from selfheal.recovery.predict_actions import (
    ActionTables,
    infer_damage,
    predict_actions,
)
from selfheal.recovery.record import HealRun, HealSettings, read_gait
from selfheal.robot.accidents import BODY_KINDS, WORLD_KINDS, draw_damage
from selfheal.robot.actions import load_published_body
from selfheal.robot.base import require_walker
from selfheal.robot.open_robot import open_robot
from selfheal.robot.read_channels import (
    read_channels,
    read_orientation,
    read_position,
)
from selfheal.robot.replay import replay
from selfheal.selfmodel.loop import identify_body
from selfheal.selfmodel.run import Settings

FIRST = 5000
ROBOTS = 2  # hidden robots of `heals`, each identified once


def list_real_runs(count: int) -> KeyedRuns:
    """Runs that name the damage of the robot of 2006, by chosen or random actions."""
    for seed in range(FIRST, FIRST + count):
        for chosen in (True, False):
            yield f"{seed} {chosen}", partial(_name_real_damage, seed, chosen)


def _name_real_damage(seed: int, chosen: bool) -> Record:
    known, rng = _read_tables(), np.random.default_rng(seed)
    parts = load_published_body().anatomy.parts
    steps = []
    for _, belief in islice(infer_damage(known, rng, chosen=chosen), 10):
        names = [d.name for d in known.damages]
        pairs = list(zip(belief, names, strict=True))
        of = {p: float(sum(b for b, n in pairs if n == p)) for p in parts}
        steps.append({p: round(share, 4) for p, share in of.items()})
    return {"chosen": chosen, "steps": steps}


@cache
def _read_tables() -> ActionTables:
    body = load_published_body()
    robots: list[Any] = [
        replay(
            "starfish-2006", read(INTACT.with_name(f"{name}.h5")), body.anatomy, body
        )
        for name in ("intact", "damaged")
    ]
    return predict_actions(robots[0], robots[1], body)


def list_gait_runs(count: int) -> KeyedRuns:
    """Runs that synthesize a gait and walk it on three hidden robots."""
    for seed in range(FIRST, FIRST + count):
        for name in ("waves", "poses") if seed < FIRST + count // 3 else ("waves",):
            yield f"{seed} {name}", partial(_walk_gait, seed, name)
    yield "random", _walk_random_gaits


def _walk_gait(seed: int, name: str) -> Record:
    heading = 0.0 if seed % 3 else float(np.random.default_rng(seed).uniform(-3, 3))
    plants = LikelyPlants([build_rated_plant(load_published_body())])
    (gait,) = synthesize_gaits(plants, GaitTask(name, heading, seed))
    walked = []
    for robot in range(3):
        hidden = require_walker(open_robot("starfish", seed=10 * seed + robot))
        path = read_position(hidden.move(gait.commands(8)))
        walked.append([float(v) for v in project_on_heading(path[-1], heading)])
    return {
        "gait": name,
        "heading": heading,
        "predicted": gait.predicted,
        "walked": walked,
        "failed": gait.failed,
        "simulations": gait.simulations,
    }


def _walk_random_gaits() -> Record:
    """End of 30 random gaits of paper A's kind, and of waves, on hidden robots [m]."""
    found: Record = {}
    draws: dict[str, Callable[[np.random.Generator, int], np.ndarray]] = {
        "poses": lambda rng, n: rng.uniform(-1, 1, n),  # paper A's, of +-70 degrees
        "waves": lambda rng, n: rng.normal(0, 0.4, n),
    }
    for name, draw in draws.items():
        rng, ends = np.random.default_rng(FIRST), []
        size = find_pattern(name).count_genes(8)
        for k in range(30):
            genes = draw(rng, size)
            gait = Gait(name, genes, 0.0, 0.0, 0.0, 0.0, 0, 0)
            robot = require_walker(open_robot("starfish", seed=FIRST + k))
            ends.append(read_position(robot.move(gait.commands(8)))[-1, :2].tolist())
        found[name] = ends
    return found


@cache
def _prepare_robot(robot: int) -> tuple[Any, Any, Any, Record]:
    """A hidden robot, its self-models with their weights, its gait and whole walk."""
    seed = FIRST + robot
    hidden = require_walker(open_robot("starfish", seed=seed))
    *_, run = identify_body(hidden, Settings("starfish", seed=seed))
    models, weights = select_rival_bodies(run)
    settings = HealSettings("", (), 0.0, seed=seed)
    states = make_robot_states(hidden, settings)
    for healed in heal_robot(states, models, weights, settings):
        if len(healed.phases) == 2:
            return hidden, models, weights, dict(healed.phases)
    raise AssertionError


def list_heal_runs(count: int) -> KeyedRuns:
    """Runs of whole heals after random body damages, each kind as often."""
    for k in range(count):
        yield f"{FIRST + k}", partial(_heal_damage, k, BODY_KINDS, whole=True)


def list_verdict_runs(count: int) -> KeyedRuns:
    """Runs of more random body damages: alarm and verdict, no new gait."""
    for k in range(100, 100 + count):
        yield f"{FIRST + k}", partial(_heal_damage, k, BODY_KINDS, whole=False)


def list_world_runs(count: int) -> KeyedRuns:
    """Runs of slopes and slippery ground: alarm and verdict, no new gait."""
    for k in range(count):
        yield f"{FIRST + k}", partial(_heal_damage, k, WORLD_KINDS, whole=False)


def _heal_damage(k: int, kinds: tuple[str, ...], whole: bool) -> Record:
    robot, seed = k % ROBOTS, FIRST + k
    hidden, models, weights, phases = _prepare_robot(robot)
    rng = np.random.default_rng([seed, 7])
    damage = draw_damage(hidden.anatomy, rng, (kinds[k % len(kinds)],))
    onset = float(rng.uniform(8, 20))
    settings = HealSettings("", (damage,), onset, seed=FIRST + robot)
    begun, robots = HealRun(settings, dict(phases)), make_robot_states(hidden, settings)
    run = begun
    for run in heal_robot(robots, models, weights, settings, run=begun):
        if not whole and "verdict" in run.phases:
            break
    return _summarize_heal(run, damage, onset, hidden.truth, models, robots)


def _summarize_heal(run, damage, onset, truth, models, robots) -> Record:
    phases, walked = run.phases, run.result.get("distance", {})
    alarm, gait = phases["alarm"]["alarm"], read_gait(phases["gait"])
    guess = phases["verdict"]["believed"][0]
    found = read_damage(guess)
    old = read_position(robots.damaged.move(gait.commands(8), trial=200))[-1]
    said = apply_damages(build_rated_plant(models[[0]]), found).body
    real = apply_damages(build_rated_plant(truth), damage).body
    same = (found.kind, found.target) == (damage.kind, damage.target)
    return {
        "damage": damage.document,
        "found": guess,
        "right": same,
        "world": found.kind in WORLD_KINDS,
        "nothing": found.kind == "none",
        "actions": len(run.actions),
        "alarm": alarm,
        "delay": alarm and (alarm["time"] - onset) / gait.cycle,
        "intact": phases["whole"]["distance"],
        "damaged": float(old[0]),
        "healed": walked.get("healed"),
        "best_known": walked.get("best_known"),
        "predicted": run.result.get("predicted"),
        "length_error": float(measure_length_error(said, real)[0]),
        "part_error": float(100 * np.abs(said.length - real.length).max()),
    }


def list_alarm_runs(count: int) -> KeyedRuns:
    """Runs that watch hidden robots walk, whole and breaking."""
    for k in range(count):
        yield f"{FIRST + k}", partial(_watch_walks, k)


def _watch_walks(k: int) -> Record:
    gait, rng = _synthesize_known_gaits()[k % 3], np.random.default_rng([FIRST + k, 8])
    hidden = require_walker(open_robot("starfish", seed=FIRST + 100 + k))
    plant, anatomy = build_rated_plant(load_published_body()), hidden.anatomy
    predicted = compute_channels(walk_gait([plant], gait, WATCHING_TIME), [plant])[0]
    channels = list_channels(anatomy)
    measured = read_channels(hidden.move(gait.commands(8, LEARNING_TIME)), anatomy)[1]
    known = learn_baseline(measured, predicted[: len(measured)], gait.cycle, channels)

    def seen(robot: Any, trial: int) -> tuple[Any, bool]:
        """The alarm, and whether the robot ended on its back."""
        move = robot.move(gait.commands(8, WATCHING_TIME), trial=trial)
        measured = read_channels(move, anatomy)[1]
        up = rotate_into_frame(read_orientation(move)[-1], np.array([0.0, 0, 1]))
        return watch_walk(measured, predicted, known, channels).alarm, bool(up[2] < 0)

    whole = [seen(hidden, trial) for trial in range(1, 9)]
    broken = []
    for trial, kinds in enumerate((BODY_KINDS, WORLD_KINDS), 20):
        damage = draw_damage(anatomy, rng, (kinds[k % len(kinds)],))
        onset = float(rng.uniform(8, 20))
        alarm, _ = seen(hidden.struck((damage,), onset), trial)
        early = alarm is not None and alarm.time < onset
        late = None if early or alarm is None else (alarm.time - onset) / gait.cycle
        ends = [
            read_position(robot.move(gait.commands(8), trial=30))[-1, 0]
            for robot in (hidden, hidden.struck((damage,)))
        ]
        cost, kind = float(1 - ends[1] / ends[0]), {"damage": damage.document}
        broken.append({**kind, "early": early, "delay": late, "cost": cost})
    times = [alarm.time if alarm else WATCHING_TIME for alarm, _ in whole]
    return {
        "false": sum(alarm is not None for alarm, _ in whole),
        "fallen": sum(fell for alarm, fell in whole if alarm),
        "broken": broken,
        "seconds": float(sum(times) - 6.0 * len(times)),
    }


@cache
def _synthesize_known_gaits() -> list[Gait]:
    """Gaits for `alarms`: short searches are enough for walks that are only watched."""
    plants = LikelyPlants([build_rated_plant(load_published_body())])
    tasks = [GaitTask(seed=seed) for seed in range(FIRST + 200, FIRST + 203)]
    return [gait for task in tasks for gait in synthesize_gaits(plants, task)]


SUITES = {
    "real": (list_real_runs, 60),
    "gaits": (list_gait_runs, 12),
    "alarms": (list_alarm_runs, 30),
    "heals": (list_heal_runs, 30),
    "verdicts": (list_verdict_runs, 30),
    "worlds": (list_world_runs, 20),
}
